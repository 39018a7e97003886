// Looks of the shapes that a region shows: kept by its block, or made anew for a pixel.
#pragma once
#include "shading/shade_hit.h"

namespace warpcam {

template <class Types, class Wants, class Scene_>
WARPCAM_DEVICE ShapeAppearance<Types, Wants> load_appearance_for(const Scene_& scene, const Camera& camera, int world,
                                                                 int id)
{
    auto look = load_appearance<Types, Wants>(scene.shapes, scene.materials, physical_of(scene), scene.textures,
                                              scene.meshes, scene.fields, camera, scene.frame.horizon, world, id);
    if constexpr (Wants::DIMMED)
        dim(look.material, wp::index(scene.frame.mirrors, world).strength);
    load_shift(look, scene, world, id);
    return look;
}

// A look that was kept without what few shapes have a use for.
template <class EdgeTester, class Scene_>
WARPCAM_DEVICE auto completed(const EdgeTester& seen, int slot, const Scene_& scene, int world, int id)
{
    using Wants = typename EdgeTester::Wants;
    using Types = typename EdgeTester::Types;
    const auto& bare = seen.looks[slot];
    ShapeAppearance<Types, Wants> look;
    look.pose = bare.pose;
    look.material = bare.material;
    look.turn = bare.turn;
    bool more = Wants::MAPPED;
    if constexpr (Wants::TEXTURED) {
        look.layout.image.levels = 0;
        more |= bare.material.color.w >= 0;
    }
    if constexpr (Wants::GOURAUD && Types::has(PLANE)) {
        look.cells.u.step = 0.0f;
        more |= bare.pose.type() == PLANE;
    }
    if (more) {
        load_rest(look, scene.shapes, scene.materials, scene.textures, scene.meshes, scene.fields, scene.frame.horizon,
                  world, id);
        load_shift(look, scene, world, id);
    }
    return look;
}

// A shape's look, as it is kept or made anew.
template <class Types, int CAPACITY, class Wants, class Appearances, class List, class Scene_>
WARPCAM_DEVICE auto cached_appearance(const Appearances* looks, const List& lights, const Scene_& scene,
                                      const Camera& camera, int world, int id)
{
    if constexpr (CAPACITY > 0) {
        return looks[scene.shapes.places.data[id]];
    } else if constexpr (CAPACITY < 0) {
        using Own = typename Appearances::Wants;
        if constexpr (HasCorners<List>::VALUE)
            if (id == lights.grid.shape)
                return looks->plane;
        const int mark = Appearances::MARKED ? looks->marks[scene.shapes.places.data[id]] : 0;
        return mark > 0 ? completed(*looks, mark - 1, scene, world, id)
                        : load_appearance_for<Types, Own>(scene, camera, world, id);
    } else {
        return load_appearance_for<Types, Wants>(scene, camera, world, id);
    }
}

// The look of the plane whose corners are kept.
template <int CACHED, class Held, class Scene_>
WARPCAM_DEVICE const auto& plane_look(const Held* looks, const Scene_& scene, int plane)
{
    if constexpr (CACHED > 0)
        return looks[plane >= 0 ? wp::index(scene.shapes.places, plane) : 0];
    else
        return looks->plane;
}

#if defined(__CUDA_ARCH__)
// The pixel of a thread in one of a region's tiles, row after row.
template <int WIDTH, int FLAGS, class Frame_>
WARPCAM_DEVICE void seek_tile(Pixel& pixel, const Frame_& frame, unsigned first, int left, int top, unsigned tile)
{
    left += tile % (WIDTH / TILE_WIDTH) * TILE_WIDTH;
    top += tile / (WIDTH / TILE_WIDTH) * TILE_HEIGHT;
    pixel.column = left + unsigned(pixel.lane) % TILE_WIDTH;
    pixel.row = top + unsigned(pixel.lane) / TILE_WIDTH;
    pixel.width = frame.width - left;
    pixel.height = frame.height - top;
    pixel.at = first + pixel.row * frame.width + pixel.column;
    pixel.inside = (FLAGS & WHOLE_REGIONS) || (pixel.column < frame.width && pixel.row < frame.height);
}

// The plane that the most samples of a region show; the first plane where none do. For whole warps.
template <class Scene_>
WARPCAM_DEVICE int most_shown_plane(const Scene_& scene, const Region& region, unsigned first, int lane)
{
    const auto& frame = scene.frame;
    constexpr int EACH = SAMPLE_COLUMNS * SAMPLE_ROWS / WARP_SIZE;
    int ids[EACH];
    for (int k = 0; k < EACH; ++k) {
        const int sample = lane + k * WARP_SIZE, column = sample % SAMPLE_COLUMNS, row = sample / SAMPLE_COLUMNS;
        const int i = min(region.left + (2 * column + 1) * region.width / (2 * SAMPLE_COLUMNS), frame.width - 1);
        const int j = min(region.top + (2 * row + 1) * region.height / (2 * SAMPLE_ROWS), frame.height - 1);
        const int id = frame.shape.data[first + unsigned(j * frame.width + i)];
        ids[k] = id >= 0 && wp::index(scene.shapes.types, id) == PLANE ? id : -1;
    }
    int shown = frame.plane, most = 0;
#pragma unroll 1
    for (int trial = 0; trial < frame.planes; ++trial) {
        int last = -1, count = 0;
        for (int k = 0; k < EACH; ++k)
            last = max(last, ids[k]);
        last = warp_reduce_max(last);
        for (int k = 0; k < EACH; ++k) {
            count += ids[k] == last ? 1 : 0;
            ids[k] = ids[k] == last ? -1 : ids[k];
        }
        count = warp_reduce_add(count);
        if (last < 0)
            break;
        shown = count > most ? last : shown;
        most = max(most, count);
    }
    return shown;
}

// Keeps the looks of the shapes that a region shows. The threads of a block share the work.
template <int WIDTH, int HEIGHT, int FLAGS, int SIZE, class EdgeTester, class Scene_>
WARPCAM_DEVICE void gather_looks(EdgeTester& seen, const Scene_& scene, const Camera& camera, int world, unsigned first,
                                 int left, int top, int thread)
{
    const int total = scene.shapes.drawn.shape[0];
    for (int place = thread; place < total; place += THREADS)
        seen.marks[place] = 0;
    if (thread == 0)
        seen.count = 0;
    block_sync();
    Pixel pixel;
    pixel.lane = thread % WARP_SIZE;
#pragma unroll 1
    for (unsigned tile = unsigned(thread) / WARP_SIZE; tile < WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT);
         tile += THREADS / WARP_SIZE) {
        seek_tile<WIDTH, FLAGS>(pixel, scene.frame, first, left, top, tile);
        const int id = pixel.inside ? scene.frame.shape.data[pixel.at] : -1;
        if (id >= 0 && id != scene.frame.plane)
            seen.marks[scene.shapes.places.data[id]] = 1;
    }
    block_sync();
#pragma unroll 1
    for (int place = thread; place < total; place += THREADS) {
        if (!seen.marks[place])
            continue;
        const int slot = atomicAdd(&seen.count, 1);
        seen.marks[place] = slot < SIZE ? slot + 1 : 0;
        if (slot < SIZE)
            seen.looks[slot] = load_appearance_for<typename EdgeTester::Types, Untextured<typename EdgeTester::Wants>>(
                scene, camera, world, wp::index(scene.shapes.drawn, place));
    }
}
#endif

}  // namespace warpcam
