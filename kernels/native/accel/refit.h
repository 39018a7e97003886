// Meshes whose corners move: the faces and boxes of their trees, from the leaves up.
#pragma once
#include "accel/reorder.h"

namespace warpcam {

constexpr int RUN_FACES = THREADS;  // of leaves that a block moves on CUDA
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

// A child and its box. A box of nothing, as of corners that are no numbers, makes a child that is not there.
template <class Array> WARPCAM_DEVICE void put_box(const Array& nodes, int row, int child, int code, Bounds box)
{
#if defined(__CUDA_ARCH__)
    const bool there = box.low.x <= box.high.x;
    const Vec3 low = there ? box.low : Vec3 { ABSENT, ABSENT, ABSENT },
               high = there ? box.high : Vec3 { ABSENT, ABSENT, ABSENT };
    float4* const to = reinterpret_cast<float4*>(nodes.data) + (row + 2 * child);
    to[0] = make_float4(low.x, low.y, low.z, as_float(code));
    to[1] = make_float4(high.x, high.y, high.z, 0.0f);
#else
    if (!(box.low.x <= box.high.x))
        box = { { ABSENT, ABSENT, ABSENT }, { ABSENT, ABSENT, ABSENT } };
    for (int axis = 0; axis < 3; ++axis) {
        nodes.data[row + axis][child] = component(box.low, axis);
        nodes.data[row + 3 + axis][child] = component(box.high, axis);
    }
#endif
}

// Writes a corner of a face, at its place among the rows.
template <class Moving, class Meshes>
WARPCAM_DEVICE void put_corner(const Moving& moving, const Meshes& meshes, int face, int at, int k, Vec3 place)
{
    const int back = moving.backs ? moving.triangles.shape[0] + face : 0;
    const float mark = as_float(k == 0 ? face : k == 1 ? back : moving.backs);
#if defined(__CUDA_ARCH__)
    reinterpret_cast<float4*>(meshes.faces.data)[at] = make_float4(place.x, place.y, place.z, mark);
#else
    auto& to = meshes.faces.data[at];
    to[0] = place.x, to[1] = place.y, to[2] = place.z, to[3] = mark;
#endif
}

#if defined(__CUDA_ARCH__)

// Numbers in the order of floats, and back.
WARPCAM_DEVICE int in_order(float x) { return as_int(x) ^ ((as_int(x) >> 31) & 0x7fffffff); }
WARPCAM_DEVICE float from_order(int x) { return as_float(x ^ ((x >> 31) & 0x7fffffff)); }

// The box around those of a warp's lanes. For whole warps.
WARPCAM_DEVICE Bounds joined_by_warp(const Bounds& box)
{
    const auto least = [](float x) { return from_order(warp_reduce_min(in_order(x))); };
    const auto most = [](float x) { return from_order(warp_reduce_max(in_order(x))); };
    return { { least(box.low.x), least(box.low.y), least(box.low.z) },
             { most(box.high.x), most(box.high.y), most(box.high.z) } };
}

// A run of an instance's leaves: their faces, their boxes and the box around all, by a block. Corners of faces lie in a
// row, and threads write them so; then a thread has a leaf.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_run(const Moving& moving, const Meshes& meshes, const Points& points, int instance, int number,
                             int thread)
{
    constexpr int EACH = 3 * RUN_FACES / THREADS, WARPS = THREADS / WARP_SIZE;  // corners of a thread
    WARPCAM_SHARED float corners[3][3 * RUN_FACES];
    WARPCAM_SHARED Bounds boxes[WARPS];
    const auto run = wp::index(moving.runs, number);
    const int asset = wp::index(moving.assets, instance), base = wp::index(moving.bases, instance);
    const int nodes = wp::index(meshes.node_start, asset);
    const int rows = wp::index(meshes.face_start, asset) + FACE_ROWS * run[2], count = 3 * run[3];
    const int* const order = &wp::index(moving.order, instance, run[2]);
    int face[EACH], point[EACH];
    Vec3 place[EACH];
#pragma unroll
    for (int i = 0; i < EACH; ++i) {  // all of a thread's at once, for memory is waited for
        const int at = thread + i * THREADS;
        face[i] = at < count ? order[at / 3] : 0;
    }
#pragma unroll
    for (int i = 0; i < EACH; ++i) {
        const int at = thread + i * THREADS;
        point[i] = at < count ? base + moving.triangles.data[face[i]][at % 3] : 0;
    }
#pragma unroll
    for (int i = 0; i < EACH; ++i)
        if (thread + i * THREADS < count)
            place[i] = as_vec3(points.data[point[i]]);
#pragma unroll
    for (int i = 0; i < EACH; ++i) {
        const int at = thread + i * THREADS;
        if (at < count) {
            put_corner(moving, meshes, face[i], rows + at, at % 3, place[i]);
            corners[0][at] = place[i].x;
            corners[1][at] = place[i].y;
            corners[2][at] = place[i].z;
        }
    }
    block_sync();
    Bounds all = nowhere();
    for (int leaf = run[0] + thread; leaf <= run[1]; leaf += THREADS) {
        const auto entry = wp::index(moving.entries, leaf);
        const int code = -entry[2] - 1, begin = 3 * ((code >> 4) - run[2]), end = begin + 3 * (code & 15);
        Bounds box = nowhere();
        for (int at = begin; at < end; ++at)
            box.include({ corners[0][at], corners[1][at], corners[2][at] });
        put_box(meshes.nodes, nodes + NODE_ROWS * entry[0], entry[1], entry[2], box);
        if (box.low.x <= box.high.x)
            all = joined(all, box);
    }
    all = joined_by_warp(all);
    if (thread % WARP_SIZE == 0)
        boxes[thread / WARP_SIZE] = all;
    block_sync();
    if (thread == 0) {
        for (int warp = 1; warp < WARPS; ++warp)
            all = joined(all, boxes[warp]);
        float* const to = moving.boxes.data + 6 * (instance * moving.runs.shape[0] + number);
        to[0] = all.low.x, to[1] = all.low.y, to[2] = all.low.z;
        to[3] = all.high.x, to[4] = all.high.y, to[5] = all.high.z;
    }
}

