// Triangle meshes on a CPU: a tile's rays walk one mesh after another, side by side. Each step of a ray is a few
// instructions that wait for each other; those of one ray run while another's are waited for. A ray tests the four
// children of a node, and eight faces of a leaf, at once.
#pragma once
#include "core/simd8.h"
#include "accel/alpha_test.h"

namespace warpcam {

typedef float Float4 __attribute__((ext_vector_type(4)));
typedef int Int4 __attribute__((ext_vector_type(4)));

inline Float4 lower4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 upper4(Float4 a, Float4 b) { return a > b ? a : b; }

inline Float4 muladd4(Float4 a, float b, float c)
{
#if defined(__FMA__)
    return __builtin_elementwise_fma(a, (Float4)b, (Float4)c);
#else
    return a * b + c;
#endif
}

inline Float4 load_float4(const float* from)
{
    Float4 r;
    __builtin_memcpy(&r, from, sizeof r);
    return r;
}

inline void store_float4(int* to, Int4 a) { __builtin_memcpy(to, &a, sizeof a); }

// Counts the elements that are true (all ones).
inline int count_of(Int4 truth)
{
#if defined(__x86_64__)
    return __builtin_popcount(static_cast<unsigned>(__builtin_ia32_movmskps((Float4)truth)));
#else
    return -__builtin_reduce_add(truth);
#endif
}

// Four numbers, the greatest first.
inline Int4 sorted4(Int4 a)
{
    const auto greater = [](Int4 a, Int4 b) { return a > b ? a : b; };
    const auto less = [](Int4 a, Int4 b) { return a < b ? a : b; };
    Int4 b = __builtin_shufflevector(a, a, 1, 0, 3, 2);
    a = __builtin_shufflevector(greater(a, b), less(a, b), 0, 5, 2, 7);
    b = __builtin_shufflevector(a, a, 2, 3, 0, 1);
    a = __builtin_shufflevector(greater(a, b), less(a, b), 0, 1, 6, 7);
    b = __builtin_shufflevector(a, a, 0, 2, 1, 3);
    return __builtin_shufflevector(greater(a, b), less(a, b), 0, 1, 6, 3);
}

// Elements by the two lowest bits of `at`.
inline Int4 pick4(Int4 from, Int4 at)
{
#if defined(__AVX__)
    return (Int4)__builtin_ia32_vpermilvarps((Float4)from, at);
#else
    return { from[at[0] & 3], from[at[1] & 3], from[at[2] & 3], from[at[3] & 3] };
#endif
}

// Projected vertices of eight faces: Corner and project() of geometry/triangle.h as a packet.
struct Corners {
    Float8 x, y, along;
};

// A corner of a face in the frame of a ray: `frame(k)` are the numbers of MeshRays::frame.
template <class Frame> inline Corners project(const Frame& frame, Float8 at_x, Float8 at_y, Float8 at_z)
{
#pragma clang fp contract(off)
    const Float8 x = at_x - frame(0), y = at_y - frame(1), z = at_z - frame(2);
    return { frame(3) * x + (frame(4) * y + frame(5) * z), frame(6) * x + (frame(7) * y + frame(8) * z),
             frame(9) * x + frame(10) * y + frame(11) * z };
}

inline Float8 edges(const Corners& a, const Corners& b)
{
#pragma clang fp contract(off)
    return a.x * b.y - a.y * b.x;
}

// Sides of faces that a ray intersects: fronts; also backs of faces that have a back; or both sides of all faces.
enum Sides { FRONTS, FRONTS_AND_MARKED, BOTH_SIDES };

template <class Types, bool ANY> constexpr Sides SIDES_OF = ANY && Types::has(SHADING_BACKS) ? BOTH_SIDES
                                                            : Types::has(TWO_SIDED)          ? FRONTS_AND_MARKED
                                                                                             : FRONTS;

// Eight pairs of a ray and a face: weights of the face's corners where they meet, times their sum.
struct Weights {
    Float8 a, b, c, total;

    explicit Weights(const Corners (&corners)[3])
        : a(edges(corners[1], corners[2])), b(edges(corners[2], corners[0])), c(edges(corners[0], corners[1])),
          total(a + b + c)
    {
    }

    // `both`: faces with a back.
    template <Sides SIDES> Int8 inside(Int8 both) const
    {
        const Float8 none = 0.0f;
        Int8 inside = (a >= none) & (b >= none) & (c >= none) & (total > none);
        if constexpr (SIDES != FRONTS)
            inside |= both & (a <= none) & (b <= none) & (c <= none) & (total < none);
        return inside;
    }

    Float8 depth(const Corners (&corners)[3]) const
    {
        return (a * corners[0].along + b * corners[1].along + c * corners[2].along) / total;
    }
};

// Rays at one mesh, by number.
struct MeshRays {
    static constexpr int STACK_CAPACITY = STACK + 5;  // with what ends it, and three that a step writes too many
    static constexpr int NODE = 4 * NODE_ROWS, FACE = 4 * FACE_ROWS;  // floats
    static constexpr int INTERLEAVED_RAYS = 4;  // so many rays are enough to walk side by side

