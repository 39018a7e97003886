// Meshes that a camera is inside of: the housing of a camera on a robot, of which it sees nothing, since faces are not
// seen from behind. Every ray of the view would go through the nodes and faces around the camera, to find none of them.
#pragma once
#include "accel/bvh4.h"
#include "camera/shape_setup.h"
#include "camera/tile_frustum.h"
#include "core/vec3.h"

namespace warpcam {

constexpr int ENCLOSING_NODES = 32;  // a mesh counts as seen after so many nodes without an answer
constexpr int ENCLOSING_STACK = 16;  // nodes that wait

WARPCAM_DEVICE float length_bound(Vec3 v) { return abs(v.x) + abs(v.y) + abs(v.z); }

// The rays through four corners of an image's part, as a shape sees them.
struct CornerRays {
    Vec3 directions[4];
    float size;  // at least the length of each

    WARPCAM_DEVICE CornerRays(const ShapeRecord& record, const TileRays& part)
    {
        const Float3Int ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
        size = 0.0f;
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            const float x = i & 1 ? part.right : part.left, y = i & 2 ? part.top : part.bottom;
            const Vec3 d { ax.x * x + ax.y * y - ax.z, ay.x * x + ay.y * y - ay.z, az.x * x + az.y * y - az.z };
            directions[i] = d;
            size = max(size, length_bound(d));
        }
    }
};

// True if a ray between these, from the origin, may intersect the face. False if all pass the same edge on its outer
// side, or if the face's plane shows its back to their origin; by more than all rounding in enter_triangle().
WARPCAM_DEVICE bool may_meet_face(const CornerRays& rays, Vec3 a, Vec3 b, Vec3 c, bool both)
{
    const float reach = max(max(length_bound(a), length_bound(b)), length_bound(c));
    const float slack = 1.0e-5f * rays.size * rays.size * reach * reach;
    const Vec3 edges[3] = { cross(a, b), cross(b, c), cross(c, a) };
    const float behind = dot(a, edges[1]);
    bool front = !(behind > slack * reach), back = both && !(-behind > slack * reach);
#pragma unroll
    for (int k = 0; k < 3; ++k) {
        float least = MISS, most = -MISS;
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            const float side = dot(rays.directions[i], edges[k]);
            least = min(least, side);
            most = max(most, side);
        }
        front = front && !(least > slack);
        back = back && !(-most > slack);
    }
    return front || back;
}

// One child of a node: its box and its code.
template <class Types> WARPCAM_DEVICE int child_of(const void* rows, unsigned nodes, int node, int k,
                                                   const ShapeRecord& record, Vec3& low, Vec3& high)
{
    const auto part = [&](unsigned row) {
        const Float3Int of_all = load(rows, row);
        return k == 0 ? of_all.x : k == 1 ? of_all.y : k == 2 ? of_all.z : as_float(of_all.w);
    };
#if defined(__CUDA_ARCH__)
    if (!by_child<Types>()) {
        const unsigned first = nodes + unsigned(node * SHORT_NODE_ROWS);
        const float cell = record.size.x * BOUND_CELL;
        const auto bounds = [&](unsigned row, float& lower_bound, float& upper_bound) {
            const unsigned both = as_int(part(first + row));
            lower_bound = cell * float(int(both & 0xffff) - MIDDLE_BOUND);
            upper_bound = cell * float(int(both >> 16) - MIDDLE_BOUND);
        };
        bounds(0, low.x, high.x);
        bounds(1, low.y, high.y);
        bounds(2, low.z, high.z);
        return as_int(part(first + 3));
    }
    const unsigned first = nodes + unsigned(node * NODE_ROWS + 2 * k);
    const Float3Int lower_corner = load(rows, first);
    low = as_vec3(lower_corner);
    high = as_vec3(load(rows, first + 1));
    return lower_corner.w;
#else
    const unsigned first = nodes + unsigned(node * NODE_ROWS);
    low = { part(first), part(first + 1), part(first + 2) };
    high = { part(first + 3), part(first + 4), part(first + 5) };
    return as_int(part(first + 6));
#endif
}

// A region's rays lie between these.
WARPCAM_DEVICE TileRays rays_of_region(const Camera& camera, const Region& region)
{
    return { image_x(camera, float(region.left) - 1.0f), image_x(camera, float(region.left + region.width)),
             image_y(camera, float(region.top + region.height)), image_y(camera, float(region.top) - 1.0f) };
}

// False if the camera is inside the mesh's box and no ray of a part of its image can meet a face of it. Meshes of which
// that takes long to say may be seen.
template <class Types, class Meshes>
WARPCAM_DEVICE bool may_be_seen_from_inside(const ShapeRecord& record, const Meshes& meshes, const TileRays& part)
{
    const Float3Int o = record.origin;
    const auto least = wp::index(meshes.bounds_min, record.axis_z.w),
               most = wp::index(meshes.bounds_max, record.axis_z.w);
    if (o.x < least[0] || o.y < least[1] || o.z < least[2] || o.x > most[0] || o.y > most[1] || o.z > most[2])
        return true;
    const CornerRays rays(record, part);
    const unsigned nodes = as_int(record.size.y), faces = as_int(record.size.z);
    int stack[ENCLOSING_STACK], height = 0, node = 0;
    for (int visited = 0; visited < ENCLOSING_NODES; ++visited) {
#pragma unroll 1
        for (int k = 0; k < 4; ++k) {
            Vec3 low, high;
            const int child = child_of<Types>(meshes.nodes.data, nodes, node, k, record, low, high);
            if (child == 0 || !may_meet_box(record, low, high, part))  // the root is nobody's child
                continue;
            if (child > 0) {
                if (height == ENCLOSING_STACK)
                    return true;
                stack[height++] = child;
                continue;
            }
            const int code = -child - 1, begin = code >> 4, end = begin + (code & 15);
#pragma unroll 1
            for (int face = begin; face < end; ++face) {
                Float3Int corners[1][3];
                load_faces<1>(meshes.faces.data, faces, face, end, corners);
                const Vec3 from { o.x, o.y, o.z };
                if (may_meet_face(rays, as_vec3(corners[0][0]) - from, as_vec3(corners[0][1]) - from,
                                  as_vec3(corners[0][2]) - from, has_back<Types>(corners[0][1].w)))
                    return true;
            }
        }
        if (height == 0)
            return false;
        node = stack[--height];
    }
    return true;
}

// Removes such meshes from all tiles of the region. apart(record): rays do not walk through the mesh.
template <class Types, class List, class Meshes, class Apart>
WARPCAM_DEVICE void cull_enclosing_meshes(List& list, const Meshes& meshes, const TileRays& region, int thread,
                                          const Apart& apart)
{
    for (int slot = thread; slot < list.count; slot += THREADS)  // as sort_by_depth() goes on from here
        if (is_mesh<Types>(list.records[slot]) && !apart(list.records[slot])
            && !may_be_seen_from_inside<Types>(list.records[slot], meshes, region))
            list.touched[slot] = { 1, 1, 0, 0 };
}

}  // namespace warpcam
