// Which pixel shows what a sample has hit, where ids are near: as shown_sample() has it, but the colours around are loaded
// at once, and faces only where colours differ.
#pragma once
#include "around.h"
#include "samples.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

template <int TYPES, int IMAGES, int LENS, class Meshes, class Centres> struct PlacedShower {
    const Seen<LENS, Centres>& seen;
    const Meshes& meshes;
    const Camera& camera;
    int i, j, sample;
    unsigned nine[9];  // the colours around, row after row

    WARPCAM_FN unsigned pixel_of(int place) const { return seen.at(i + Around::right(place), j + Around::down(place)); }

    // The pixels around that show a shape, by place; it is negative for none.
    WARPCAM_FN unsigned showing(int shape) const
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

    WARPCAM_FN unsigned colour(int place) const
    {
        unsigned found = nine[4];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            found = place == k / 3 * 4 + k % 3 ? nine[k] : found;
        return found;
    }
    WARPCAM_FN unsigned unlike(unsigned colour) const
    {
        unsigned places = 0;
#pragma unroll
        for (int k = 0; k < 9; ++k)
            places |= unsigned(bytes_differ(nine[k], colour, FAINT)) << (k / 3 * 4 + k % 3);
        return places;
    }

    // The number of the pixel among the nine around. `shape` is what is seen there, if it is not `hit` what lies behind
    // all else or, negative, nothing.
    WARPCAM_FN int shown(int shape, float depth, int face, bool hit, const Record& record, unsigned edge)
    {
        unsigned left = showing(shape), order = Around::order(sample);
        const bool own = left >> Around::MIDDLE & 1;
        if (!left || (own && (edge & PLAIN)))
            return ITSELF;
        int best_at = Around::MIDDLE;
        for (; !(left >> best_at & 1); order >>= 4)
            best_at = order & 15;
        left &= ~(1u << best_at);
        constexpr int SIDED = TYPES & (1 << BOX | 1 << CYLINDER);
        const int type = hit ? record.axis_x.w : -1;
        const bool is_face = type == MESH && face >= 0, is_sided = type >= 0 && (SIDED >> type & 1);
        if ((is_face || is_sided || ((TYPES >> HEIGHT_FIELD & 1) && type == HEIGHT_FIELD)) && left)
            best_at = best(best_at, left, order, depth, face, is_face, is_sided, record);
        return best_at - (best_at >> 2);
    }

    WARPCAM_FN int best(int best_at, unsigned left, unsigned order, float depth, int face, bool is_face, bool is_sided,
                        const Record& record)
    {
        seen.centres.template bytes_around<IMAGES>(i, j, nine);
        unsigned apart = unlike(colour(best_at));
        if (!(left & apart))
            return best_at;
        const Offset offset = sample_offset(sample);
        const unsigned rows = as_int(record.size.z);
        const auto normal_of = [&](int number) { return face_normal(meshes, rows, number); };
        Vec normal { 0.0f, 0.0f, 0.0f };
        int part = -1;
        if (is_face)
            normal = normal_of(face);
        else if (is_sided)
            part = part_at<LENS>(record, sample_ray<LENS>(camera, i, j, sample), depth);
        const auto apart_from = [&](int place) {
            const float right = float(Around::right(place)) - offset.right, down = float(Around::down(place)) - offset.down;
            return right * right + down * down;
        };
        const auto cost_of = [&](int place, float most) {  // or what it is at least, if that is so much
            const unsigned pixel = pixel_of(place);
            float cost = apart_from(place) + seen.apart(pixel, depth);
            if (cost >= most)
                return cost;
            if (is_face)
                return cost
                    + TURNED * (1.0f - dot(normal, normal_of(int(seen.centres.target.face.data[seen.centres.of_images(pixel)]))));
            const auto its = view_ray<LENS>(camera, i + Around::right(place), j + Around::down(place));
            return !is_sided || part_at<LENS>(record, its, seen.depth(pixel)) == part ? cost : cost + TURNED;
        };
        float least = FAR_AWAY;  // not known before it is compared
#pragma unroll 1
        for (; left & apart; order >>= 4) {
            const int place = order & 15;
            if (!(left & apart & 1u << place)) {
                left &= ~(1u << place);
                continue;
            }
            left &= ~(1u << place);
            if (apart_from(place) >= least)
                break;
            if (least == FAR_AWAY)
                least = cost_of(best_at, FAR_AWAY);
            const float cost = cost_of(place, least);
            if (cost < least) {
                least = cost;
                best_at = place;
                apart = unlike(colour(place));
            }
        }
        return best_at;
    }
};

}  // namespace warpcam
#endif
