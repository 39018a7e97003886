// Shadows in scenes of many shapes, on CUDA. Most of these stand in the way of nothing that a region shows, and all but
// a few in the way of nothing that a patch of it shows: what casters cover is kept in two words each, patches pick
// theirs by it, and only what was picked is looked at closely.
#pragma once
#if !defined(__CUDA_ARCH__)
#include "shadow/many_casters_simd.h"
#else
#include "shadow/caster_bounds.h"
#include "shadow/shadow_pass.h"

namespace warpcam {

constexpr int PATCH = 8;       // pixels along a side; two tiles
constexpr int PICKED = WARP_SIZE;  // casters that a patch tries at a time
constexpr int WARPS = THREADS / WARP_SIZE;

// Request of one patch: a bit for each of its tiles that asks.
struct Patch {
    ReceiverBounds cover;
    int tiles;
};

template <int SIZE> struct CasterTiles {
    static constexpr int CAPACITY = SIZE;

    PackedCasterBounds outlines[CAPACITY];
    int count;
    int next_patch;
};

// Casters that one warp tests against a patch.
struct PickedCasters {
    CasterList<PICKED, false> list;
    int places[PICKED];  // among the shapes that are drawn
};

// Looks through the patches of a region.
template <int LENS, int WIDTH, int HEIGHT, class Target>
WARPCAM_DEVICE void survey(const LightPass<LENS>& task, const Target& target, Patch* patches, int warp, int lane)
{
    constexpr int ACROSS = WIDTH / PATCH, COUNT = ACROSS * (HEIGHT / PATCH);
    for (int patch = warp; patch < COUNT; patch += WARPS) {
        warp_sync();  // the task is read anew: in registers it would be spilled
        ReceiverBounds cover = no_cover();
        int tiles = 0;
        for (int tile = 0; tile < PATCH / TILE_HEIGHT; ++tile) {
            const int column = patch % ACROSS * PATCH + lane % TILE_WIDTH;
            const int row = patch / ACROSS * PATCH + tile * TILE_HEIGHT + lane / TILE_WIDTH;
            const Asking a = asking_at(task, target, column, row);
            if (a.asks)
                cover.add(a.place);
            tiles |= int(__any_sync(FULL_WARP, a.asks)) << tile;
        }
        if (tiles)
            cover = joined(cover);
        if (lane == 0)
            patches[patch] = { cover, tiles };
    }
}

// Adds the outlines of shapes from `begin` on that may shade something in the region, until there is no more room;
// returns where to go on.
template <class Types, class CasterList_, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_DEVICE int gather_outlines(CasterList_& caster_list, int begin, const Shapes& shapes,
                                   const Materials& materials, const Meshes& meshes, const HeightFields& fields,
                                   const LightView& light, const Camera& camera, const ReceiverBounds& all,
                                   const Grid& grid, int world, int thread)
{
    const int total = shapes.drawn.shape[0];
    while (begin < total) {
        const int i = begin + thread;
        begin += THREADS;
        if (i < total) {
            Caster caster;
            const int id = wp::index(shapes.drawn, i);
            if (prepare_caster<Types>(load_shape(shapes, world, id), light, camera, meshes, fields, caster)
                && (grid.endless || may_occlude(caster.bounds_uv, caster.height, all.bounds_uv, all.floor))
                && !transparent(shapes, materials, world, id)) {
                const int slot = atomic_append(caster_list.count);
                caster_list.outlines[slot] = grid.of_shape(caster.bounds_uv, caster.height, i);
            }
        }
        if (total > CasterList_::CAPACITY) {  // the next round may be too much
            block_sync();
            const bool full = caster_list.count + min(THREADS, total - begin) > CasterList_::CAPACITY;
            block_sync();
            if (full)
                break;
        }
    }
    block_sync();
    return begin;
}

// Picks casters that may shade a patch from outline `from` on, as many as are tried at a time; where to go on.
template <class CasterList_> WARPCAM_DEVICE int pick(const CasterList_& caster_list, const PackedCasterBounds& points,
                                                     int from, int* places, int& picked, int lane)
{
    picked = 0;
    while (from < caster_list.count) {
        const int slot = from + lane;
        const PackedCasterBounds outline = caster_list.outlines[min(slot, caster_list.count - 1)];
        bool mine = slot < caster_list.count && may_occlude(outline, points);
        const unsigned found = __ballot_sync(FULL_WARP, mine);
        const int rank = picked + __popc(found & ((1u << lane) - 1u));
        mine = mine && rank < PICKED;
        if (mine)
            places[rank] = int(outline.rest & ((1u << PLACE_BITS) - 1u));
        picked += __popc(found);
        if (picked > PICKED) {
            picked = PICKED;
            return from + WARP_SIZE - __clz(__ballot_sync(FULL_WARP, mine));  // after the last that there was room for
        }
        from += WARP_SIZE;
    }
    return from;
}

template <class Types, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_DEVICE void prepare_picks(PickedCasters& picks, int picked, const Shapes& shapes, const Materials& materials,
                                  const Meshes& meshes, const HeightFields& fields, const LightView& light,
                                  const Camera& camera, int world, int lane)
{
    auto& list = picks.list;
    if (lane == 0)
        list.count = picked;
    for (int slot = lane; slot < picked; slot += WARP_SIZE) {
        Caster caster;
        const int id = wp::index(shapes.drawn, picks.places[slot]);
        prepare_caster<Types>(load_shape(shapes, world, id), light, camera, meshes, fields, caster);
        list.records[slot] = caster.record;
        list.aims[slot] = caster.aim;
        mark_glass<Types>(list.aims[slot], caster.record, shapes, materials, world, id);
        list.bounds_uv[slot] = caster.bounds_uv;
        list.heights[slot] = caster.height;
    }
}

// True if a caster stands between a lane's point and the light. Each lane tests the casters that its point calls for.
template <class Types, int LENS, class HeightFields>
WARPCAM_DEVICE bool is_shaded(const CasterList<PICKED, false>& list, const ReceiverView<LENS>& view, const Asking& a,
                              const HeightFields& fields)
{
    const bool distant = view.light.distant;
    unsigned mine = 0;
#pragma unroll 4
    for (int slot = 0; slot < list.count; ++slot)
        mine |= unsigned(may_occlude(list.bounds_uv[slot], list.heights[slot], a.place)) << slot;
    for (mine = a.asks ? mine : 0; mine; mine &= mine - 1) {
        const int slot = ctz(mine);
        const ShapeRecord& record = list.records[slot];
        if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD) {
            if (in_shade_of_field(fields, record, view.light, a.p, a.id, a.span))
                return true;
        } else {
            const Ray ray = look_back(record, list.aims[slot], a.p, distant);
            const float t = intersect_any<Types::ANALYTIC>(record, ray);
            if ((t > a.span.near) & (t < a.span.reach))
                return true;
            if constexpr (Types::has(TRANSPARENT_CASTERS)) {
                const float out = list.aims[slot].w ? intersect_exit_any<Types::ANALYTIC>(record, ray) : MISS;
                if ((out > thin_span(view.light, a.span).near) & (out < a.span.reach))
                    return true;
            }
        }
    }
    return false;
}

