// Smooth edges of scenes of few shapes without meshes and height fields, on CUDA: all pixels of a region together.
//
// Results of the trace are kept in shared memory: see PixelCache. An id is a byte, so that tables by id tell which
// shapes are seen around the pixels with edges, and their bits.
#pragma once
#include "antialiasing/neighborhood.h"
#include "antialiasing/edge_scan.h"
#include "antialiasing/samples.h"
#include "traversal/trace_tile.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int BYTE_IDS = 128;      // shapes at most, and none
constexpr int MOST_RECORDS = 64;   // of shapes whose records are there at once
constexpr unsigned OPEN =
    0x80;    // it is not known yet which pixel shows a sample that has hit the record of this number
constexpr int PLACE_BITS = 10;     // of a pixel's place in its region, row after row

// Per-block state of a region's edges.
template <int WIDTH, int HEIGHT> struct CachedEdges {
    static constexpr int PIXELS = WIDTH * HEIGHT;
    static_assert(PIXELS <= 1 << PLACE_BITS, "places fit");

    union {
        ShapeRecord records[MOST_RECORDS];  // from the highest id to the lowest
        struct {                       // before there are any
            EdgeMarks<HEIGHT> marks;
            unsigned char sided[BYTE_IDS];  // has_sides() by id and one
        };
    };
    AlignedArray<unsigned, 2>
        bits[BYTE_IDS];  // of a shape's rank among the records, by its id and one; the first is that of none
    unsigned shown[PIXELS];         // by which of the pixels around, a byte a sample, by the pixel's number
    unsigned seen_words[BYTE_IDS / WARP_SIZE];
    unsigned short samples[SAMPLES * PIXELS];  // that are traced: 4 * the pixel's number + the sample's
    unsigned short pixels[PIXELS];  // that may have an edge: their places, above that what edge() says of them
    unsigned char seen[BYTE_IDS];   // likewise: is it around the pixels?
    int total, next;                // of `samples`, and how many times 32 of them were taken
};

