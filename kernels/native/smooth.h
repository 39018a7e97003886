// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// A block looks for edges in one region until it has a few hundred pixels. What their samples may hit are the shapes that
// are seen in the pixels around, of which it makes the records once; nothing else is traced, nor are samples on a side
// where there is no edge. Its warps take 32 samples at a time, as long as there are any: a ray that takes long holds up
// no others. A sample has the colour of the nearest pixel that shows the same surface: nothing is lit anew, whatever made
// the image.
#pragma once
#include "kept_centres.h"
#include "mesh_queue.h"
#include "near_shapes.h"
#include "seen_tiles.h"
#include "smooth_cpu.h"
#include "smooth_kept.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// Pixels with edges that a block lists before it traces. A warp lists up to 32 after it has seen that there is room.
constexpr int LISTED = 896;
// The same where images are smoothed in place, and of how many rows of tiles of a region all pixels surely fit.
constexpr int LISTED_IN_PLACE = 1632, BAND = (LISTED_IN_PLACE - THREADS + LANES) / (64 * TILE_HEIGHT);
// Those that it smooths together, at most: at the end its warps wait for the one whose rays take longest. Five blocks of a
// multiprocessor have room for so many.
constexpr int most_together(int types) { return types >> HEIGHT_FIELD & 1 ? 384 : 440; }

// What a sample has hit, where there are meshes.
struct SampleHit {
    float depth;
    int face;
};

template <bool LARGE> struct ListedBits {
    using type = unsigned;
};
template <> struct ListedBits<false> {
    using type = unsigned short;
};

// A pixel with an edge: its place in the region, and what edge() says of it in the lowest bits. Without meshes and height
// fields regions have half as many rows, so that 16 bits hold it.
template <int TYPES> struct ListedPixel {
    static constexpr int SHIFT = SAMPLES + 1;
    static constexpr bool LARGE = TYPES >> MESH & 1 || TYPES >> HEIGHT_FIELD & 1;
    typename ListedBits<LARGE>::type bits;

    WARPCAM_FN int place() const { return int(bits >> SHIFT); }
    WARPCAM_FN unsigned edge() const { return bits & ((1u << SHIFT) - 1); }
};

// Pixels that a block smooths together.
template <int TYPES> struct Chunk {
    static constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    static constexpr int MOST = most_together(TYPES);

    const ListedPixel<TYPES>* pixels;
    NearBits own[MOST];                       // the shapes around
    Band meshes[HAS_MESH ? MOST : 1], fields[HAS_FIELD ? MOST : 1];
    unsigned char ground[HAS_FIELD ? MOST : 1];  // the record of what is_behind(), not traced, or NEAR_SHAPES
    // That are traced: 4 * the pixel's number + the sample's. From the front on those whose rays are likely to take long,
    // which begin first, from the back on the others.
    unsigned short samples[SAMPLES * MOST];
    unsigned char shown[SAMPLES * MOST];      // by which of the pixels around; where there are meshes first what was hit
    SampleHit hits[HAS_MESH ? SAMPLES * MOST : 1];  // of the samples
    int before, after;                        // of `samples`: how many at the front, and at the back
    int next;                                 // which comes next

    WARPCAM_FN int place(int pixel) const { return pixels[pixel].place(); }
    WARPCAM_FN int total() const { return before + after; }
    WARPCAM_FN int sample(int number) const
    {
        return samples[number < before ? number : SAMPLES * MOST - 1 - (number - before)];
    }
};

// The records as trace_rays() reads a list.
struct Ranked {
    struct Itself {
        WARPCAM_FN int operator[](int rank) const { return rank; }
    };
    const Record* records;
    Itself order;
    int count;
};

