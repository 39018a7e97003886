// Parts shared by the traversals of triangle meshes: traversal/mesh_closest_hit.h and shadow/mesh_any_hit.h on CUDA,
// accel/bvh4_simd.h on a CPU.
#pragma once
#include "geometry/triangle.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)
constexpr int NODE_ROWS = 8;  // where meshes move
#else
constexpr int NODE_ROWS = 7;  // bound after bound, so that one vector has all four children's
#endif
constexpr int SHORT_NODE_ROWS = 4;  // on CUDA where none moves, see NodeRay
constexpr int FACE_ROWS = 3;
// Bounds of boxes in 16 bits, see Meshes.nodes: of a mesh's extent a step is so much, and this is the plane through 0.
constexpr int MIDDLE_BOUND = 32768;
constexpr float BOUND_CELL = 1.0f / 32760.0f;
constexpr int NO_NODE = 0x7fffffff;
constexpr int STACK = 48;  // three children of a node wait at each of a tree's levels, which are at most 16

struct Hit {
    float depth;
    int shape;
    int face;
};

// So many faces of a leaf are loaded before the first is tested: memory is waited for less often, in more registers.
template <class Types> constexpr int faces_together() { return Types::has(DEFORMING_MESHES) ? 2 : 1; }

// The i-th of them; behind the end the last is taken again.
template <int TOGETHER> WARPCAM_DEVICE int face_of(int begin, int i, int end)
{
    return TOGETHER == 1 ? begin : min(begin + i, end - 1);
}

// Loads their corners; `first` is the mesh's first row.
template <int TOGETHER>
WARPCAM_DEVICE void load_faces(const void* rows, unsigned first, int begin, int end, Float3Int (&corners)[TOGETHER][3])
{
#pragma unroll
    for (int i = 0; i < TOGETHER; ++i) {
        const unsigned at = first + unsigned(face_of<TOGETHER>(begin, i, end) * FACE_ROWS);
#pragma unroll
        for (int k = 0; k < 3; ++k)
            corners[i][k] = load(rows, at + k);
    }
}

// Ray constants for box tests, with t = plane * scale + offset. Offsets move lower planes down and upper planes up by
// more than all rounding of the camera's and the mesh's coordinates.
struct Slabs {
    Vec3 scale, down, up;
};

WARPCAM_DEVICE Slabs slabs(Vec3 o, Vec3 d, float extent)
{
    const Vec3 s { rcp(avoid_zero(d.x)), rcp(avoid_zero(d.y)), rcp(avoid_zero(d.z)) };
    const float distance = abs(o.x) + abs(o.y) + abs(o.z) + extent;
    const float pad = 1.0e-6f * distance;
    return { s,
             { -(o.x + pad) * s.x, -(o.y + pad) * s.y, -(o.z + pad) * s.z },
             { -(o.x - pad) * s.x, -(o.y - pad) * s.y, -(o.z - pad) * s.z } };
}

#if defined(__CUDA_ARCH__)

// True if nodes store one child after another, each with the lower and upper corner of its box. Scenes with moving
// meshes store nodes so, as children write their own boxes. Other scenes store bounds as whole numbers of 16 bits: see
// Meshes.nodes.
template <class Types> constexpr bool by_child() { return Types::has(DEFORMING_MESHES); }

// The greatest and the least of three numbers, one instruction each: bits order as the numbers do, but for negative
// ones, which are below all others in no order of their own.
WARPCAM_DEVICE float greatest(float a, float b, float c) { return as_float(max(max(as_int(a), as_int(b)), as_int(c))); }
WARPCAM_DEVICE float least(float a, float b, float c) { return as_float(min(min(as_int(a), as_int(b)), as_int(c))); }

// A ray as the nodes of one mesh see it.
template <bool BY_CHILD> struct NodeRay {
    static constexpr int ROWS = NODE_ROWS;
    Slabs s;

    WARPCAM_DEVICE void set(Vec3 o, Vec3 d, float extent) { s = slabs(o, d, extent); }

    // The children of the node whose rows these are, and where the ray enters and leaves their boxes between `near` and
    // `depth`: it misses those that it leaves before it enters them.
    WARPCAM_DEVICE void test(const Float3Int* rows, float near, float depth, float (&enter)[4], float (&t_far)[4],
                             int (&child)[4]) const
    {
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            const Float3Int low = load(rows, 2 * k), high = load(rows, 2 * k + 1);
            const float x0 = low.x * s.scale.x + s.down.x, x1 = high.x * s.scale.x + s.up.x;
            const float y0 = low.y * s.scale.y + s.down.y, y1 = high.y * s.scale.y + s.up.y;
            const float z0 = low.z * s.scale.z + s.down.z, z1 = high.z * s.scale.z + s.up.z;
            enter[k] = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), near));
            t_far[k] = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), depth));
            child[k] = low.w;
        }
    }
};