    const float *nodes, *faces;
    float scale[3][WARP_SIZE], in[3][WARP_SIZE],
        out[3][WARP_SIZE];  // see Slabs; which of a box's planes is met first is known
    int enters[3][WARP_SIZE], leaves[3][WARP_SIZE];  // floats from a node to its planes that are met first, and last
    float frame[12][WARP_SIZE];  // see RayFrame
    float near[WARP_SIZE], depth[WARP_SIZE];
    int face[WARP_SIZE];  // the nearest so far, or -1
    // Traversal stacks, nearest entry on top: children of nodes, and the bits of the entry distance without the lowest
    // two. The bottom holds 0, which is no child.
    int height[WARP_SIZE];
    int child[WARP_SIZE][STACK_CAPACITY], entry[WARP_SIZE][STACK_CAPACITY];
    int walking[WARP_SIZE + 1], at_leaf[WARP_SIZE + 1];  // rays whose next is a node, or a leaf
    int num_walking, num_at_leaf;

    MeshRays(const float* nodes, const float* faces) : nodes(nodes), faces(faces), num_walking(0), num_at_leaf(0) {}

    void put(int ray, const Slabs& s, const RayFrame& f, float from, float to)
    {
        const bool x = s.scale.x < 0.0f, y = s.scale.y < 0.0f, z = s.scale.z < 0.0f;
        scale[0][ray] = s.scale.x, scale[1][ray] = s.scale.y, scale[2][ray] = s.scale.z;
        in[0][ray] = x ? s.up.x : s.down.x, in[1][ray] = y ? s.up.y : s.down.y, in[2][ray] = z ? s.up.z : s.down.z;
        out[0][ray] = x ? s.down.x : s.up.x, out[1][ray] = y ? s.down.y : s.up.y, out[2][ray] = z ? s.down.z : s.up.z;
        const bool back[3] = { x, y, z };
        for (int axis = 0; axis < 3; ++axis) {
            enters[axis][ray] = 4 * (back[axis] ? axis + 3 : axis);
            leaves[axis][ray] = 4 * (back[axis] ? axis : axis + 3);
        }
        frame[0][ray] = f.origin.x, frame[1][ray] = f.origin.y, frame[2][ray] = f.origin.z;
        frame[3][ray] = f.across.x, frame[4][ray] = f.across.y, frame[5][ray] = f.across.z;
        frame[6][ray] = f.up.x, frame[7][ray] = f.up.y, frame[8][ray] = f.up.z;
        frame[9][ray] = f.depth.x, frame[10][ray] = f.depth.y, frame[11][ray] = f.depth.z;
        near[ray] = from;
        depth[ray] = to;
    }

    // Eight rays, `first_ray` and those after it, through slabs and frames as those of accel/bvh4.h and
    // camera/shape_record.h.
    void put_eight(int first_ray, Vec3x8 o, Vec3x8 d, float extent, const Vec3x8 (&rows)[3], Float8 from, Float8 to)
    {
        const Float8 pad = 1.0e-6f * (abs(o.x) + abs(o.y) + abs(o.z) + extent);
        const Float8 from_origin[3] = { o.x, o.y, o.z }, along[3] = { d.x, d.y, d.z };
        for (int axis = 0; axis < 3; ++axis) {
            const Float8 rate = rcp(avoid_zero(along[axis]));
            const Float8 down = -(from_origin[axis] + pad) * rate, up = -(from_origin[axis] - pad) * rate;
            const Int8 back = rate < 0.0f;
            put(scale[axis] + first_ray, rate);
            put(in[axis] + first_ray, back ? up : down);
            put(out[axis] + first_ray, back ? down : up);
            put(enters[axis] + first_ray, 4 * axis + (back & 12));
            put(leaves[axis] + first_ray, 4 * axis + (~back & 12));
            put(frame[axis] + first_ray, from_origin[axis]);
            put(frame[3 * axis + 3] + first_ray, rows[axis].x);
            put(frame[3 * axis + 4] + first_ray, rows[axis].y);
            put(frame[3 * axis + 5] + first_ray, rows[axis].z);
        }
        put(near + first_ray, from);
        put(depth + first_ray, to);
    }

    template <class Value, class Values> static void put(Value* to, Values values)
    {
        static_assert(sizeof values == SIMD_WIDTH * sizeof(Value));
        __builtin_memcpy(to, &values, sizeof values);
    }

    // Makes a ray that was put walk, from a node on.
    void start(int ray, int node)
    {
        height[ray] = 1;
        child[ray][0] = 0;
        child[ray][1] = node;
        entry[ray][0] = -1;  // the bits of no number: not beyond any depth
        walking[num_walking++] = ray;
    }