// The nearest hit of the lane's ray among the shapes in `own` that are in `walked`.
template <int TYPES, int LENS, class HeightFields>
WARPCAM_FN void trace_own(const Record* records, unsigned walked, unsigned own, const ViewRay<LENS>& ray, float near,
                          const HeightFields& fields, const Band& ground, Hit& hit)
{
    for (; walked; walked &= walked - 1) {
        const int rank = lowest_bit(walked);
        const Record& record = records[rank];
        const bool mine = own >> rank & 1;
        if ((TYPES >> HEIGHT_FIELD & 1) && record.axis_x.w == HEIGHT_FIELD) {
            if (mine) {
                Hit within { lower(hit.depth, ground.last), -1, -1 };
                walk_height_field(fields, record, ray, upper(near, ground.first), within);
                if (within.shape >= 0)
                    hit = within;
            }
            __syncwarp();
        } else {
            const float t = enter_any<analytic_types(TYPES)>(record, ray.local(record));
            if (mine && t < hit.depth && t > near) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
            }
        }
    }
}

// Finds what may be hit by the samples of a pixel whose shapes are listed, and lists these samples.
template <int TYPES, int LENS, class Centres>
WARPCAM_FN void list_samples(Chunk<TYPES>& chunk, int pixel, const NearShapes& list, const Camera& camera,
                             const Seen<LENS, Centres>& seen, const Region& region)
{
    const int place = chunk.place(pixel), i = region.left + place % 64, j = region.top + place / 64;
    NearBits own {};
    Band on_meshes = NOWHERE, on_fields = NOWHERE, others = NOWHERE;
    int before = -1, rank = NEAR_SHAPES, ground = NEAR_SHAPES;
    bool sky = false, several = false;
#pragma unroll 1
    for (int k = 0; k < 9; ++k) {
        const unsigned beside = seen.around(i, j, k);
        const int id = seen.shape(beside);
        sky |= id < 0;
        if (id < 0)
            continue;
        if (id != before)
            rank = list.place(id);
        before = id;
#pragma unroll
        for (int w = 0; w < NEAR_WORDS; ++w) {
            const unsigned bit = rank / LANES == w ? 1u << rank % LANES : 0;
            own[w] |= bit;
            if (Chunk<TYPES>::HAS_MESH && (bit & list.meshes[w]))
                on_meshes.include(seen.depth(beside));
            if (Chunk<TYPES>::HAS_FIELD && bit) {
                const bool is_field = bit & list.fields[w];
                (is_field ? on_fields : others).include(seen.depth(beside));
                several |= is_field && ground < NEAR_SHAPES && ground != rank;
                ground = is_field ? rank : ground;
            }
        }
    }
    if (Chunk<TYPES>::HAS_FIELD) {
        const bool behind = !several && is_behind<LENS>(on_fields, others, sky, pixel_width<LENS>(camera));
        chunk.ground[pixel] = static_cast<unsigned char>(behind ? ground : NEAR_SHAPES);
        for (int w = 0; w < NEAR_WORDS; ++w)
            own[w] &= behind ? ~list.fields[w] : ~0u;
    }
    for (int w = 0; w < NEAR_WORDS; ++w)
        chunk.own[pixel][w] = own[w];
    if (Chunk<TYPES>::HAS_MESH)
        chunk.meshes[pixel] = on_meshes.template widened<LENS>(pixel_width<LENS>(camera));
    if (Chunk<TYPES>::HAS_FIELD)
        chunk.fields[pixel] = on_fields.template widened<LENS>(pixel_width<LENS>(camera));
    int meshes = 0;
    for (int w = 0; w < NEAR_WORDS; ++w)
        meshes += __popc(own[w] & list.meshes[w]);
    const bool early = meshes > 1;
    const unsigned samples = chunk.pixels[pixel].edge() & EVERY_SAMPLE;
    int at = atomicAdd(early ? &chunk.before : &chunk.after, __popc(samples));
    at = early ? at : SAMPLES * chunk.MOST - 1 - at;
    for (int sample = 0; sample < SAMPLES; ++sample) {
        chunk.shown[SAMPLES * pixel + sample] = ITSELF;
        if (samples >> sample & 1) {
            chunk.samples[at] = static_cast<unsigned short>(SAMPLES * pixel + sample);
            at += early ? 1 : -1;
        }
    }
}

