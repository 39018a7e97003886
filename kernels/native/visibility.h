// The trace: for every pixel of a view the nearest shape, its face and depth, and what follows from these alone.
#pragma once
#include "canvas.h"
#include "mesh_queue.h"

namespace warpcam {

// Does the shape's colour let it be seen at all? MuJoCo's rule of which colour counts (see look.h).
template <class Shapes, class Materials>
WARPCAM_FN bool transparent(const Shapes& shapes, const Materials& materials, int world, int id)
{
    const auto color = shared_row(shapes.colors, world, id);
    const int material = shared_row(shapes.materials, world, id);
    const bool plain = color[0] == 0.5f && color[1] == 0.5f && color[2] == 0.5f && color[3] == 1.0f;
    if (material >= 0 && material < materials.color.shape[1] && plain)
        return shared_row(materials.color, world, material)[3] == 0.0f;
    return color[3] == 0.0f;
}

template <class Shapes> WARPCAM_FN Shape load_shape(const Shapes& shapes, int world, int id)
{
    Shape s;
    s.type = wp::index(shapes.types, id);
    s.id = id;
    s.asset = shared_row(shapes.assets, world, id);
    const auto p = wp::index(shapes.positions, world, id);
    const auto r = wp::index(shapes.rotations, world, id);
    const auto size = shared_row(shapes.sizes, world, id);
    s.position = { p[0], p[1], p[2] };
    s.size = { size[0], size[1], size[2] };
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            s.rotation.at[i][j] = r.data[i][j];
    return s;
}

// Fills the list with shapes from `begin` on until it is full; returns where to go on.
template <int TYPES, int LENS, int CAPACITY, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_FN int gather(ShapeList<CAPACITY>& list, int begin, const Shapes& shapes, const Materials& materials,
                      const Meshes& meshes, const HeightFields& fields, const Camera& camera, const Region& region,
                      int world, int thread)
{
    const int total = shapes.drawn.shape[0];
    while (begin < total) {
        const int i = begin + thread;
        begin += THREADS;
        if (i < total) {
            Record record;
            TileBox tiles;
            const int id = wp::index(shapes.drawn, i);
            const Visible seen = prepare<TYPES, LENS>(load_shape(shapes, world, id), camera, region, meshes, fields,
                                                      record, tiles);
            if (seen == BROKEN)
                list.broken = 1;
            if (seen == SEEN && !transparent(shapes, materials, world, id)) {
#if defined(__CUDA_ARCH__)
                const int slot = atomicAdd(&list.count, 1);
#else
                const int slot = list.count++;
#endif
                list.records[slot] = record;
                list.nearest[slot] = as_float(record.size.w);
                list.ids[slot] = id;
                list.touched[slot] = tiles;
            }
        }
        if (total > CAPACITY) {  // the next round may overflow the list
            block_barrier();
            const bool full = list.count + THREADS > CAPACITY;
            block_barrier();
            if (full)
                break;
        }
    }
    block_barrier();
    return begin;
}

#if defined(__CUDA_ARCH__)

// Draws the tiles of a region against the list. All warps of the block come here together; a warp draws one tile after
// another, and where rays wait for meshes all walk them when there are enough.
template <int TYPES, int LENS, int CAPACITY, int OUTPUTS, class Target, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN void draw_tiles(ShapeList<CAPACITY>& list, const Canvas<LENS, OUTPUTS, Target, Shapes>& canvas,
                           const Meshes& meshes, const HeightFields& fields, bool first_pass)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_POINTS = OUTPUTS & POINTS;
    WARPCAM_SHARED MeshQueue<HAS_MESH ? (CAPACITY + LANES - 1) / LANES : 1> queue;
    WARPCAM_SHARED float4 lanes[HAS_POINTS ? THREADS / LANES : 1][3 * LANES / 4];
    const int lane = threadIdx.x % LANES;
    const Region region = canvas.region;
    const float near = canvas.camera.near;
    const int across = region.width / TILE_WIDTH, tiles = across * (region.height / TILE_HEIGHT);
    const float per_row = 1.0f / float(across);
    do {
        if (HAS_MESH) {
            if (threadIdx.x == 0)
                queue.clear();
            block_barrier();
        }
        while (true) {
            int tile = tiles;
            if (lane == 0 && (!HAS_MESH || queue.has_room()))
                tile = draw_next(list.next_tile);
            tile = __shfl_sync(ALL, tile, 0);
            if (tile >= tiles)
                break;
            const int row = int((float(tile) + 0.5f) * per_row), column = tile - row * across;
            const int i = region.left + column * TILE_WIDTH + lane % TILE_WIDTH;
            const int j = region.top + row * TILE_HEIGHT + lane / TILE_WIDTH;
            const ViewRay<LENS> ray = canvas.ray(i, j);
            Hit hit = canvas.start(i, j, first_pass);
            trace_tile<TYPES>(list, column, row, ray, near, fields, hit);
            canvas.put_tile(i, j, hit, reinterpret_cast<float*>(lanes[HAS_POINTS ? threadIdx.x / LANES : 0]));
            if (HAS_MESH)
                enqueue<TYPES>(queue, list, column, row, ray, near, meshes, hit.depth);
        }
        if (HAS_MESH) {
            block_barrier();
            const auto ray_of = [&](int pixel) { return canvas.ray(region.left + pixel % 64, region.top + pixel / 64); };
            const auto store = [&](int pixel, const Hit& hit) {
                canvas.template put<OUTPUTS>(region.left + pixel % 64, region.top + pixel / 64, hit);
            };
            if (queue.count > 0)
                trace_queue<TYPES>(queue, list, meshes, near, ray_of, store);
            block_barrier();
        }
    } while (HAS_MESH && list.next_tile < tiles);
}

