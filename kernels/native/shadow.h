// Which lights reach what a view sees. Each pixel's hit point looks back at each light; the shapes that may stand
// between a tile's points and the light are picked once for the whole tile.
#pragma once
#include "mesh_shadows.h"

namespace warpcam {

template <class Lights> WARPCAM_FN bool casts(const Lights& lights, int world, int light)
{
    return shared_row(lights.active, world, light) && shared_row(lights.casts_shadow, world, light);
}

template <int LENS, class Lights>
WARPCAM_FN LitView<LENS> light_view(const Lights& lights, const Camera& camera, int world, int light)
{
    const bool distant = shared_row(lights.types, world, light) == 1;  // types.py, LIGHT_DIRECTIONAL
    const auto p = wp::index(lights.positions, world, light), d = wp::index(lights.directions, world, light);
    const auto ambient = shared_row(lights.ambient, world, light);
    return { make_light(distant, { p[0], p[1], p[2] }, { d[0], d[1], d[2] }, camera), sight_of<LENS>(camera),
             camera.origin, ambient[0] != 0.0f || ambient[1] != 0.0f || ambient[2] != 0.0f };
}

// A tile's first pixel, counted from its region's corner.
template <int WIDTH> WARPCAM_FN int tile_column(unsigned tile) { return tile % (WIDTH / TILE_WIDTH) * TILE_WIDTH; }
template <int WIDTH> WARPCAM_FN int tile_row(unsigned tile) { return tile / (WIDTH / TILE_WIDTH) * TILE_HEIGHT; }

// Casts the shadows of one light, as far as they come from the list's shapes, in one region. With `fresh` the masks are
// written; else they gain what is in shadow.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Meshes, class HeightFields,
          class Target>
WARPCAM_FN void cast_light(CasterList<CAPACITY>& list, const LitView<LENS>& view, unsigned bit, bool fresh,
                           const Region& region, int world, const Shapes& shapes, const Meshes& meshes,
                           const HeightFields& fields, const Target& target)
{
    constexpr unsigned tiles = WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT);
    constexpr bool HAS_MESH = TYPES >> MESH & 1;
    const Sight<LENS> lit = lit_sight(view.light, view.sight);
    const bool distant = view.light.distant;
    const size_t corner = (size_t(world) * target.height + region.top) * target.width + region.left;
#if defined(__CUDA_ARCH__)
    constexpr int WORDS = CasterList<CAPACITY>::WORDS;
    WARPCAM_SHARED ShadowRays<HAS_MESH ? WORDS : 1> rays;
    const int lane = threadIdx.x % LANES;
    const int wide = lower_int(target.width - region.left, WIDTH), high = lower_int(target.height - region.top, HEIGHT);
    float ceiling;
    const Window bounds = bounds_of(list, ceiling);
    bool more = true;  // tiles
    while (more) {
        if (HAS_MESH) {
            if (threadIdx.x == 0)
                rays.count = rays.next = 0;
            block_barrier();
        }
        while (!HAS_MESH || __all_sync(ALL, rays.has_room())) {
            const unsigned tile = __shfl_sync(ALL, lane == 0 ? draw_number(list.next_tile) : 0u, 0);
            if (tile >= tiles)
                break;
            const int column = tile_column<WIDTH>(tile) + lane % TILE_WIDTH;
            const int row = tile_row<WIDTH>(tile) + lane / TILE_WIDTH;
            const size_t at = corner + unsigned(row * target.width + column);
            const bool inside = (column < wide) & (row < high);
            const int id = inside ? target.shape.data[at] : -1;
            const float depth = inside ? target.depth.data[at] : 0.0f;
            const float i = float(region.left + column), j = float(region.top + row);
            const Place place = place_of(distant, lit.point(i, j, depth));
            const bool asks = id >= 0 && may_shade(bounds, ceiling, place);
            bool open = asks;
            if (__any_sync(ALL, asks)) {
                const Vec p = view.sight.point(i, j, depth);
                const Span span = span_of(view.light, view.origin, p, depth);
                unsigned met[WORDS];
                const bool met_any = shade_tile<TYPES>(list, view, p, span, place, open, fields, met);
                if (HAS_MESH) {
                    const bool keep = open && met_any
                        && (view.counts_behind
                            || faces_light(shapes, meshes, world, id, target.face.data[at], view.light, view.origin));
                    enqueue(rays, (list.count + 31) / 32, keep, met, row * 64 + column);
                }
            }
            const bool shaded = asks & !open;
            if (fresh && inside)
                target.shadow.data[at] = shaded ? static_cast<int>(bit) : 0;
            else if (shaded)
                target.shadow.data[at] |= static_cast<int>(bit);
        }
        more = false;
        if (HAS_MESH) {
            block_barrier();
            more = list.next_tile < int(tiles);
            const auto start = [&](int pixel, WorldRay& ray, Span& span) {
                const float depth = target.depth.data[corner + unsigned(pixel / 64 * target.width + pixel % 64)];
                const Vec p = view.sight.point(float(region.left + pixel % 64), float(region.top + pixel / 64), depth);
                span = span_of(view.light, view.origin, p, depth);
                ray = { p, ray_to(view.light, p) };
            };
            const auto shade = [&](int pixel) {
                target.shadow.data[corner + unsigned(pixel / 64 * target.width + pixel % 64)] |= static_cast<int>(bit);
            };
            if (rays.count > 0)
                cast_queue(rays, list, meshes, start, shade);
            block_barrier();
        }
    }
#else
    Points points;
    for (unsigned tile = 0; tile < tiles; ++tile) {
        size_t at[LANES];
        bool asks[LANES], any = false;
        for (int lane = 0; lane < LANES; ++lane) {
            const int column = tile_column<WIDTH>(tile) + lane % TILE_WIDTH;
            const int row = tile_row<WIDTH>(tile) + lane / TILE_WIDTH;
            const int i = region.left + column, j = region.top + row;
            const bool inside = i < target.width && j < target.height;
            at[lane] = corner + size_t(row) * target.width + column;
            if (fresh && inside)
                target.shadow.data[at[lane]] = 0;
            points.ids[lane] = inside ? target.shape.data[at[lane]] : -1;
            asks[lane] = points.ids[lane] >= 0 && !(target.shadow.data[at[lane]] & bit);
            any |= asks[lane];
            const float depth = asks[lane] ? target.depth.data[at[lane]] : 0.0f;
            const Vec p = view.sight.point(float(i), float(j), depth);
            const Span span = span_of(view.light, view.origin, p, depth);
            points.at[lane] = p;
            points.places[lane] = place_of(distant, lit.point(float(i), float(j), depth));
            points.near[lane] = span.near;
            points.reach[lane] = span.reach;
            points.faces[lane] = HAS_MESH && asks[lane] ? target.face.data[at[lane]] : 0;
            points.open[lane] = asks[lane];
        }
        if (!any)
            continue;
        shade_tile<TYPES>(list, view, world, shapes, meshes, fields, points);
        for (int lane = 0; lane < LANES; ++lane)
            if (asks[lane] && !points.open[lane])
                target.shadow.data[at[lane]] |= static_cast<int>(bit);
    }
#endif
}