// Traces the samples of a chunk; each warp takes 32 at a time.
template <int TYPES, int LENS, int IMAGES, class Rays, class Meshes, class HeightFields, class Centres>
WARPCAM_FN void trace_samples(Chunk<TYPES>& chunk, const NearShapes& list, Rays& waiting, const Meshes& meshes,
                              const HeightFields& fields, const Camera& camera, const Seen<LENS, Centres>& seen,
                              const Region& region)
{
    constexpr bool HAS_MESH = Chunk<TYPES>::HAS_MESH, HAS_FIELD = Chunk<TYPES>::HAS_FIELD;
    const int lane = threadIdx.x % LANES, words = (list.count + LANES - 1) / LANES;
    const float near = camera.near;
    const auto ray_of = [&](int sample) {
        const int pixel = sample / SAMPLES, at = chunk.place(pixel);
        const ViewRay<LENS> ray
            = sample_ray<LENS>(camera, region.left + at % 64, region.top + at / 64, sample % SAMPLES);
        return ClippedRay<LENS> { ray, HAS_MESH ? upper(near, chunk.meshes[HAS_MESH ? pixel : 0].first) : near };
    };
    const auto show = [&](int sample, const Hit& hit) {
        const int at = chunk.place(sample / SAMPLES), i = region.left + at % 64, j = region.top + at / 64;
        const int its = sample % SAMPLES;
        const int ground = HAS_FIELD ? chunk.ground[HAS_FIELD ? sample / SAMPLES : 0] : NEAR_SHAPES;
        chunk.shown[sample] = static_cast<unsigned char>(
            hit.shape < 0 ? seen.nearest(i, j, its, ground < NEAR_SHAPES ? list.records[ground].origin.w : -1)
                          : shown_sample<TYPES, IMAGES>(seen, meshes, camera, i, j, its, hit.depth, hit.face,
                                                        list.records[hit.shape], chunk.pixels[sample / SAMPLES].edge()));
    };
    // where there are meshes, which pixel shows a sample is asked when all have been traced: for all of them at once
    const auto store = [&](int sample, const Hit& hit) {
        if constexpr (HAS_MESH) {
            chunk.hits[sample] = { hit.depth, hit.face };
            chunk.shown[sample] = static_cast<unsigned char>(hit.shape < 0 ? NEAR_SHAPES : hit.shape);
        } else {
            show(sample, hit);
        }
    };
    const auto next_rays = [&](int& found) {
        const int first = __shfl_sync(ALL, lane == 0 ? atomicAdd(&chunk.next, LANES) : 0, 0);
        const int total = chunk.total();
        if (first >= total)
            return false;
        const bool active = first + lane < total;
        const int sample = chunk.sample(active ? first + lane : first), pixel = sample / SAMPLES;
        const auto ray = ray_of(sample);
        Hit hit { camera.far, -1, -1 };
        NearBits around, met {};
#pragma unroll
        for (int w = 0; w < NEAR_WORDS; ++w) {
            around[w] = active ? chunk.own[pixel][w] : 0;
            if (w < words)
                trace_own<TYPES, LENS>(list.records + w * LANES, bits_of_all(around[w]) & ~list.meshes[w], around[w],
                                       ray, near, fields, chunk.fields[HAS_FIELD ? pixel : 0], hit);
        }
        if (active)
            store(sample, hit);
        if constexpr (HAS_MESH) {
            const float until = lower(hit.depth, chunk.meshes[pixel].last);
            bool meets = false;
#pragma unroll
            for (int w = 0; w < NEAR_WORDS; ++w) {
                met[w] = around[w] & list.meshes[w];
                meets |= met[w] != 0;
            }
            const unsigned meeting = __ballot_sync(ALL, meets);
            const int at = waiting.put(meeting, met, words, sample);
            if (meets)
                waiting.depth[at] = until;
            __syncwarp();
            found = __popc(meeting);
        }
        return true;
    };
    if constexpr (HAS_MESH) {
        trace_rays<TYPES>(waiting, Ranked { list.records, {}, list.count }, meshes, near, next_rays, ray_of, store);
        block_barrier();
        for (int k = threadIdx.x; k < chunk.total(); k += THREADS) {
            const int sample = chunk.sample(k), shape = chunk.shown[sample];
            show(sample, Hit { chunk.hits[sample].depth, shape < NEAR_SHAPES ? shape : -1, chunk.hits[sample].face });
        }
    } else {
        int none;
        while (next_rays(none)) { }
    }
}

