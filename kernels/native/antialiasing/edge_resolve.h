// Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.
//
// A block looks for edges in one region until it has a few hundred pixels. What their samples may hit are the shapes
// that are seen in the pixels around, of which it makes the records once; nothing else is traced, nor are samples on a
// side where there is no edge. Its warps take 32 samples at a time, as long as there are any: a ray that takes long
// holds up no others. A sample has the colour of the nearest pixel that shows the same surface: nothing is lit anew,
// whatever made the image.
#pragma once
#include "antialiasing/pixel_cache.h"
#include "antialiasing/occupied_tiles.h"
#include "antialiasing/sample_batch.h"
#include "antialiasing/edge_resolve_simd.h"
#include "antialiasing/edge_resolve_in_place.h"
#include "antialiasing/edge_resolve_analytic.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// Pixels with edges that a block lists before it traces. A warp lists up to 32 after it has seen that there is room.
constexpr int LISTED = 896;

// Tiles across a region; for cached regions the compiler knows the number, and partial tiles count.
template <class Centres> WARPCAM_DEVICE int tiles_across(const Region& region)
{
    if constexpr (Centres::PLACED)
        return Centres::WIDTH / TILE_WIDTH;
    return region.width / TILE_WIDTH;
}

// Smooths the edges of a region; IN_PLACE: which is a whole image, whose colours are where the means go.
template <class Types, int LENS, int IMAGES, bool IN_PLACE, class Shapes, class Meshes, class HeightFields,
          class Centres>
WARPCAM_DEVICE void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                                  const Centres& centres, const Camera& camera, const Region& region, int world)
{
    constexpr bool HAS_MESH = Types::has(MESH);
    constexpr int WARPS = THREADS / WARP_SIZE;
    constexpr int MOST_LISTED = IN_PLACE ? LISTED_IN_PLACE : LISTED;
    WARPCAM_SHARED ListedPixel<Types> listed[MOST_LISTED];
    WARPCAM_SHARED Waiting means_waiting;
    WARPCAM_SHARED int count;
    WARPCAM_SHARED SampleBatch<Types> batch;
    WARPCAM_SHARED NearShapes list;
    WARPCAM_SHARED AnyMeshRays<NEAR_WORDS> waiting[HAS_MESH ? WARPS : 1];
    bool ahead = false;  // whether all shapes that the image shows are listed before its edges are known
    if constexpr (Centres::PLACED) {
        list.clear();
        block_sync();
        centres.list(list);
        block_sync();
        ahead = list.count <= NEAR_SHAPES;
        if (!ahead)
            block_sync();
    }
    const EdgeTester<LENS, Centres> seen { centres, pixel_width<LENS>(camera), camera.scale_y };
    const auto& target = centres.target;
    const int lane = threadIdx.x % WARP_SIZE, warp = threadIdx.x / WARP_SIZE;
    const auto sided = [&](int shape) { return has_sides<Types>(shapes, shape); };
    const auto has_room = [](const int& listed) {
        return __any_sync(FULL_WARP, *static_cast<const volatile int*>(&listed) <= MOST_LISTED - THREADS);
    };
    const int across = tiles_across<Centres>(region);
    const int tiles = across * (region.height / TILE_HEIGHT);
    static_assert(64 / TILE_WIDTH * (64 / TILE_HEIGHT) <= WARP_SIZE * WARPS, "a bit for each of a warp's tiles");
    unsigned left = tiles_with_shapes(centres, region, across, tiles);
    left &= tiles <= warp ? 0 : ~0u >> (WARP_SIZE - (tiles - warp + WARPS - 1) / WARPS);
    // In place all edges are looked for before a pixel is written or, if they are too many, those of a band of rows of
    // tiles: of these no pixel but the last row's is seen by the next band's.
    const unsigned whole = left;
    bool in_bands = false;
    const int rows = region.height / TILE_HEIGHT;
    int band_end = rows;
    const auto next_band = [&](int begin) {
        in_bands = true;
        band_end = min(begin + BAND, rows);
        unsigned its = 0;
#pragma unroll 1
        for (int k = 0; k < WARP_SIZE; ++k) {
            const int row = (warp + k * WARPS) / across;
            its |= unsigned(row >= begin && row < band_end) << k;
        }
        return whole & its;
    };
    if (IN_PLACE && threadIdx.x == 0)
        means_waiting.count = 0;
    for (bool more = true; more;) {
        if (threadIdx.x == 0)
            count = 0;
        if (!ahead)
            list.clear();
        block_sync();
        for (; left && has_room(count); left &= left - 1) {
            // a warp's tiles lie aslant: what is upright is everyone's
            const int tile = warp + ctz(left) * WARPS, row = tile / across, column = (tile + row) % across;
            const int i = region.left + column * TILE_WIDTH + lane % TILE_WIDTH;
            const int j = region.top + row * TILE_HEIGHT + lane / TILE_WIDTH;
            const bool inside = i < target.width && j < target.height;
            const unsigned samples = inside ? seen.template edge<IMAGES>(i, j, sided) : 0;
            const unsigned found = __ballot_sync(FULL_WARP, samples != 0);
            if (found) {
                const int begin = __shfl_sync(FULL_WARP, lane == 0 ? atomicAdd(&count, __popc(found)) : 0, 0);
                if (samples)
                    listed[begin + __popc(found & ((1u << lane) - 1))] = { static_cast<decltype(listed->bits)>(
                        place_of(region, i, j) << listed->SHIFT | samples) };
            }
        }
        more = __syncthreads_or(left != 0);
        if constexpr (IN_PLACE) {
            if (more) {
                left = next_band(0);
                continue;
            }
        }
        const int found_so_far = count;
        const int batches = (found_so_far + batch.MOST - 1) / batch.MOST;
        for (int from = 0, pixels; from < found_so_far; from += pixels) {
            pixels = min(found_so_far - from, (found_so_far + batches - 1) / batches);
            while (!ahead) {  // fewer, until they do not show too many shapes
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
                block_sync();
                if (list.count <= NEAR_SHAPES)
                    break;
                pixels = (pixels + 1) / 2;
                block_sync();
                list.clear();
                block_sync();
            }
            if (threadIdx.x == 0) {
                batch.pixels = listed + from;
                batch.before = batch.after = batch.next = 0;
            }
            if (!ahead || from == 0)
                list.template prepare_all<Types, LENS>(shapes, meshes, fields, camera, region, world);
            else
                block_sync();
            for (int k = threadIdx.x; k < pixels; k += THREADS)
                list_samples<Types, LENS>(batch, k, list, camera, seen, region);
            block_sync();
            trace_samples<Types, LENS, IMAGES>(batch, list, waiting[HAS_MESH ? warp : 0], meshes, fields, camera, seen,
                                               region);
            block_sync();
            for (int k = threadIdx.x; k < pixels; k += THREADS) {
                const int at = batch.place(k), i = region.left + at % 64, j = region.top + at / 64;
                if constexpr (IN_PLACE) {
                    const unsigned char (&shown)[SAMPLES] =
                        *reinterpret_cast<const unsigned char (*)[SAMPLES]>(batch.shown + SAMPLES * k);
                    listed[from + k].bits = shown_bits(at, shown);
                    continue;
                }
                unsigned by[SAMPLES];
                for (int sample = 0; sample < SAMPLES; ++sample)
                    by[sample] = seen.around(i, j, batch.shown[SAMPLES * k + sample]);
                put_means<IMAGES>(seen.centres, seen.centres.of_images(i, j), by);
            }
            if (IN_PLACE && pixels == found_so_far)
                break;  // each thread goes on with the pixels that it has just done
            if (!ahead)
                list.clear();
            block_sync();
        }
        if constexpr (IN_PLACE) {
            static_assert(HAS_MESH && sizeof(batch.hits) >= MOST_LISTED * sizeof(unsigned), "hits have room for means");
            put_in_place<IMAGES, LENS>(listed, found_so_far, reinterpret_cast<unsigned*>(batch.hits), means_waiting,
                                       in_bands ? band_end * TILE_HEIGHT : 0, band_end >= rows, seen, region);
            if (band_end < rows) {
                left = next_band(band_end);
                more = true;
            }
        }
    }
}

