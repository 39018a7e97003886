// The trace of one tile against the listed shapes.
#pragma once
#include "traversal/shape_list.h"
#include "accel/heightfield.h"
#include "geometry/intersect.h"
#include "camera/tile_frustum.h"
#if !defined(__CUDA_ARCH__)
#include "accel/mesh_packet_simd.h"
#include "accel/heightfield_simd.h"
#endif

namespace warpcam {

WARPCAM_DEVICE bool touches(const TileRect& box, int column, int row)
{
    return (column >= box.left) & (column <= box.right) & (row >= box.top) & (row <= box.bottom);
}

// Thirty-two rays: of a warp, one a lane; of a CPU thread, all of them.
#if defined(__CUDA_ARCH__)

// Takes the next number. For one lane: the compiler would gather the numbers of many.
WARPCAM_DEVICE int draw_next(int& counter)
{
    int number;
    asm volatile("atom.shared.inc.u32 %0, [%1], 0x7fffffff;"
                 : "=r"(number)
                 : "r"(static_cast<unsigned>(__cvta_generic_to_shared(&counter)))
                 : "memory");
    return number;
}

// True if the ray intersects the mesh's box before `depth`.
template <class Meshes>
WARPCAM_DEVICE bool meets_mesh(const Meshes& meshes, const ShapeRecord& record, const Ray& ray, float near, float depth)
{
    const Slabs s = slabs(ray.origin, ray.direction, record.size.x);
    const auto lo = wp::index(meshes.bounds_min, record.axis_z.w), hi = wp::index(meshes.bounds_max, record.axis_z.w);
    const float x0 = lo[0] * s.scale.x + s.down.x, x1 = hi[0] * s.scale.x + s.up.x;
    const float y0 = lo[1] * s.scale.y + s.down.y, y1 = hi[1] * s.scale.y + s.up.y;
    const float z0 = lo[2] * s.scale.z + s.down.z, z1 = hi[2] * s.scale.z + s.up.z;
    const float enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), near));
    return enter <= min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), depth));
}

template <int LENS> WARPCAM_DEVICE TileRays rays_of_tile(const CameraRay<LENS>& ray)
{
    return { __shfl_sync(FULL_WARP, ray.x, 0), __shfl_sync(FULL_WARP, ray.x, WARP_SIZE - 1),
             __shfl_sync(FULL_WARP, ray.y, WARP_SIZE - 1), __shfl_sync(FULL_WARP, ray.y, 0) };
}

// Bit mask of the meshes, of 32 in `mask`, whose boxes the lane's ray intersects before `depth`. `slots` leads from a
// bit to a record; nearest first. The whole warp calls it together.
template <int LENS, class Meshes>
WARPCAM_DEVICE unsigned find_meshes(unsigned mask, const ShapeRecord* records, const unsigned char* slots,
                                    const CameraRay<LENS>& ray, float near, const Meshes& meshes, float depth)
{
    unsigned met = 0;
    for (; mask; mask &= mask - 1) {
        const int bit = ctz(mask);
        const ShapeRecord& record = records[slots[bit]];
        const bool before = as_float(record.size.w) < depth;
        if (!__any_sync(FULL_WARP, before))
            break;
        if (before && meets_mesh(meshes, record, ray.local(record), near, depth))
            met |= 1u << bit;
    }
    return met;
}

// Bit mask of the ranks, of WARP_SIZE from `begin` on, that overlap a tile, without meshes. By a whole warp.
template <class Types, class List> WARPCAM_DEVICE unsigned touching(const List& list, int begin, unsigned steps)
{
    const int rank = begin + threadIdx.x % WARP_SIZE;
    return __ballot_sync(FULL_WARP, list.tiles[rank].touches(steps) && !is_mesh<Types>(list.at_rank(rank)));
}

// The same of meshes alone.
template <class Types, class List> WARPCAM_DEVICE unsigned touching_meshes(const List& list, int begin, unsigned steps)
{
    const int rank = begin + threadIdx.x % WARP_SIZE;
    return __ballot_sync(FULL_WARP,
                         rank < list.count && list.tiles[rank].touches(steps) && is_mesh<Types>(list.at_rank(rank)));
}