// Means of pixels that wait until nobody reads what they showed before, where images are smoothed in place: those of a band's
// last row until the next band is done.
struct Waiting {
    unsigned means[64];
    unsigned short places[64];
    int count;
};

// What a pixel's samples show, beside its place, in the bits of a ListedPixel whose samples have been traced.
WARPCAM_FN unsigned shown_bits(int place, const unsigned char (&shown)[SAMPLES])
{
    unsigned bits = unsigned(place) << 4 * SAMPLES;
    for (int sample = 0; sample < SAMPLES; ++sample)
        bits |= unsigned(shown[sample]) << 4 * sample;
    return bits;
}

// Writes the means of these pixels; `means` has room for them. The band ends where the row `end` begins, and is the last
// of the region if `last`. With barriers.
template <int IMAGES, int LENS, class Bits, class Centres>
WARPCAM_FN void put_in_place(const Bits* listed, int count, unsigned* means, Waiting& waiting, int end, bool last,
                             const Seen<LENS, Centres>& seen, const Region& region)
{
    const auto& target = seen.centres.target;
    const auto index = [&](unsigned place) {
        return seen.centres.of_images(region.left + int(place % 64), region.top + int(place / 64));
    };
#pragma unroll 1
    for (int k = threadIdx.x; k < count; k += THREADS) {
        const unsigned bits = listed[k].bits, place = bits >> 4 * SAMPLES;
        unsigned by[SAMPLES];
        for (int sample = 0; sample < SAMPLES; ++sample)
            by[sample] = seen.around(region.left + int(place % 64), region.top + int(place / 64),
                                     int(bits >> 4 * sample & 15));
        means[k] = mean_bytes<IMAGES>(seen.centres, by);
    }
    block_barrier();
#pragma unroll 1
    for (int k = threadIdx.x; k < waiting.count; k += THREADS)
        put_bytes<IMAGES>(target, index(waiting.places[k]), waiting.means[k]);
    block_barrier();
    if (threadIdx.x == 0)
        waiting.count = 0;
    block_barrier();
#pragma unroll 1
    for (int k = threadIdx.x; k < count; k += THREADS) {
        const unsigned place = listed[k].bits >> 4 * SAMPLES;
        if (!last && int(place / 64) == end - 1) {
            const int at = atomicAdd(&waiting.count, 1);
            waiting.places[at] = static_cast<unsigned short>(place);
            waiting.means[at] = means[k];
        } else {
            put_bytes<IMAGES>(target, index(place), means[k]);
        }
    }
    block_barrier();
}