    // Tests the children of the node on top; returns what is on top then.
    int step(int ray)
    {
        const int top = height[ray];
        const float* rows = nodes + size_t(unsigned(child[ray][top])) * NODE;
        const auto planes = [&](int axis, const int (&places)[3][WARP_SIZE], const float (&offset)[3][WARP_SIZE]) {
            return muladd4(load_float4(rows + unsigned(places[axis][ray])), scale[axis][ray], offset[axis][ray]);
        };
        const Float4 enter = upper4(upper4(planes(0, enters, in), planes(1, enters, in)),
                                    upper4(planes(2, enters, in), (Float4)near[ray]));
        const Float4 t_far = lower4(lower4(planes(0, leaves, out), planes(1, leaves, out)),
                                    lower4(planes(2, leaves, out), (Float4)depth[ray]));
        const Int4 met = enter <= t_far;
        const Int4 keys = sorted4(((Int4)enter & 0x7ffffffc) | Int4 { 0, 1, 2, 3 } | ~met);
        store_float4(child[ray] + top, pick4((Int4)load_float4(rows + 4 * 6), keys));
        store_float4(entry[ray] + top, keys);
        height[ray] = top + count_of(met) - 1;
        return child[ray][height[ray]];
    }

    // A leaf against a ray. there(ray, face, depth): the face is there where it is met.
    template <Sides SIDES, class There> void test_leaf(int ray, int leaf, const There& there)
    {
        const int code = -leaf - 1, begin = code >> 4, end = begin + (code & 15);
        const auto of_frame = [&](int k) { return (Float8)frame[k][ray]; };
        for (int number = begin; number < end; number += SIMD_WIDTH) {
            const float* rows[SIMD_WIDTH];
            for (int k = 0; k < SIMD_WIDTH; ++k)
                rows[k] = faces + size_t(unsigned(min(number + k, end - 1))) * FACE;
            Corners corners[3];
            Int8 both = -1;
            for (int corner = 0; corner < 3; ++corner) {
                const Float8x4 at = columns_of(rows, 4 * corner);
                corners[corner] = project(of_frame, at.a, at.b, at.c);
                if (SIDES == FRONTS_AND_MARKED && corner == 1)
                    both = (Int8)at.d != 0;
            }
            const Weights weights(corners);
            const Int8 inside = weights.inside<SIDES>(both);
            if (!any(inside))
                continue;
            const Float8 t = weights.depth(corners);
            for (unsigned left = movemask(inside & (t < depth[ray]) & (t > near[ray])); left; left &= left - 1) {
                const int k = ctz(left), met = min(number + k, end - 1);
                if (t[k] < depth[ray] && there(ray, met, t[k])) {
                    depth[ray] = t[k];
                    face[ray] = met;
                }
            }
        }
    }

    // Takes what is on top away, and what lies behind the ray's hit; returns what is on top then.
    int drop(int ray)
    {
        int top = height[ray] - 1;
        while (as_float(entry[ray][top]) >= depth[ray])
            --top;
        height[ray] = top;
        return child[ray][top];
    }

    // Puts a ray where it goes on, if it does; its memory is asked for.
    void sort(int ray, int next)
    {
        walking[num_walking] = ray;
        num_walking += next > 0;
        at_leaf[num_at_leaf] = ray;
        num_at_leaf += next < 0;
        const unsigned row = next < 0 ? unsigned(-next - 1) >> 4 : unsigned(next);
        const float* const place = next < 0 ? faces + size_t(row) * FACE : nodes + size_t(row) * NODE;
        const char* const memory = reinterpret_cast<const char*>(place);
        __builtin_prefetch(memory);
        __builtin_prefetch(memory + 64);
        __builtin_prefetch(memory + 128);
        __builtin_prefetch(memory + 192);
    }

    // The nearest face of each ray that was started, nearer than its depth; with ANY, the first one found.
    template <Sides SIDES, bool ANY, class There> void walk(const There& there)
    {
        while (num_walking + num_at_leaf > 0) {
            if (num_walking >= INTERLEAVED_RAYS || num_at_leaf == 0) {
                const int count = num_walking;
                num_walking = 0;
                for (int i = 0; i < count; ++i) {
                    const int ray = walking[i];
                    sort(ray, step(ray));
                }
            } else {
                const int count = num_at_leaf;
                num_at_leaf = 0;
                for (int i = 0; i < count; ++i) {
                    const int ray = at_leaf[i];
                    test_leaf<SIDES>(ray, child[ray][height[ray]], there);
                    if (!ANY || face[ray] < 0)
                        sort(ray, drop(ray));
                }
            }
        }
    }
};

template <class Meshes> inline const float* node_rows(const Meshes& meshes, int mesh)
{
    return reinterpret_cast<const float*>(meshes.nodes.data) + 4 * size_t(wp::index(meshes.node_start, mesh));
}

template <class Meshes> inline const float* face_rows(const Meshes& meshes, int mesh)
{
    return reinterpret_cast<const float*>(meshes.faces.data) + 4 * size_t(wp::index(meshes.face_start, mesh));
}

}  // namespace warpcam