// Shadows in one region of one view; the index runs as in draw(). The list is filled and used once for each light, and
// again as often as the scene's shapes need.
template <int TYPES, int LENS, int CAPACITY, int WIDTH, int HEIGHT, class Shapes, class Materials, class Meshes,
          class HeightFields, class Lights, class Views, class Target>
WARPCAM_FN void cast(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                     const HeightFields& fields, const Lights& lights, const Views& views, const Target& target,
                     int index)
{
    WARPCAM_SHARED CasterList<CAPACITY> list;
    WARPCAM_SHARED LitView<LENS> view;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(target.mask, world))
        return;
    const Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    const int total = shapes.drawn.shape[0], num_lights = lights.positions.shape[1];

    bool fresh = true;
    for (int number = 0; number < num_lights; ++number) {
        if (!casts(lights, world, number))
            continue;
        int begin = 0;
        do {
            block_barrier();  // the list may still be in use
            if (thread == 0)
                list.count = list.next_tile = 0;
            {
                const Camera camera = load_camera(wp::index(views, world));
                const LitView<LENS> own = light_view<LENS>(lights, camera, world, number);
                if (thread == 0)
                    view = own;
                block_barrier();
                begin = gather_casters<TYPES>(list, begin, shapes, materials, meshes, fields, own.light, camera, world,
                                              thread);
            }
            if (list.count > 0)
                cast_light<TYPES, LENS, CAPACITY, WIDTH, HEIGHT>(list, view, 1u << number, fresh, region, world, shapes,
                                                                 meshes, fields, target);
            fresh = fresh && list.count == 0;
        } while (begin < total);
    }
    if (fresh)  // nothing casts a shadow
        for (int pixel = thread; pixel < WIDTH * HEIGHT; pixel += THREADS) {
            const int i = region.left + pixel % WIDTH, j = region.top + pixel / WIDTH;
            if (i < target.width && j < target.height)
                target.shadow.data[(size_t(world) * target.height + j) * target.width + i] = 0;
        }
}

}  // namespace warpcam
