// Meshes whose corners move: the faces and boxes of their trees, from the leaves up.
#pragma once
#include "accel/reorder.h"

namespace warpcam {

constexpr int LEAF_LANES = 8;  // a leaf has at most 15 faces of three corners, most have 2 to 6
constexpr int REFIT_RUN = 32;  // of leaves, children or faces that an index of a CPU's launch does

// On a CPU each index of a launch begins with a copy of all arguments, which takes as long as a leaf: it does a run of
// `total` then.
template <class Each> WARPCAM_DEVICE void for_run(int index, int total, const Each& each)
{
#if defined(__CUDA_ARCH__)
    each(index);
#else
    const int begin = REFIT_RUN * index, end = begin + REFIT_RUN < total ? begin + REFIT_RUN : total;
    for (int i = begin; i < end; ++i)
        each(i);
#endif
}

WARPCAM_DEVICE Bounds joined(const Bounds& a, const Bounds& b)
{
    return { { min(a.low.x, b.low.x), min(a.low.y, b.low.y), min(a.low.z, b.low.z) },
             { max(a.high.x, b.high.x), max(a.high.y, b.high.y), max(a.high.z, b.high.z) } };
}

#if defined(__CUDA_ARCH__)

// One of a child's two rows: see put_box.
template <class Array>
WARPCAM_DEVICE void put_half(const Array& nodes, int row, int child, int code, const Bounds& box, int half)
{
    const bool there = box.low.x <= box.high.x;
    const Vec3 at = half ? box.high : box.low;
    reinterpret_cast<float4*>(nodes.data)[row + 2 * child + half] =
        make_float4(there ? at.x : ABSENT, there ? at.y : ABSENT, there ? at.z : ABSENT, half ? 0.0f : as_float(code));
}

#endif

// A child and its box. A box of nothing, as of corners that are no numbers, makes a child that is not there.
template <class Array> WARPCAM_DEVICE void put_box(const Array& nodes, int row, int child, int code, Bounds box)
{
#if defined(__CUDA_ARCH__)
    for (int half = 0; half < 2; ++half)
        put_half(nodes, row, child, code, box, half);
#else
    if (!(box.low.x <= box.high.x))
        box = { { ABSENT, ABSENT, ABSENT }, { ABSENT, ABSENT, ABSENT } };
    for (int axis = 0; axis < 3; ++axis) {
        nodes.data[row + axis][child] = component(box.low, axis);
        nodes.data[row + 3 + axis][child] = component(box.high, axis);
    }
#endif
}

// Writes a corner of a face, at its place among the rows; where it is now.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE Vec3 move_corner(const Moving& moving, const Meshes& meshes, const Points& points, int base, int face,
                                int at, int k)
{
    const Vec3 place = as_vec3(points.data[base + moving.triangles.data[face][k]]);
    const int back = moving.backs ? moving.triangles.shape[0] + face : 0;
    const float mark = as_float(k == 0 ? face : k == 1 ? back : moving.backs);
#if defined(__CUDA_ARCH__)
    reinterpret_cast<float4*>(meshes.faces.data)[at] = make_float4(place.x, place.y, place.z, mark);
#else
    auto& to = meshes.faces.data[at];
    to[0] = place.x, to[1] = place.y, to[2] = place.z, to[3] = mark;
#endif
    return place;
}

// A leaf's faces and its box. `index` counts instances, leaves, then (CUDA) lanes, a corner each: what they write lies
// in a row, as half of a sector of memory takes as long as a whole one.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_leaf(const Moving& moving, const Meshes& meshes, const Points& points, int index)
{
#if defined(__CUDA_ARCH__)
    const int lane = index % LEAF_LANES, leaf = index / LEAF_LANES;
#else
    const int leaf = index;
#endif
    const int instance = leaf / moving.num_leaves;
    const auto entry = wp::index(moving.entries, leaf - instance * moving.num_leaves);
    const int asset = wp::index(moving.assets, instance), code = -entry[2] - 1, first = code >> 4, count = code & 15;
    const int nodes = wp::index(meshes.node_start, asset), base = wp::index(moving.bases, instance);
    const int faces = wp::index(meshes.face_start, asset) + FACE_ROWS * first, row = nodes + NODE_ROWS * entry[0];
    const int* const order = &wp::index(moving.order, instance, first);
    Bounds box = nowhere();
#if defined(__CUDA_ARCH__)
    for (int i = lane; i < 3 * count; i += LEAF_LANES)
        box.include(
            move_corner(moving, meshes, points, base, order[i / 3], faces + FACE_ROWS * (i / 3) + i % 3, i % 3));
    const unsigned mask = ((1u << LEAF_LANES) - 1) << (threadIdx.x % WARP_SIZE / LEAF_LANES * LEAF_LANES);
    for (int step = LEAF_LANES / 2; step > 0; step /= 2) {
        const Bounds other = { { __shfl_xor_sync(mask, box.low.x, step), __shfl_xor_sync(mask, box.low.y, step),
                                 __shfl_xor_sync(mask, box.low.z, step) },
                               { __shfl_xor_sync(mask, box.high.x, step), __shfl_xor_sync(mask, box.high.y, step),
                                 __shfl_xor_sync(mask, box.high.z, step) } };
        box = joined(box, other);
    }
    if (lane < 2)
        put_half(meshes.nodes, row, entry[1], entry[2], box, lane);
#else
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k)
            box.include(move_corner(moving, meshes, points, base, order[i], faces + FACE_ROWS * i + k, k));
    put_box(meshes.nodes, row, entry[1], entry[2], box);
#endif
}