// Bounds of 16 bits: its direction says once for all nodes which of two planes it meets first.
template <> struct NodeRay<false> {
    static constexpr int ROWS = SHORT_NODE_ROWS;
    // A bound as the lowest bits of this number is a whole one, greater by 2^23.
    static constexpr unsigned WHOLE = 0x4b000000;
    static constexpr float MIDDLE = 8388608.0f + float(MIDDLE_BOUND);
    Vec3 scale, in, out;  // t = (2^23 + bound) * scale + in or out, see Slabs
    unsigned ways, way_z;  // first_of() each axis, y's in the upper half

    // Sets the ray up, as slabs() does, for a mesh whose ShapeRecord::size.x is `extent`.
    WARPCAM_DEVICE void set(Vec3 o, Vec3 d, float extent)
    {
        const float cell = extent * BOUND_CELL;
        const float pad = 1.0e-6f * (abs(o.x) + abs(o.y) + abs(o.z) + extent);
        const auto along = [&](float from, float direction, float& by, float& first, float& last) {
            const float s = rcp(avoid_zero(direction)), aside = pad * abs(s);
            by = cell * s;
            first = (-from * s - aside) - MIDDLE * by;
            last = (-from * s + aside) - MIDDLE * by;
        };
        along(o.x, d.x, scale.x, in.x, out.x);
        along(o.y, d.y, scale.y, in.y, out.y);
        along(o.z, d.z, scale.z, in.z, out.z);
        ways = first_of(scale.x) | first_of(scale.y) << 16;
        way_z = first_of(scale.z);
    }

    // Byte selector, for a word and WHOLE, of the plane that the ray meets first: the word has the lower plane in its
    // lower half.
    WARPCAM_DEVICE static unsigned first_of(float scale) { return 0x7610u ^ (unsigned(as_int(scale) >> 31) & 0x22u); }

    WARPCAM_DEVICE static void mul(const Float3Int& planes, unsigned which, float scale, float offset, float (&t)[4])
    {
        const int words[4] = { as_int(planes.x), as_int(planes.y), as_int(planes.z), planes.w };
#pragma unroll
        for (int k = 0; k < 4; ++k)
            t[k] = as_float(__byte_perm(words[k], WHOLE, which)) * scale + offset;
    }

    // Tests the four children likewise; `near` is not negative.
    WARPCAM_DEVICE void test(const Float3Int* rows, float near, float depth, float (&enter)[4], float (&t_far)[4],
                             int (&child)[4]) const
    {
        const unsigned x = ways, y = ways >> 16, z = way_z;
        const Float3Int planes_x = load(rows, 0), planes_y = load(rows, 1), planes_z = load(rows, 2),
                        children = load(rows, 3);
        float tx[4], ty[4], tz[4];
        mul(planes_x, x, scale.x, in.x, tx);
        mul(planes_y, y, scale.y, in.y, ty);
        mul(planes_z, z, scale.z, in.z, tz);
#pragma unroll
        for (int k = 0; k < 4; ++k)
            enter[k] = greatest(greatest(tx[k], ty[k], tz[k]), near, near);
        mul(planes_x, x ^ 0x22u, scale.x, out.x, tx);
        mul(planes_y, y ^ 0x22u, scale.y, out.y, ty);
        mul(planes_z, z ^ 0x22u, scale.z, out.z, tz);
#pragma unroll
        for (int k = 0; k < 4; ++k)
            t_far[k] = least(least(tx[k], ty[k], tz[k]), depth, depth);
        child[0] = as_int(children.x);
        child[1] = as_int(children.y);
        child[2] = as_int(children.z);
        child[3] = children.w;
    }
};

template <class Types, class Meshes>
WARPCAM_DEVICE const Float3Int* node_rows(const Meshes& meshes, unsigned nodes, int node)
{
    return reinterpret_cast<const Float3Int*>(meshes.nodes.data)
           + (nodes + unsigned(node * NodeRay<by_child<Types>()>::ROWS));
}

#endif

}  // namespace warpcam