// Smooths the edges of a region; IN_PLACE: which is a whole image, whose colours are where the means go.
template <int TYPES, int LENS, int IMAGES, bool IN_PLACE, class Shapes, class Meshes, class HeightFields, class Centres>
WARPCAM_FN void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Centres& centres, const Camera& camera, const Region& region, int world)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1;
    constexpr int WARPS = THREADS / LANES;
    constexpr int MOST_LISTED = IN_PLACE ? LISTED_IN_PLACE : LISTED;
    WARPCAM_SHARED ListedPixel<TYPES> listed[MOST_LISTED];
    WARPCAM_SHARED Waiting means_waiting;
    WARPCAM_SHARED int count;
    WARPCAM_SHARED Chunk<TYPES> chunk;
    WARPCAM_SHARED NearShapes list;
    WARPCAM_SHARED AnyMeshRays<NEAR_WORDS> waiting[HAS_MESH ? WARPS : 1];
    const Seen<LENS, Centres> seen { centres, pixel_width<LENS>(camera), camera.scale_y };
    const auto& target = centres.target;
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    const auto sided = [&](int shape) { return has_sides<TYPES>(shapes, shape); };
    const auto has_room = [](const int& listed) {
        return __any_sync(ALL, *static_cast<const volatile int*>(&listed) <= MOST_LISTED - THREADS);
    };
    const int across = region.width / TILE_WIDTH, tiles = across * (region.height / TILE_HEIGHT);
    static_assert(64 / TILE_WIDTH * (64 / TILE_HEIGHT) <= LANES * WARPS, "a bit for each of a warp's tiles");
    unsigned left = tiles_with_shapes(target, centres.first, region, across, tiles);
    left &= tiles <= warp ? 0 : ~0u >> (LANES - (tiles - warp + WARPS - 1) / WARPS);
    // In place all edges are looked for before any pixel is written, or, if there are too many, band after band.
    const unsigned whole = left;
    const int rows = region.height / TILE_HEIGHT;
    int band_end = rows;
    const auto of_band = [&] {
        unsigned its = 0;
#pragma unroll 1
        for (int k = 0; k < LANES; ++k) {
            const int row = (warp + k * WARPS) / across;
            its |= unsigned(row < band_end && row >= band_end - BAND) << k;
        }
        return whole & its;
    };
    if (IN_PLACE && threadIdx.x == 0)
        means_waiting.count = 0;
    for (bool more = true; more;) {
        if (threadIdx.x == 0)
            count = 0;
        block_barrier();
        for (; left && has_room(count); left &= left - 1) {
            // a warp's tiles lie aslant: what is upright is everyone's
            const int tile = warp + lowest_bit(left) * WARPS, row = tile / across, column = (tile + row) % across;
            const int i = region.left + column * TILE_WIDTH + lane % TILE_WIDTH;
            const int j = region.top + row * TILE_HEIGHT + lane / TILE_WIDTH;
            const bool inside = i < target.width && j < target.height;
            const unsigned samples = inside ? seen.template edge<IMAGES>(i, j, sided) : 0;
            const unsigned found = __ballot_sync(ALL, samples != 0);
            if (found) {
                const int begin = __shfl_sync(ALL, lane == 0 ? atomicAdd(&count, __popc(found)) : 0, 0);
                if (samples)
                    listed[begin + __popc(found & ((1u << lane) - 1))]
                        = { static_cast<decltype(listed->bits)>(place_of(region, i, j) << listed->SHIFT | samples) };
            }
        }
        more = __syncthreads_or(left != 0);
        if constexpr (IN_PLACE) {
            if (more) {
                band_end = BAND;
                left = of_band();
                continue;
            }
        }
        const int found_so_far = count;
        const int chunks = (found_so_far + chunk.MOST - 1) / chunk.MOST;
        for (int from = 0, pixels; from < found_so_far; from += pixels) {
            pixels = lower_int(found_so_far - from, (found_so_far + chunks - 1) / chunks);
            while (true) {  // fewer, until they do not show too many shapes
                list.clear();
                block_barrier();
                for (int k = threadIdx.x; k < pixels; k += THREADS) {
                    const int at = listed[from + k].place(), i = region.left + at % 64, j = region.top + at / 64;
                    int before = -1;
#pragma unroll 1
                    for (int around = 0; around < 9; ++around) {
                        const int id = seen.shape(seen.around(i, j, around));
                        if (id >= 0 && id != before)
                            list.add(id);
                        before = id;
                    }
                }
                block_barrier();
                if (list.count <= NEAR_SHAPES)
                    break;
                pixels = (pixels + 1) / 2;
                block_barrier();
            }
            if (threadIdx.x == 0) {
                chunk.pixels = listed + from;
                chunk.before = chunk.after = chunk.next = 0;
            }
            list.template prepare_all<TYPES, LENS>(shapes, meshes, fields, camera, region, world);
            for (int k = threadIdx.x; k < pixels; k += THREADS)
                list_samples<TYPES, LENS>(chunk, k, list, camera, seen, region);
            block_barrier();
            trace_samples<TYPES, LENS, IMAGES>(chunk, list, waiting[HAS_MESH ? warp : 0], meshes, fields, camera, seen,
                                               region);
            block_barrier();
            for (int k = threadIdx.x; k < pixels; k += THREADS) {
                const int at = chunk.place(k), i = region.left + at % 64, j = region.top + at / 64;
                if constexpr (IN_PLACE) {
                    const unsigned char(&shown)[SAMPLES]
                        = *reinterpret_cast<const unsigned char(*)[SAMPLES]>(chunk.shown + SAMPLES * k);
                    listed[from + k].bits = shown_bits(at, shown);
                    continue;
                }
                unsigned by[SAMPLES];
                for (int sample = 0; sample < SAMPLES; ++sample)
                    by[sample] = seen.around(i, j, chunk.shown[SAMPLES * k + sample]);
                put_means<IMAGES>(seen.centres, seen.centres.of_images(i, j), by);
            }
            block_barrier();
        }
        if constexpr (IN_PLACE) {
            static_assert(HAS_MESH && sizeof(chunk.hits) >= MOST_LISTED * sizeof(unsigned), "hits have room for means");
            put_in_place<IMAGES, LENS>(listed, found_so_far, reinterpret_cast<unsigned*>(chunk.hits), means_waiting,
                                       band_end * TILE_HEIGHT, band_end >= rows, seen, region);
            if (band_end < rows) {
                band_end = lower_int(band_end + BAND, rows);
                left = of_band();
                more = true;
            }
        }
    }
}