template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_leaves(const Moving& moving, const Meshes& meshes, const Points& points, int index)
{
    for_run(index, moving.assets.shape[0] * moving.num_leaves, [&](int i) { move_leaf(moving, meshes, points, i); });
}

// Computes a face's plane, or what the face was made of (see Moving).
template <class Moving, class Points>
WARPCAM_DEVICE Vec3 flat_normal(const Moving& moving, const Points& points, const Points& normals, int base, int face)
{
    const auto corners = wp::index(moving.triangles, face);
    Vec3 at[3];
    for (int k = 0; k < 3; ++k) {
        at[k] = as_vec3(points.data[base + corners[k]]);
        if (face < moving.num_flat)
            at[k] = at[k] - moving.offset * as_vec3(normals.data[base + corners[k]]);
    }
    return normalized(cross(at[1] - at[0], at[2] - at[0]));
}

// Normals at the corners of a face that has no back. `index` counts instances, then faces, on CUDA filled up to whole
// warps, which write what their faces have to write one after another.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_face(const Moving& moving, const Meshes& meshes, const Points& points, const Points& normals,
                              int index)
{
    const int count = moving.triangles.shape[0];
#if defined(__CUDA_ARCH__)
    const int whole = (count + WARP_SIZE - 1) / WARP_SIZE * WARP_SIZE;
#else
    const int whole = count;
#endif
    const int instance = index / whole, face = index - instance * whole, base = wp::index(moving.bases, instance);
    const int corner = 3 * wp::index(meshes.corner_start, wp::index(moving.assets, instance));
    if (face < moving.num_smooth) {
        const auto corners = wp::index(moving.triangles, face);
        for (int k = 0; k < 3; ++k)
            meshes.normals.data[corner + 3 * face + k] = normals.data[base + corners[k]];
    }
    const bool flat = face >= moving.num_smooth && face < count;
    const Vec3 normal = flat ? flat_normal(moving, points, normals, base, face) : Vec3 { 0.0f, 0.0f, 0.0f };
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x % WARP_SIZE, start = face - lane;
    float* const to = reinterpret_cast<float*>(meshes.normals.data + corner + 3 * start);
    for (int k = 0; k < 9; ++k) {
        const int number = WARP_SIZE * k + lane, whose = number / 9, axis = number % 3;
        const float x = __shfl_sync(FULL_WARP, normal.x, whose), y = __shfl_sync(FULL_WARP, normal.y, whose);
        const float z = __shfl_sync(FULL_WARP, normal.z, whose), value = axis == 0 ? x : axis == 1 ? y : z;
        if (start + whose >= moving.num_smooth && start + whose < count)
            to[number] = value;
    }
#else
    for (int k = 0; flat && k < 3; ++k)
        for (int axis = 0; axis < 3; ++axis)
            meshes.normals.data[corner + 3 * face + k][axis] = component(normal, axis);
#endif
}

template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_normals(const Moving& moving, const Meshes& meshes, const Points& points,
                                 const Points& normals, int index)
{
    for_run(index, moving.assets.shape[0] * moving.triangles.shape[0],
            [&](int i) { move_face(moving, meshes, points, normals, i); });
}

// The box around a node's children.
template <class Meshes> WARPCAM_DEVICE Bounds node_box(const Meshes& meshes, int nodes, int node)
{
    Bounds box = nowhere();
    for (int child = 0; child < 4; ++child) {
        const Bounds below = child_box(meshes.nodes, nodes + NODE_ROWS * node, child);
        if (below.low.x < ABSENT)
            box = joined(box, below);
    }
    return box;
}

// One child that is a node, whose own children's boxes are those of now.
template <class Moving, class Meshes>
WARPCAM_DEVICE void move_inner(const Moving& moving, const Meshes& meshes, int nodes, int number)
{
    const auto entry = wp::index(moving.entries, number);
    put_box(meshes.nodes, nodes + NODE_ROWS * entry[0], entry[1], entry[2], node_box(meshes, nodes, entry[2]));
}

// A level of nodes, `count` of them from entry `begin` on; `index` counts instances, then children.
template <class Moving, class Meshes>
WARPCAM_DEVICE void move_level(const Moving& moving, const Meshes& meshes, int begin, int count, int index)
{
    for_run(index, moving.assets.shape[0] * count, [&](int i) {
        const int instance = i / count;
        const int nodes = wp::index(meshes.node_start, wp::index(moving.assets, instance));
        move_inner(moving, meshes, nodes, begin + i - instance * count);
    });
}

// All levels from `level` on up to the root, the mesh's bounds, and whether its faces get a new order for the next
// frame: one instance a block. `index` counts instances, then (CUDA) threads of the block.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void finish_tree(const Moving& moving, const Meshes& meshes, const Points& points, int level, int index)
{
    const int thread = index % THREADS, instance = index / THREADS, asset = wp::index(moving.assets, instance);
    const int nodes = wp::index(meshes.node_start, asset);
    for (; level + 1 < moving.levels.shape[0]; ++level) {
        const int end = wp::index(moving.levels, level + 1);
        for (int i = wp::index(moving.levels, level) + thread; i < end; i += THREADS)
            move_inner(moving, meshes, nodes, i);
        block_sync();
    }
    if (thread == 0) {
        const Bounds all = node_box(meshes, nodes, 0);
        for (int axis = 0; axis < 3; ++axis) {
            meshes.bounds_min.data[asset][axis] = component(all.low, axis);
            meshes.bounds_max.data[asset][axis] = component(all.high, axis);
        }
    }
    keep_order(moving, meshes, points, instance, thread);
}

}  // namespace warpcam
