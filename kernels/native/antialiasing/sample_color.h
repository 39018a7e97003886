// Selects the pixel that shows what a sample has hit, where ids are cached: as shown_sample() does, but loads the
// colours around at once, and faces only where colours differ.
#pragma once
#include "antialiasing/neighborhood.h"
#include "antialiasing/neighbor_shapes.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

template <class Types, int IMAGES, int LENS, class Meshes, class Centres> struct PlacedShower {
    const EdgeTester<LENS, Centres>& seen;
    const Meshes& meshes;
    const Camera& camera;
    int i, j, sample;
    unsigned nine[9];  // the colours around, row after row

    WARPCAM_DEVICE unsigned pixel_of(int place) const
    {
        return seen.at(i + Neighborhood3x3::right(place), j + Neighborhood3x3::down(place));
    }

    // The pixels around that show a shape, by place; it is negative for none.
    WARPCAM_DEVICE unsigned showing(int shape) const
    {
        unsigned places = 0;
#pragma unroll
        for (int k = 0; k < 9; ++k)
            places |= unsigned(seen.centres.shape_beside(i + k % 3 - 1, j + k / 3 - 1) == shape) << (k / 3 * 4 + k % 3);
        places &= i > 0 ? 0x777u : 0x666u;
        places &= i + 1 < seen.centres.target.width ? 0x777u : 0x333u;
        places &= j > 0 ? 0x777u : 0x770u;
        return places & (j + 1 < seen.centres.target.height ? 0x777u : 0x077u);
    }

    WARPCAM_DEVICE unsigned colour(int place) const
    {
        unsigned found = nine[4];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            found = place == k / 3 * 4 + k % 3 ? nine[k] : found;
        return found;
    }
    WARPCAM_DEVICE unsigned unlike(unsigned colour) const
    {
        unsigned places = 0;
#pragma unroll
        for (int k = 0; k < 9; ++k)
            places |= unsigned(bytes_differ(nine[k], colour, COLOR_TOLERANCE)) << (k / 3 * 4 + k % 3);
        return places;
    }

    // True if depths, faces or sides must be compared to select the pixel that shows `shape`: what is seen there if the
    // sample `hits`, else what lies behind all else or, negative, nothing. `best_at` is the nearest pixel that shows
    // it, `left` are the others.
    WARPCAM_DEVICE bool is_open(int shape, int face, bool hits, const ShapeRecord& record, unsigned edge, int& best_at,
                                unsigned& left)
    {
        unsigned order = Neighborhood3x3::order(sample);
        left = showing(shape);
        best_at = Neighborhood3x3::MIDDLE;
        if (!left || ((left >> Neighborhood3x3::MIDDLE & 1) && (edge & PLAIN)))
            return false;
        for (; !(left >> best_at & 1); order >>= 4)
            best_at = order & 15;
        left &= ~(1u << best_at);
        constexpr int SIDED = Types::GEOMETRY & (TYPES_WITH_FACES | 1 << HEIGHT_FIELD);
        const int type = record.axis_x.w;
        if (!left || !hits || !((type == MESH && face >= 0) || (SIDED >> type & 1)))
            return false;
        seen.centres.template bytes_around<IMAGES>(i, j, nine);
        return left & unlike(colour(best_at));
    }

    // The best of these then.
    WARPCAM_DEVICE int best(int best_at, unsigned left, float depth, int face, const ShapeRecord& record)
    {
        seen.centres.template bytes_around<IMAGES>(i, j, nine);
        unsigned apart = unlike(colour(best_at)), order = Neighborhood3x3::order(sample);
        const int type = record.axis_x.w;
        const bool is_face = type == MESH && face >= 0, is_sided = (Types::GEOMETRY & TYPES_WITH_PARTS) >> type & 1;
        const Offset offset = sample_offset(sample);
        const unsigned rows = as_int(record.size.z);
        const auto normal_of = [&](int number) { return face_normal(meshes, rows, number); };
        Vec3 normal { 0.0f, 0.0f, 0.0f };
        int part = -1;
        if (is_face)
            normal = normal_of(face);
        else if (is_sided)
            part = part_at<Types, LENS>(record, sample_ray<LENS>(camera, i, j, sample), depth);
        const auto apart_from = [&](int place) {
            const float right = float(Neighborhood3x3::right(place)) - offset.right,
                        down = float(Neighborhood3x3::down(place)) - offset.down;
            return right * right + down * down;
        };
        const auto cost_of = [&](int place, float most) {  // or what it is at least, if that is so much
            const unsigned pixel = pixel_of(place);
            const float cost = apart_from(place) + seen.apart(pixel, depth);
            if (cost >= most)
                return cost;
            if (is_face) {
                const int its = int(seen.centres.target.face.data[seen.centres.of_images(pixel)]);
                return cost + NORMAL_WEIGHT * (1.0f - dot(normal, normal_of(its)));
            }
            const auto its =
                view_ray<LENS>(camera, i + Neighborhood3x3::right(place), j + Neighborhood3x3::down(place));
            return !is_sided || part_at<Types, LENS>(record, its, seen.depth(pixel)) == part ? cost
                                                                                             : cost + NORMAL_WEIGHT;
        };
        float least = cost_of(best_at, MISS);
        while (true) {
            int place = -1;  // the next that is unlike, for all lanes before any goes on
#pragma unroll 1
            for (; (left & apart) && place < 0; order >>= 4) {
                place = left & apart & 1u << (order & 15) ? int(order & 15) : -1;
                left &= ~(1u << (order & 15));
            }
            if (place < 0 || apart_from(place) >= least)
                return best_at;
            const float cost = cost_of(place, least);
            if (cost < least) {
                least = cost;
                best_at = place;
                apart = unlike(colour(place));
            }
        }
    }
};