#else

// A leaf's faces and its box.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_leaf(const Moving& moving, const Meshes& meshes, const Points& points, int leaf)
{
    const int instance = leaf / moving.num_leaves;
    const auto entry = wp::index(moving.entries, leaf - instance * moving.num_leaves);
    const int asset = wp::index(moving.assets, instance), code = -entry[2] - 1, first = code >> 4, count = code & 15;
    const int nodes = wp::index(meshes.node_start, asset), base = wp::index(moving.bases, instance);
    const int faces = wp::index(meshes.face_start, asset) + FACE_ROWS * first, row = nodes + NODE_ROWS * entry[0];
    const int* const order = &wp::index(moving.order, instance, first);
    Bounds box = nowhere();
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            const Vec3 place = as_vec3(points.data[base + moving.triangles.data[order[i]][k]]);
            put_corner(moving, meshes, order[i], faces + FACE_ROWS * i + k, k, place);
            box.include(place);
        }
    put_box(meshes.nodes, row, entry[1], entry[2], box);
}

#endif

// Faces and boxes of leaves. `index` counts instances, then on CUDA runs of leaves and threads of their blocks, on a CPU
// leaves.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void move_leaves(const Moving& moving, const Meshes& meshes, const Points& points, int index)
{
#if defined(__CUDA_ARCH__)
    const int runs = moving.runs.shape[0], block = index / THREADS, instance = block / runs;
    move_run(moving, meshes, points, instance, block - instance * runs, index % THREADS);
#else
    for_run(index, moving.assets.shape[0] * moving.num_leaves, [&](int i) { move_leaf(moving, meshes, points, i); });
#endif
}

template <class Meshes> WARPCAM_DEVICE void put_bounds(const Meshes& meshes, int asset, const Bounds& box)
{
    for (int axis = 0; axis < 3; ++axis) {
        meshes.bounds_min.data[asset][axis] = component(box.low, axis);
        meshes.bounds_max.data[asset][axis] = component(box.high, axis);
    }
}

// The box of a whole mesh, of those of its runs; on CUDA, where `index` counts instances, then lanes.
template <class Moving, class Meshes>
WARPCAM_DEVICE void move_bounds(const Moving& moving, const Meshes& meshes, int index)
{
#if defined(__CUDA_ARCH__)
    const int lane = index % WARP_SIZE, instance = index / WARP_SIZE, runs = moving.runs.shape[0];
    Bounds box = nowhere();
    for (int run = lane; run < runs; run += WARP_SIZE) {
        const float* const of = moving.boxes.data + 6 * (instance * runs + run);
        box = joined(box, { { of[0], of[1], of[2] }, { of[3], of[4], of[5] } });
    }
    box = joined_by_warp(box);
    if (lane == 0)
        put_bounds(meshes, wp::index(moving.assets, instance), box);
#endif
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

// All levels from `level` on up to the root, on a CPU the mesh's bounds, and whether its faces get a new order for the
// next frame: one instance a block. `index` counts instances, then (CUDA) threads of the block.
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
#if !defined(__CUDA_ARCH__)
    put_bounds(meshes, asset, node_box(meshes, nodes, 0));
#endif
    keep_order(moving, meshes, points, instance, thread);
}

}  // namespace warpcam