// True if a rank beyond the first WARP_SIZE overlaps a tile.
template <class Types, class List> WARPCAM_DEVICE bool touching_more(const List& list, unsigned steps)
{
    for (int begin = WARP_SIZE; List::SIZE > WARP_SIZE && begin < list.count; begin += WARP_SIZE)
        if (touching<Types>(list, begin, steps))
            return true;
    return false;
}

// The nearest of all shapes but meshes, of TILES_PER_WARP tiles one below the other; of each a lane has a ray. `mask`:
// the first ranks that touch them; more(begin): those from there on. See touching().
template <class Types, int TILES_PER_WARP, class Ray_, class List, class HeightFields, class More>
WARPCAM_DEVICE void trace_tiles(const List& list, unsigned mask, const More& more, const Ray_ (&rays)[TILES_PER_WARP],
                                float near, const HeightFields& fields, Hit (&hits)[TILES_PER_WARP])
{
    int begin = 0;
    while (true) {
        for (; mask; mask &= mask - 1) {
            const ShapeRecord& record = list.at_rank(begin + ctz(mask));
            float farthest = hits[0].depth;
            for (int k = 1; k < TILES_PER_WARP; ++k)
                farthest = max(farthest, hits[k].depth);
            if (!__any_sync(FULL_WARP, as_float(record.size.w) < farthest))
                return;  // every lane has hits nearer than all that follows
            if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD) {
                for (int k = 0; k < TILES_PER_WARP; ++k)
                    walk_height_field(fields, record, rays[k], near_of(rays[k], near), hits[k]);
                __syncwarp();
            } else {
                Ray local[TILES_PER_WARP];
                for (int k = 0; k < TILES_PER_WARP; ++k)
                    local[k] = rays[k].local(record);
                float t[TILES_PER_WARP];
                intersect_known<Types::ANALYTIC>(record, local, t);
                for (int k = 0; k < TILES_PER_WARP; ++k)
                    if (t[k] < hits[k].depth && t[k] > near_of(rays[k], near)) {
                        hits[k].depth = t[k];
                        hits[k].shape = record.axis_y.w;
                    }
            }
        }
        begin += WARP_SIZE;
        if (List::SIZE <= WARP_SIZE || begin >= list.count)
            return;
        mask = more(begin);
    }
}

#else

struct Rays {
    float x[WARP_SIZE], y[WARP_SIZE], depth[WARP_SIZE];
    int shape[WARP_SIZE], face[WARP_SIZE];
};

// From where on the rays see: all alike, or each its own.
template <class Ray_> struct NearOf {
    float all;

    void set(int, const Ray_&) {}
    float at(int) const { return all; }
};
template <int LENS> struct NearOf<ClippedRay<LENS>> {
    float all, own[WARP_SIZE];

    void set(int lane, const ClippedRay<LENS>& ray) { own[lane] = ray.near; }
    float at(int lane) const { return own[lane]; }
};

// Depths are not negative, but for -1 where a ray is outside the image; their bits then order as they do, and a
// maximum of integers becomes vector code.
inline float farthest_of(const Rays& rays)
{
    int bits = as_int(rays.depth[0]);
    for (int lane = 1; lane < WARP_SIZE; ++lane)
        bits = as_int(rays.depth[lane]) > bits ? as_int(rays.depth[lane]) : bits;
    return as_float(bits);
}

// The shapes that touch one row of tiles, nearest first.
template <int CAPACITY> struct TileRow {
    static constexpr int SIZE = (CAPACITY + 31) / 32 * 32;
    signed char left[SIZE], right[SIZE];
    typename ShapeList<CAPACITY>::Slot ranks[SIZE];
    int count;
};

template <int CAPACITY> inline void pick_row(const ShapeList<CAPACITY>& list, int row, TileRow<CAPACITY>& picked)
{
    const auto& tiles = list.tiles;
    int count = 0;  // in a register
    for (int first = 0; first < list.count; first += 32)
        for (unsigned some = spans_around(tiles.top, tiles.bottom, first, list.count, row); some; some &= some - 1) {
            const int rank = first + ctz(some);
            picked.left[count] = tiles.left[rank];
            picked.right[count] = tiles.right[rank];
            picked.ranks[count++] = static_cast<typename ShapeList<CAPACITY>::Slot>(rank);
        }
    picked.count = count;
}

