// Which lights reach what a view sees. Each pixel's hit point looks back at each light; the shapes that may stand
// between a tile's points and the light are picked once for the whole tile.
#pragma once
#include "shade_tile.h"

namespace warpcam {

template <class Lights> WARPCAM_FN bool casts(const Lights& lights, int world, int light)
{
    return shared_row(lights.active, world, light) && shared_row(lights.casts_shadow, world, light);
}

template <class Lights>
WARPCAM_FN Light load_light(const Lights& lights, const Camera& camera, int world, int light)
{
    const bool distant = shared_row(lights.types, world, light) == 1;  // types.py, LIGHT_DIRECTIONAL
    const auto p = wp::index(lights.positions, world, light), d = wp::index(lights.directions, world, light);
    return make_light(distant, { p[0], p[1], p[2] }, { d[0], d[1], d[2] }, camera);
}

// Does the light reach a surface's back too? Its ambient part does.
template <class Lights> WARPCAM_FN bool has_ambient(const Lights& lights, int world, int light)
{
    const auto ambient = shared_row(lights.ambient, world, light);
    return ambient[0] != 0.0f || ambient[1] != 0.0f || ambient[2] != 0.0f;
}

// What the camera sees through (x, y) of its image, from the camera, along the world's axes.
WARPCAM_FN Vec hit_point(const Camera& camera, int lens, float x, float y, float depth)
{
    const float reach = lens == ORTHOGRAPHIC ? 1.0f : depth;
    const Matrix& r = camera.rotation;
    const float a = x * reach, b = y * reach;
    return { r.at[0][0] * a + r.at[0][1] * b - r.at[0][2] * depth,
             r.at[1][0] * a + r.at[1][1] * b - r.at[1][2] * depth,
             r.at[2][0] * a + r.at[2][1] * b - r.at[2][2] * depth };
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
    constexpr bool HAS_FACES = TYPES >> MESH & 1;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(target.mask, world))
        return;
    const Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    const Camera camera = load_camera(wp::index(views, world));
    constexpr int across = WIDTH / TILE_WIDTH, tiles = across * (HEIGHT / TILE_HEIGHT);
    const int total = shapes.drawn.shape[0], num_lights = lights.positions.shape[1];

    bool first = true;
    for (int index_of_light = 0; index_of_light <= num_lights; ++index_of_light) {
        const bool none = index_of_light == num_lights;  // no light casts shadows: the masks are still to be cleared
        if (none ? !first : !casts(lights, world, index_of_light))
            continue;
        const Light light = none ? Light {} : load_light(lights, camera, world, index_of_light);
        const bool backs = !none && has_ambient(lights, world, index_of_light);
        const unsigned bit = none ? 0u : 1u << index_of_light;
        for (int begin = 0; first || begin < total;) {
            block_barrier();
            if (thread == 0) {
                list.count = 0;
                list.next_tile = 0;
            }
            block_barrier();
            begin = none ? total
                         : gather_casters<TYPES>(list, begin, shapes, materials, meshes, fields, light, camera, world,
                                                 thread);
            block_barrier();
            if (list.count == 0 && !first)
                continue;
#if defined(__CUDA_ARCH__)
            const int lane = thread % LANES;
            while (true) {
                int tile = 0;
                if (lane == 0)
                    tile = atomicAdd(&list.next_tile, 1);
                tile = __shfl_sync(0xffffffffu, tile, 0);
                if (tile >= tiles)
                    break;
                const int i = region.left + tile % across * TILE_WIDTH + lane % TILE_WIDTH;
                const int j = region.top + tile / across * TILE_HEIGHT + lane / TILE_WIDTH;
                const size_t at = (size_t(world) * target.height + j) * target.width + i;
                const bool inside = i < target.width && j < target.height;
                const int id = inside && list.count > 0 ? target.shape.data[at] : -1;
                const unsigned before = !first && inside ? target.shadow.data[at] : 0u;
                const bool open = id >= 0 && !(before & bit);
                bool shaded = false;
                if (__any_sync(0xffffffffu, open)) {
                    const float depth = open ? target.depth.data[at] : 0.0f;
                    const int face = HAS_FACES && open ? target.face.data[at] : 0;
                    const Vec p = hit_point(camera, LENS, image_x(camera, float(i)), image_y(camera, float(j)), depth);
                    shaded = shade_tile<TYPES>(list, light, camera, p, depth, open, backs, world, id, face, shapes,
                                               meshes, fields);
                }
                if (inside && (first || shaded))
                    target.shadow.data[at] = static_cast<int>(shaded ? before | bit : before);
            }
#else
            for (int tile = 0; tile < tiles; ++tile) {
                Points points;
                size_t at[LANES];
                bool asked[LANES], any = false;
                const int left = region.left + tile % across * TILE_WIDTH;
                const int top = region.top + tile / across * TILE_HEIGHT;
                for (int lane = 0; lane < LANES; ++lane) {
                    const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
                    const bool inside = i < target.width && j < target.height;
                    at[lane] = (size_t(world) * target.height + j) * target.width + i;
                    if (first && inside)
                        target.shadow.data[at[lane]] = 0;
                    points.ids[lane] = inside && list.count > 0 ? target.shape.data[at[lane]] : -1;
                    asked[lane] = points.ids[lane] >= 0 && !(target.shadow.data[at[lane]] & bit);
                    any |= asked[lane];
                    const float depth = asked[lane] ? target.depth.data[at[lane]] : 0.0f;
                    const Vec p = hit_point(camera, LENS, image_x(camera, float(i)), image_y(camera, float(j)), depth);
                    const Span span = span_of(light, camera, p, depth);
                    points.at[lane] = p;
                    points.near[lane] = span.near;
                    points.reach[lane] = span.reach;
                    points.faces[lane] = HAS_FACES && asked[lane] ? target.face.data[at[lane]] : 0;
                    points.open[lane] = asked[lane];
                }
                if (!any)
                    continue;
                shade_tile<TYPES>(list, light, camera, backs, world, shapes, meshes, fields, points);
                for (int lane = 0; lane < LANES; ++lane)
                    if (asked[lane] && !points.open[lane])
                        target.shadow.data[at[lane]] |= static_cast<int>(bit);
            }
#endif
            first = false;
        }
    }
}

}  // namespace warpcam