// Says which pixels show all samples of a batch. Each warp first looks at those it takes, and then, in full warps, at
// those of which that is not told by shapes and colours.
template <class Types, int IMAGES, int LENS, class Samples, class List, class Meshes, class Centres>
WARPCAM_DEVICE void show_samples(Samples& batch, const List& list, const Meshes& meshes, const Camera& camera,
                                 const EdgeTester<LENS, Centres>& seen, const Region& region)
{
    static_assert(sizeof(batch.own) >= sizeof(batch.samples), "what is open has room where shapes were");
    unsigned short* const open_of =
        reinterpret_cast<unsigned short*>(batch.own);  // the others, and above them the nearest
    const int lane = threadIdx.x % WARP_SIZE, begin = threadIdx.x - lane, total = batch.total();
    using Shower = PlacedShower<Types, IMAGES, LENS, Meshes, Centres>;
    const auto shower_of = [&](int sample) {
        const int at = batch.place(sample / SAMPLES);
        return Shower { seen, meshes, camera, region.left + at % 64, region.top + at / 64, sample % SAMPLES };
    };
    const auto record_of = [&](int rank) -> const ShapeRecord& { return list.records[rank < NEAR_SHAPES ? rank : 0]; };
    int open = 0;
#pragma unroll 1
    for (int first = begin; first < total; first += THREADS) {
        const bool active = first + lane < total;
        const int sample = batch.sample(active ? first + lane : first), rank = batch.shown[sample];
        const int ground = batch.HAS_FIELD ? batch.ground[batch.HAS_FIELD ? sample / SAMPLES : 0] : NEAR_SHAPES;
        const int shown = rank < NEAR_SHAPES ? rank : ground;
        Shower shower = shower_of(sample);
        int best_at;
        unsigned left;
        const bool asks =
            shower.is_open(shown < NEAR_SHAPES ? list.records[shown].origin.w : -1, batch.hits[sample].face,
                           rank < NEAR_SHAPES, record_of(rank), batch.pixels[sample / SAMPLES].edge(), best_at, left);
        const unsigned asking = __ballot_sync(FULL_WARP, active && asks);
        __syncwarp();
        if (asking >> lane & 1) {
            const int number = open + __popc(asking & ((1u << lane) - 1));
            batch.sample(begin + number / WARP_SIZE * THREADS + number % WARP_SIZE) =
                static_cast<unsigned short>(sample);
            open_of[sample] = static_cast<unsigned short>(left | unsigned(best_at) << 12);
        } else if (active) {
            batch.shown[sample] = static_cast<unsigned char>(best_at - (best_at >> 2));
        }
        open += __popc(asking);
    }
    __syncwarp();
#pragma unroll 1
    for (int number = lane; number < open; number += WARP_SIZE) {
        const int sample = batch.sample(begin + number / WARP_SIZE * THREADS + number % WARP_SIZE);
        const unsigned its = open_of[sample];
        const int best_at = shower_of(sample).best(int(its >> 12), its & 0xfffu, batch.hits[sample].depth,
                                                   batch.hits[sample].face, record_of(batch.shown[sample]));
        batch.shown[sample] = static_cast<unsigned char>(best_at - (best_at >> 2));
    }
}

}  // namespace warpcam
#endif