// Adds the light's bit to the masks of a tile's pixels that lie in the shadow of what was picked.
template <class Types, int LENS, class Shapes, class Meshes, class HeightFields, class Target>
WARPCAM_DEVICE void cast_tile(const CasterList<PICKED, false>& list, const LightPass<LENS>& task, const Shapes& shapes,
                              const Meshes& meshes, const HeightFields& fields, const Target& target, int column,
                              int row, int lane)
{
    const Asking a = asking_at(task, target, column + lane % TILE_WIDTH, row + lane / TILE_WIDTH);
    if (is_shaded<Types>(list, task.view, a, fields))
        target.shadow.data[a.at] |= static_cast<int>(task.bit);
}

// Casts the shadows of one light, as far as they come from many casters.
template <class Types, int LENS, int WIDTH, int HEIGHT, class CasterList_, class Shapes, class Materials, class Meshes,
          class HeightFields, class Target>
WARPCAM_DEVICE void cast_patches(CasterList_& caster_list, PickedCasters& picks, const Patch* patches, const Grid& grid,
                                 const LightPass<LENS>& task, const Camera& camera, const Shapes& shapes,
                                 const Materials& materials, const Meshes& meshes, const HeightFields& fields,
                                 const Target& target, int lane)
{
    constexpr int ACROSS = WIDTH / PATCH, COUNT = ACROSS * (HEIGHT / PATCH);
    while (true) {
        const int patch = __shfl_sync(FULL_WARP, lane == 0 ? draw_next(caster_list.next_patch) : 0, 0);
        if (patch >= COUNT)
            return;
        const int tiles = patches[patch].tiles;
        if (!tiles)
            continue;
        const PackedCasterBounds points = grid.of_points(patches[patch].cover);
        int from = 0;
        do {
            int picked;
            warp_sync();  // what was picked before is done with
            from = pick(caster_list, points, from, picks.places, picked, lane);
            if (picked == 0)
                break;
            warp_sync();
            prepare_picks<Types>(picks, picked, shapes, materials, meshes, fields, task.view.light, camera, task.world,
                                 lane);
            warp_sync();
            for (int tile = 0; tile < PATCH / TILE_HEIGHT; ++tile)
                if (tiles >> tile & 1)
                    cast_tile<Types>(picks.list, task, shapes, meshes, fields, target, patch % ACROSS * PATCH,
                                     patch / ACROSS * PATCH + tile * TILE_HEIGHT, lane);
        } while (from < caster_list.count);
    }
}