template <class Types, int LENS, int WIDTH, int HEIGHT, int IMAGES, class Target> struct CachedEdgeResolver {
    using Centres = PixelCache<Target, IMAGES, WIDTH, HEIGHT>;
    using Edges = CachedEdges<WIDTH, HEIGHT>;
    using Finder = EdgeFinder<LENS, WIDTH, HEIGHT, IMAGES, Target>;
    static constexpr int LINE = Centres::LINE, WARPS = THREADS / WARP_SIZE;
    static constexpr int SIDED_TYPES = Types::GEOMETRY & TYPES_WITH_FACES;
    static constexpr bool SIDED = SIDED_TYPES != 0;
    static constexpr bool ROUND = Types::has_any(SPHERE, ELLIPSOID);
    static constexpr int TRACED = (Types::ANALYTIC & ~(1 << ELLIPSOID)) | (ROUND ? 1 << SPHERE : 0);

    Edges& edges;
    const EdgeTester<LENS, Centres>& seen;
    const Camera& camera;
    const Region& region;

    WARPCAM_DEVICE const Target& target() const { return seen.centres.target; }
    // A pixel of the image in its images, by its place in the region.
    WARPCAM_DEVICE unsigned of_images(unsigned place) const
    {
        return seen.centres.of_images(region.left + int(place % WIDTH), region.top + int(place / WIDTH));
    }

    struct Spot {
        int i, j;        // a pixel
        unsigned pixel;  // where it is kept
        bool plain;
    };

    // The pixel of a listed sample.
    WARPCAM_DEVICE Spot spot_of(unsigned listed) const
    {
        const unsigned its = edges.pixels[listed / SAMPLES], place = its % (1u << PLACE_BITS);
        return { region.left + int(place % WIDTH), region.top + int(place / WIDTH), cache_index(place),
                 (its >> PLACE_BITS & PLAIN) != 0 };
    }

    // Index at which a pixel is stored, by its position in the region.
    WARPCAM_DEVICE static unsigned cache_index(unsigned place) { return Finder::cache_index(place); }

    // The nine ids around a pixel that is kept, of which all are loaded before any is used.
    template <class Use> WARPCAM_DEVICE void ids_around(unsigned pixel, const Use& use) const
    {
        int ids[9];
#pragma unroll
        for (int k = 0; k < 9; ++k)
            ids[k] = seen.shape(pixel + Neighborhood3x3::step<LINE>(k / 3 * 4 + k % 3));
#pragma unroll
        for (int k = 0; k < 9; ++k)
            use(k / 3 * 4 + k % 3, ids[k]);
    }
    WARPCAM_DEVICE void see_around(unsigned pixel) const
    {
        ids_around(pixel, [&](int, int id) { edges.seen[id + 1] = 1; });
    }

    // Notes what is seen around the pixels of some samples; with a barrier.
    WARPCAM_DEVICE void see_all(int from, int end) const
    {
        for (int k = from + int(threadIdx.x); k < end; k += THREADS)
            see_around(cache_index(edges.pixels[edges.samples[k] / SAMPLES] % (1u << PLACE_BITS)));
        block_sync();
    }

    // Lists the samples of the listed pixels and what they may hit. Then a barrier.
    WARPCAM_DEVICE void list_samples(const Finder& finder, int count) const
    {
        const int lane = threadIdx.x % WARP_SIZE;
        for (int first = threadIdx.x - lane; first < count; first += THREADS) {
            const int number = first + lane;
            const unsigned place = edges.pixels[min(number, count - 1)], pixel = cache_index(place);
            const auto sided = [&](int id) { return edges.sided[id + 1] != 0; };
            const unsigned found = number < count ? finder.template edge<SIDED>(place, sided) : 0;
            const unsigned samples = found & EVERY_SAMPLE;
            const int its = __popc(samples);
            int before = 0, all = 0;
            const unsigned earlier = (1u << lane) - 1;
#pragma unroll
            for (int bit = 0; bit < 3; ++bit) {
                const unsigned with = __ballot_sync(FULL_WARP, its >> bit & 1);
                before += __popc(with & earlier) << bit;
                all += __popc(with) << bit;
            }
            int at = before + __shfl_sync(FULL_WARP, lane == 0 ? atomicAdd(&edges.total, all) : 0, 0);
            if (number < count)
                edges.pixels[number] = static_cast<unsigned short>(place | found << PLACE_BITS);
            if (samples) {
                edges.shown[number] = 0x01010101u * Neighborhood3x3::MIDDLE;
                see_around(pixel);
#pragma unroll
                for (int sample = 0; sample < SAMPLES; ++sample)
                    if (samples >> sample & 1)
                        edges.samples[at++] = static_cast<unsigned short>(SAMPLES * number + sample);
            }
        }
    }

    // Gives the shapes that are seen their ranks, and returns how many they are; with barriers.
    WARPCAM_DEVICE int rank_shapes() const
    {
        static_assert(THREADS == BYTE_IDS, "a thread for each id");
        const int slot = threadIdx.x;
        const bool is_seen = edges.seen[slot] && slot > 0;
        const unsigned word = __ballot_sync(FULL_WARP, is_seen);
        if (slot % WARP_SIZE == 0)
            edges.seen_words[slot / WARP_SIZE] = word;
        block_sync();
        edges.seen[slot] = 0;
        int rank = __popc(word >> slot % WARP_SIZE) - int(is_seen), count = 0;
#pragma unroll
        for (int k = 0; k < WARPS; ++k) {
            const int its = __popc(edges.seen_words[k]);
            count += its;
            rank += k > slot / WARP_SIZE ? its : 0;
        }
        edges.bits[slot] = { { is_seen && rank < WARP_SIZE ? 1u << rank % WARP_SIZE : 0,
                               is_seen && rank >= WARP_SIZE ? 1u << rank % WARP_SIZE : 0 } };
        if (is_seen && rank < MOST_RECORDS)
            edges.records[rank].origin.w = slot - 1;
        block_sync();
        return count;
    }

    // Makes the records of so many shapes. Then a barrier.
    template <class Shapes, class Meshes, class HeightFields>
    WARPCAM_DEVICE void prepare_records(int count, const Shapes& shapes, const Meshes& meshes,
                                        const HeightFields& fields, int world) const
    {
        const int rank = threadIdx.x;
        if (rank >= count)
            return;
        ShapeRecord record;
        if (!sample_record<Types, LENS>(shapes, meshes, fields, camera, region, world, edges.records[rank].origin.w,
                                        record))
            record.axis_x.w = -1;  // of no type: nothing hits it
        if (Types::has(ELLIPSOID) && record.axis_x.w == ELLIPSOID)
            record.axis_x.w = SPHERE;  // as a unit sphere is met as one: a type less to look through
        edges.records[rank] = record;
    }

    // The pixels around one that show a shape, by place; it is negative for none.
    WARPCAM_DEVICE unsigned showing(const Spot& spot, int shape) const
    {
        unsigned places = 0;
        ids_around(spot.pixel, [&](int place, int id) { places |= unsigned(id == shape) << place; });
        places &= spot.i > 0 ? 0x777u : 0x666u;
        places &= spot.i + 1 < target().width ? 0x777u : 0x333u;
        places &= spot.j > 0 ? 0x777u : 0x770u;
        return places & (spot.j + 1 < target().height ? 0x777u : 0x077u);
    }

    // The nearest of these, as long as there is any; `order` then begins with those that are farther.
    WARPCAM_DEVICE static int nearest(unsigned places, unsigned& order)
    {
        int place = Neighborhood3x3::MIDDLE;
        for (; !(places >> place & 1); order >>= 4)
            place = order & 15;
        return place;
    }

    WARPCAM_DEVICE static bool is_sided(const ShapeRecord& record)
    {
        return record.axis_x.w >= 0 && (SIDED_TYPES >> record.axis_x.w & 1);
    }

    // Selects the neighbouring pixel that shows a sample's hit on a shape with sides, as shown_sample() does.
    WARPCAM_DEVICE int shown_side(const Spot& spot, int sample, const ShapeRecord& record) const
    {
        const CameraRay<LENS> ray = sample_ray<LENS>(camera, spot.i, spot.j, sample);
        const float depth = intersect_any<SIDED_TYPES>(record, ray.local(record));
        unsigned left = showing(spot, record.origin.w), order = Neighborhood3x3::order(sample);
        int best_at = nearest(left, order);
        left &= ~(1u << best_at);
        const Offset offset = sample_offset(sample);
        const int part = part_at<Types, LENS>(record, ray, depth);
        const auto pixel_of = [&](int place) { return spot.pixel + Neighborhood3x3::step<LINE>(place); };
        const auto apart_from = [&](int place) {
            const float right = float(Neighborhood3x3::right(place)) - offset.right;
            const float down = float(Neighborhood3x3::down(place)) - offset.down;
            return right * right + down * down;
        };
        const auto cost_of = [&](int place) {
            const float there = seen.depth(pixel_of(place));
            const auto its =
                view_ray<LENS>(camera, spot.i + Neighborhood3x3::right(place), spot.j + Neighborhood3x3::down(place));
            return apart_from(place) + seen.apart(pixel_of(place), depth)
                   + (part_at<Types, LENS>(record, its, there) == part ? 0.0f : NORMAL_WEIGHT);
        };
        Colour<IMAGES> chosen = seen.template colour<IMAGES>(pixel_of(best_at)), its;
        float best = MISS;  // not known before some other pixel has another colour
        while (true) {
            int next = -1;  // of another colour
            for (; left && next < 0; order >>= 4) {
                const int place = order & 15;
                if (left >> place & 1) {
                    left &= ~(1u << place);
                    its = seen.template colour<IMAGES>(pixel_of(place));
                    next = chosen.differs(its, COLOR_TOLERANCE) ? place : -1;
                }
            }
            if (next < 0 || apart_from(next) >= best)
                return best_at;
            if (best == MISS)
                best = cost_of(best_at);
            const float cost = cost_of(next);
            if (cost < best) {
                best = cost;
                chosen = its;
                best_at = next;
            }
        }
    }

    // Asks this of those samples up to one that trace() has left open, which each warp lists first among those it took.
    WARPCAM_DEVICE void show_sides(int from, int end) const
    {
        const int lane = threadIdx.x % WARP_SIZE, begin = from + int(threadIdx.x) - lane;
        unsigned char* const shown = reinterpret_cast<unsigned char*>(edges.shown);
        int open = 0;
        const auto slot = [&](int number) { return begin + number / WARP_SIZE * THREADS + number % WARP_SIZE; };
        for (int first = begin; first < end; first += THREADS) {
            const unsigned listed = edges.samples[min(first + lane, end - 1)];
            const unsigned found = __ballot_sync(FULL_WARP, first + lane < end && shown[listed] & OPEN);
            __syncwarp();
            if (found >> lane & 1)
                edges.samples[slot(open + __popc(found & ((1u << lane) - 1)))] = static_cast<unsigned short>(listed);
            open += __popc(found);
        }
        __syncwarp();
        for (int number = lane; number < open; number += WARP_SIZE) {
            const unsigned listed = edges.samples[slot(number)];
            const ShapeRecord& record = edges.records[shown[listed] & ~OPEN];
            shown[listed] = static_cast<unsigned char>(shown_side(spot_of(listed), listed % SAMPLES, record));
        }
    }

    // Traces samples up to one; each warp takes 32 at a time. Of those that hit shapes with sides it leaves open which
    // pixel shows them, if need be.
    WARPCAM_DEVICE void trace(int from, int end, int words) const
    {
        const int lane = threadIdx.x % WARP_SIZE;
        while (true) {
            const int first = from + WARP_SIZE * __shfl_sync(FULL_WARP, lane == 0 ? draw_next(edges.next) : 0, 0);
            if (first >= end)
                return;
            const bool active = first + lane < end;
            const unsigned listed = edges.samples[active ? first + lane : first];
            const int sample = listed % SAMPLES;
            const Spot spot = spot_of(listed);
            const CameraRay<LENS> ray = sample_ray<LENS>(camera, spot.i, spot.j, sample);
            unsigned own[2] {};
            ids_around(spot.pixel, [&](int, int id) {
                const auto bits = edges.bits[id + 1];
                own[0] |= bits.at[0];
                own[1] |= bits.at[1];
            });
            Hit hit { camera.far, -1, -1 };
#pragma unroll
            for (int w = 0; w < 2; ++w)
                for (unsigned left = w < words ? warp_reduce_or(own[w]) : 0; left; left &= left - 1) {
                    const int bit = ctz(left);
                    const ShapeRecord& record = edges.records[w * WARP_SIZE + bit];
                    const float t = intersect_any<TRACED>(record, ray.local(record));
                    if ((own[w] >> bit & 1) && t < hit.depth && t > camera.near) {
                        hit.depth = t;
                        hit.shape = w * WARP_SIZE + bit;
                    }
                }
            const ShapeRecord& record = edges.records[hit.shape < 0 ? 0 : hit.shape];
            const unsigned places = showing(spot, hit.shape < 0 ? -1 : record.origin.w);
            const bool sided = hit.shape >= 0 && is_sided(record);
            unsigned shown = Neighborhood3x3::MIDDLE, order = Neighborhood3x3::order(sample);
            if (sided && !(spot.plain && places >> Neighborhood3x3::MIDDLE & 1) && (places & (places - 1)))
                shown = OPEN | hit.shape;
            else if (places)
                shown = nearest(places, order);
            if (active)
                reinterpret_cast<unsigned char*>(edges.shown)[listed] = static_cast<unsigned char>(shown);
        }
    }

    WARPCAM_DEVICE void put(int count) const
    {
        for (int k = threadIdx.x; k < count; k += THREADS) {
            const unsigned its = edges.pixels[k], place = its % (1u << PLACE_BITS), pixel = cache_index(place);
            if (!(its >> PLACE_BITS))
                continue;
            const unsigned places = edges.shown[k];
            unsigned by[SAMPLES];
#pragma unroll
            for (int sample = 0; sample < SAMPLES; ++sample)
                by[sample] = pixel + Neighborhood3x3::step<LINE>(int(places >> 8 * sample & 0xff));
            put_means<IMAGES>(seen.centres, of_images(place), by);
        }
    }

    // Before a barrier, and that before all else.
    template <class Shapes> WARPCAM_DEVICE static void clear(Edges& edges, const Shapes& shapes)
    {
        const int slot = threadIdx.x;
        edges.seen[slot] = 0;
        if (SIDED)
            edges.sided[slot] = has_sides<Types>(shapes, slot - 1 < int(shapes.types.shape[0]) ? slot - 1 : -1);
        if (slot == 0)
            edges.total = 0;
    }

    // All threads of the block.
    template <class Shapes, class Meshes, class HeightFields>
    WARPCAM_DEVICE void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, int world) const
    {
        const Finder finder { edges.marks, seen, region.left, region.top };
        finder.look();
        block_sync();
        const int count = finder.list_pixels(edges.pixels);
        if (count == 0)
            return;
        block_sync();
        list_samples(finder, count);
        block_sync();
        const int total = edges.total;
        if (total == 0)
            return;
        for (int from = 0, end; from < total; from = end) {
            end = total;
            if (from > 0)
                see_all(from, end);
            int shapes_seen = rank_shapes();
            while (shapes_seen > MOST_RECORDS) {  // fewer samples, until they do not see too many
                end = from + (end - from + 1) / 2;
                see_all(from, end);
                shapes_seen = rank_shapes();
            }
            if (threadIdx.x == 0)
                edges.next = 0;
            prepare_records(shapes_seen, shapes, meshes, fields, world);
            block_sync();
            trace(from, end, (shapes_seen + WARP_SIZE - 1) / WARP_SIZE);
            block_sync();
            if constexpr (SIDED) {
                show_sides(from, end);
                block_sync();
            }
        }
        put(count);
    }
};

}  // namespace warpcam
#endif