// A tile's rays as shapes are tested against them.
template <int LENS> struct RayLanes {
    const Rays& rays;

    Ray local(const ShapeRecord& record, int lane) const
    {
        return CameraRay<LENS> { rays.x[lane], rays.y[lane] }.local(record);
    }
};

// Offset rays are read first, or what follows would not become vector code.
template <> struct RayLanes<RAY_TABLE_WITH_ORIGINS> {
    float start[3][WARP_SIZE], direction[3][WARP_SIZE];

    explicit RayLanes(const Rays& rays)
    {
        for (int lane = 0; lane < WARP_SIZE; ++lane) {
            const OffsetRay offset_ray = CameraRay<RAY_TABLE_WITH_ORIGINS> { rays.x[lane], rays.y[lane] }.offset_ray();
            for (int axis = 0; axis < 3; ++axis) {
                start[axis][lane] = component(offset_ray.start, axis);
                direction[axis][lane] = component(offset_ray.direction, axis);
            }
        }
    }

    Ray local(const ShapeRecord& record, int lane) const
    {
        return local_of({ { start[0][lane], start[1][lane], start[2][lane] },
                          { direction[0][lane], direction[1][lane], direction[2][lane] } },
                        record);
    }
};

template <int LENS, class Shape, class Near>
inline void trace_shape(Shape shape, const ShapeRecord& record, const Near& near, Rays& rays)
{
    const ShapeRecord r = record;
    const RayLanes<LENS> lanes { rays };
    for (int lane = 0; lane < WARP_SIZE; ++lane) {
        const Ray ray = lanes.local(r, lane);
        const float t = shape.intersect(r.size, ray.origin, ray.direction);
        const bool closer = (t < rays.depth[lane]) & (t > near.at(lane));
        rays.depth[lane] = closer ? t : rays.depth[lane];
        rays.shape[lane] = closer ? r.axis_y.w : rays.shape[lane];
    }
}

// Any shape but a mesh.
template <class Types, int LENS, class Near, class HeightFields>
inline void trace_record(const ShapeRecord& record, const Near& near, const HeightFields& fields, Rays& rays)
{
    if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD)
        trace_height_field<LENS>(fields, record, near, rays);
    else
        visit_shape<Types::ANALYTIC>(record.axis_x.w,
                                     [&](auto shape) { trace_shape<LENS>(shape, record, near, rays); });
}

template <class Types, int LENS, int CAPACITY, class Near, class Meshes, class HeightFields>
inline void trace_tile(const ShapeList<CAPACITY>& list, const TileRow<CAPACITY>& row, int column, const Near& near,
                       const Meshes& meshes, const HeightFields& fields, Rays& rays)
{
    typename ShapeList<CAPACITY>::Slot behind[CAPACITY];  // slots of meshes, nearest first
    int meshes_behind = 0;
    float farthest = MISS;
    for (int first = 0; first < row.count; first += 32)
        for (unsigned some = spans_around(row.left, row.right, first, row.count, column); some; some &= some - 1) {
            const int slot = list.order[row.ranks[first + ctz(some)]];
            const ShapeRecord& record = list.records[slot];
            if (as_float(record.size.w) >= farthest) {
                first = row.count;  // nor is any of those behind it nearer
                break;
            }
            if (record.axis_x.w == MESH) {
                behind[meshes_behind++] = static_cast<typename ShapeList<CAPACITY>::Slot>(slot);
                continue;
            }
            trace_record<Types, LENS>(record, near, fields, rays);
            farthest = farthest_of(rays);
        }
    if (Types::has(MESH))
        for (int i = 0; i < meshes_behind; ++i) {
            const ShapeRecord& record = list.records[behind[i]];
            if (as_float(record.size.w) >= farthest_of(rays))
                break;
            trace_mesh<Types, LENS>(meshes, record, near, rays);
        }
}

#endif

}  // namespace warpcam