// The same, before there is a barrier after which `camera` is there. What the trace has found is kept in shared memory where
// little else has to lie there.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool IN_PLACE, class Shapes, class Meshes,
          class HeightFields, class Target>
WARPCAM_FN void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Target& target, const Camera& camera, const Region& region, int world)
{
    if constexpr (TYPES >> MESH & 1 || TYPES >> HEIGHT_FIELD & 1) {
        const ImageCentres<Target> centres { target, unsigned(world) * target.height * target.width };
        block_barrier();
        smooth_region<TYPES, LENS, IMAGES, IN_PLACE>(shapes, meshes, fields, centres, camera, region, world);
    } else {
        static_assert(HEIGHT <= 32, "a ListedPixel has 16 bits");
        WARPCAM_SHARED CentresRoom<Target, IMAGES, WIDTH, HEIGHT> room;
        using Kept = KeptCentres<Target, IMAGES, WIDTH, HEIGHT>;
        const Kept kept { room, target, region.left - 1, region.top - 1,
                          unsigned(world) * target.height * target.width };
        if constexpr (sizeof(room.ids[0]) == 1) {
            WARPCAM_SHARED KeptEdges<WIDTH, HEIGHT> edges;
            using Smoother = KeptSmoother<TYPES, LENS, WIDTH, HEIGHT, IMAGES, Target>;
            Smoother::clear(edges, shapes);
            kept.load();
            const Seen<LENS, Kept> seen { kept, pixel_width<LENS>(camera), camera.scale_y };
            Smoother { edges, seen, camera, region }.smooth(shapes, meshes, fields, world);
        } else {
            kept.load();
            smooth_region<TYPES, LENS, IMAGES, false>(shapes, meshes, fields, kept, camera, region, world);
        }
    }
}

#endif

// Copies one region of one view, but IN_PLACE, and smooths its edges; `index` counts worlds, then regions, then (CUDA) threads of the block.
template <int TYPES, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool IN_PLACE, class Shapes, class Meshes,
          class HeightFields, class Views, class Target>
WARPCAM_FN void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Views& views,
                       const Target& target, int index)
{
    alignas(16) WARPCAM_SHARED Camera camera;
    int world;
    const Region region = region_of<WIDTH, HEIGHT>(target, index / THREADS, world);
    if (!wp::index(target.mask, world))
        return;
    if (index % THREADS == 0)
        camera = load_camera(wp::index(views, world));
    if (!IN_PLACE)
        copy_lit<IMAGES>(target, region, size_t(world) * target.height * target.width);
    smooth_region<TYPES, LENS, WIDTH, HEIGHT, IMAGES, IN_PLACE>(shapes, meshes, fields, target, camera, region, world);
}

}  // namespace warpcam