// Resolves edges likewise, before the barrier after which `camera` is valid. Trace results stay in shared memory where
// it has room for them.
template <class Types, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool BY_WORDS, bool IN_PLACE, class Shapes,
          class Meshes, class HeightFields, class Target>
WARPCAM_DEVICE void smooth_region(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                                  const Target& target, const Camera& camera, const Region& region, int world)
{
    const unsigned first = unsigned(world) * target.height * target.width;  // of the view's pixels
    using Placed = PlacedCentres<Target, WIDTH, HEIGHT, IN_PLACE>;
    if constexpr (BY_WORDS && Placed::Ids::FIT) {
        WARPCAM_SHARED typename Placed::Ids ids;
        ids.load(target, region, first);
        const Placed centres { ids, target, region.left - ids.ASIDE, region.top - 1, first };
        smooth_region<Types, LENS, IMAGES, IN_PLACE>(shapes, meshes, fields, centres, camera, region, world);
    } else if constexpr (Types::has(MESH) || Types::has(HEIGHT_FIELD)) {
        const PixelSource<Target> centres { target, first };
        block_sync();
        smooth_region<Types, LENS, IMAGES, IN_PLACE>(shapes, meshes, fields, centres, camera, region, world);
    } else {
        static_assert(HEIGHT <= 32, "a ListedPixel has 16 bits");
        WARPCAM_SHARED CentresRoom<Target, IMAGES, WIDTH, HEIGHT> room;
        using Cache = PixelCache<Target, IMAGES, WIDTH, HEIGHT>;
        const Cache cache { room, target, region.left - 1, region.top - 1, first };
        if constexpr (sizeof(room.ids[0]) == 1) {
            WARPCAM_SHARED CachedEdges<WIDTH, HEIGHT> edges;
            using EdgeResolver = CachedEdgeResolver<Types, LENS, WIDTH, HEIGHT, IMAGES, Target>;
            EdgeResolver::clear(edges, shapes);
            cache.load();
            const EdgeTester<LENS, Cache> seen { cache, pixel_width<LENS>(camera), camera.scale_y };
            EdgeResolver { edges, seen, camera, region }.smooth(shapes, meshes, fields, world);
        } else {
            cache.load();
            smooth_region<Types, LENS, IMAGES, false>(shapes, meshes, fields, cache, camera, region, world);
        }
    }
}

#endif

// Copies one region of one view, but IN_PLACE, and smooths its edges; `index` counts worlds, then regions, then (CUDA)
// threads of the block.
template <class Types, int LENS, int WIDTH, int HEIGHT, int IMAGES, bool BY_WORDS, bool IN_PLACE, class Shapes,
          class Meshes, class HeightFields, class Views, class Target>
WARPCAM_DEVICE void smooth(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Views& views,
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
    smooth_region<Types, LENS, WIDTH, HEIGHT, IMAGES, BY_WORDS, IN_PLACE>(shapes, meshes, fields, target, camera,
                                                                          region, world);
}

}  // namespace warpcam