#else

// Draws the tiles of a region against the list.
template <int TYPES, int LENS, int CAPACITY, int OUTPUTS, class Target, class Shapes, class Meshes, class HeightFields>
inline void draw_tiles(ShapeList<CAPACITY>& list, const Canvas<LENS, OUTPUTS, Target, Shapes>& canvas,
                       const Meshes& meshes, const HeightFields& fields, bool first_pass)
{
    const Region region = canvas.region;
    TileRow<CAPACITY> picked;
    for (int row = 0; row < region.height / TILE_HEIGHT; ++row) {
        pick_row(list, row, picked);
        for (int column = 0; column < region.width / TILE_WIDTH; ++column) {
            const int left = region.left + column * TILE_WIDTH, top = region.top + row * TILE_HEIGHT;
            Rays rays;
            for (int lane = 0; lane < LANES; ++lane) {
                const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
                const ViewRay<LENS> ray = canvas.ray(i, j);
                const Hit hit = canvas.start(i, j, first_pass);
                rays.x[lane] = ray.x;
                rays.y[lane] = ray.y;
                rays.depth[lane] = hit.depth;
                rays.shape[lane] = hit.shape;
                rays.face[lane] = hit.face;
            }
            trace_tile<TYPES, LENS>(list, picked, column, canvas.camera.near, meshes, fields, rays);
            for (int lane = 0; lane < LANES; ++lane) {
                const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
                if (canvas.inside(i, j))
                    canvas.template put<OUTPUTS>(i, j, { rays.depth[lane], rays.shape[lane], rays.face[lane] });
            }
        }
    }
}

#endif

// Draws one region of one view; `index` counts worlds, then regions, then (CUDA) threads of the block.
// SEVERAL: the scene may have more shapes than the list holds; then the region is drawn in several passes, each
// going on from the depth of the last, and depth and shape are always written.
template <int TYPES, int LENS, int CAPACITY, bool SEVERAL, int WIDTH, int HEIGHT, int OUTPUTS, class Shapes,
          class Materials, class Meshes, class HeightFields, class Views, class Target>
WARPCAM_FN void draw(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                     const HeightFields& fields, const Views& views, const Target& target, int index)
{
    WARPCAM_SHARED ShapeList<CAPACITY> list;
    const int thread = index % THREADS, block = index / THREADS;
    const int columns = (target.width + WIDTH - 1) / WIDTH, rows = (target.height + HEIGHT - 1) / HEIGHT;
    const int world = block / (columns * rows), part = block % (columns * rows);
    if (!wp::index(target.mask, world))
        return;
    Region region { part % columns * WIDTH, part / columns * HEIGHT, WIDTH, HEIGHT };
    region.width = lower_int(WIDTH, (target.width - region.left + TILE_WIDTH - 1) / TILE_WIDTH * TILE_WIDTH);
    region.height = lower_int(HEIGHT, (target.height - region.top + TILE_HEIGHT - 1) / TILE_HEIGHT * TILE_HEIGHT);
    const Camera camera = load_camera(wp::index(views, world));
    const bool blind = !(magnitude(camera.origin.x) < FAR_AWAY);
    const Canvas<LENS, OUTPUTS, Target, Shapes> canvas { target, shapes, camera, region, world };
    const int total = blind ? 0 : shapes.drawn.shape[0];

    int begin = 0;
    bool first = true;
    if (thread == 0)
        list.broken = 0;
    do {
        if (thread == 0) {
            list.count = 0;
            list.next_tile = 0;
        }
        block_barrier();
        if (!blind)
            begin = gather<TYPES, LENS>(list, begin, shapes, materials, meshes, fields, camera, region, world, thread);
        if (list.broken) {  // nothing of this world can be trusted
            block_barrier();
            if (thread == 0) {
                list.count = 0;
                target.faults.data[world] = 1;
            }
            begin = total;
            first = true;
            block_barrier();
        }
        sort_by_depth(list, thread);
        block_barrier();
        draw_tiles<TYPES>(list, canvas, meshes, fields, !SEVERAL || first);
        first = false;
        block_barrier();
    } while (SEVERAL && begin < total);
}

}  // namespace warpcam