// Shadows in one region of one view, as cast() has them, of shapes without meshes.
template <class Types, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Materials, class Meshes,
          class HeightFields, class Lights, class Views, class Target>
WARPCAM_DEVICE void cast_many(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                              const HeightFields& fields, const Lights& lights, const Views& views,
                              const Target& target, int index)
{
    static_assert(!Types::has(MESH));
    WARPCAM_SHARED CasterTiles<CAPACITY> caster_list;
    WARPCAM_SHARED PickedCasters picks[WARPS];
    WARPCAM_SHARED Patch patches[WIDTH / PATCH * (HEIGHT / PATCH)];
    WARPCAM_SHARED ReceiverBounds all;
    // In shared memory, as in registers they would be spilled.
    WARPCAM_SHARED LightPass<LENS> task;
    WARPCAM_SHARED Camera camera;
    WARPCAM_SHARED Grid grid;
    const int thread = unsigned(index) % THREADS, block = index / THREADS;
    const int warp = thread / WARP_SIZE, lane = thread % WARP_SIZE;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(target.mask, world))
        return;
    const Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    const size_t corner = (size_t(world) * target.height + region.top) * target.width + region.left;
    for (int pixel = thread; pixel < WIDTH * HEIGHT; pixel += THREADS) {
        const int column = pixel % WIDTH, row = pixel / WIDTH;
        if (region.left + column < target.width && region.top + row < target.height)
            target.shadow.data[corner + size_t(row) * target.width + column] = 0;
    }

    const int total = shapes.drawn.shape[0], num_lights = lights.types.shape[1];
    ActiveLights active = active_lights(lights);
    for (int number = 0; number < num_lights; ++number) {
        const int place = active.next(lights, world, number);
        if (place < 0 || !casts(lights, world, number))
            continue;
        block_sync();  // what is kept for the block may still be in use
        if (thread == 0) {
            camera = load_camera(wp::index(views, world));
            task = {
                light_view<Types, LENS>(lights, camera, world, number), region, corner, world, 1u << place, false
            };
        }
        block_sync();
        survey<LENS, WIDTH, HEIGHT>(task, target, patches, warp, lane);
        block_sync();
        if (warp == 0) {
            ReceiverBounds sum = no_cover();
            for (int patch = lane; patch < WIDTH / PATCH * (HEIGHT / PATCH); patch += WARP_SIZE)
                sum.add(patches[patch].cover);
            sum = joined(sum);
            if (lane == 0) {
                all = sum;
                grid = grid_of(sum, task.view.light.distant);
            }
        }
        int begin = 0;
        do {
            if (thread == 0)
                caster_list.count = caster_list.next_patch = 0;
            block_sync();
            if (!all.any)
                break;
            begin = gather_outlines<Types>(caster_list, begin, shapes, materials, meshes, fields, task.view.light,
                                           camera, all, grid, world, thread);
            if (caster_list.count > 0)
                cast_patches<Types, LENS, WIDTH, HEIGHT>(caster_list, picks[warp], patches, grid, task, camera, shapes,
                                                         materials, meshes, fields, target, lane);
            if (begin < total)
                block_sync();  // the list is still in use
        } while (begin < total);
    }
}

}  // namespace warpcam
#endif
