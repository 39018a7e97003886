// Whether the tree of a mesh that moves is still a good one, and its faces in a new order if it is not.
//
// A tree keeps its nodes and how many faces each leaf has; which faces these are is what changes: they are dealt out along
// a curve through where they are now. Measured is the area of all boxes against that of the boxes around single faces,
// so that neither the size of the mesh nor the sizes of its faces count.
#pragma once
#include "bvh4.h"
#include "vectors.h"

namespace warpcam {

constexpr float DECAYED = 1.5f;  // times as much as it was after the last order
constexpr float UNKNOWN = -1.0f;  // how good an order is is measured when the boxes have followed
constexpr float FRESH = -2.0f;  // not even once
constexpr int EVERY = 8;  // frames from one measurement to the next
constexpr int DIGIT_BITS = 4, DIGITS = 1 << DIGIT_BITS, KEY_BITS = 32;
constexpr float CELLS = 1024.0f;  // of the curve along each axis

struct Bounds {
    Vec low, high;

    WARPCAM_FN void include(Vec v)
    {
        low = { lower(low.x, v.x), lower(low.y, v.y), lower(low.z, v.z) };
        high = { upper(high.x, v.x), upper(high.y, v.y), upper(high.z, v.z) };
    }
    WARPCAM_FN float area() const  // half of it
    {
        const Vec s = high - low;
        return s.x * s.y + s.y * s.z + s.z * s.x;
    }
};

WARPCAM_FN Bounds nowhere()
{
    return { { FAR_AWAY, FAR_AWAY, FAR_AWAY }, { -FAR_AWAY, -FAR_AWAY, -FAR_AWAY } };
}

// The box of a child; nothing where it is not there.
template <class Array> WARPCAM_FN Bounds child_box(const Array& nodes, int row, int child)
{
#if defined(__CUDA_ARCH__)
    return { to_vec(nodes.data[row + 2 * child]), to_vec(nodes.data[row + 2 * child + 1]) };
#else
    Bounds box;
    box.low = { nodes.data[row][child], nodes.data[row + 1][child], nodes.data[row + 2][child] };
    box.high = { nodes.data[row + 3][child], nodes.data[row + 4][child], nodes.data[row + 5][child] };
    return box;
#endif
}

// The sum over a block's threads, for all of them.
WARPCAM_FN float total(float mine, float* room, int thread)
{
    room[thread] = mine;
    block_barrier();
    float sum = 0.0f;
    for (int i = 0; i < THREADS; ++i)
        sum += room[i];
    block_barrier();
    return sum;
}

template <class Moving, class Meshes>
WARPCAM_FN float looseness(const Moving& moving, const Meshes& meshes, int asset, float* room, int thread)
{
    const int nodes = wp::index(meshes.node_start, asset), faces = wp::index(meshes.face_start, asset);
    const int rows = moving.order.shape[1];
    float boxes = 0.0f, alone = 0.0f;
    for (int i = thread; i < 4 * moving.num_nodes; i += THREADS) {
        const Bounds box = child_box(meshes.nodes, nodes + NODE_ROWS * (i / 4), i % 4);
        boxes += box.low.x < 1.0e29f ? box.area() : 0.0f;
    }
    for (int i = thread; i < rows; i += THREADS) {
        Bounds box = nowhere();
        for (int k = 0; k < 3; ++k)
            box.include(to_vec(meshes.faces.data[faces + 3 * i + k]));
        alone += box.area();
    }
    boxes = total(boxes, room, thread);
    alone = total(alone, room, thread);
    return boxes / upper(alone, TINY);
}

// Every third bit of a number below 1024.
WARPCAM_FN unsigned spread(unsigned x)
{
    x = (x | x << 16) & 0x030000ffu;
    x = (x | x << 8) & 0x0300f00fu;
    x = (x | x << 4) & 0x030c30c3u;
    return (x | x << 2) & 0x09249249u;
}

WARPCAM_FN unsigned cell_of(float x, float low, float rate) { return unsigned(between((x - low) * rate, 0.0f, CELLS - 1.0f)); }

// Three times the middle of a face.
template <class Moving, class Points> WARPCAM_FN Vec middle_of(const Moving& moving, const Points& points, int base, int face)
{
    const auto corners = wp::index(moving.triangles, face);
    return to_vec(points.data[base + corners[0]]) + to_vec(points.data[base + corners[1]])
        + to_vec(points.data[base + corners[2]]);
}

// Sorts pairs of a key and a value, by a block's threads together. Each thread has a run of them, so that equal digits
// keep their order. The words are bits of the numbers in `from` and `to`, keys before values.
WARPCAM_FN void sort_by_digit(const float* from, float* to, int count, int shift, int* starts, int thread)
{
    const int run = (count + THREADS - 1) / THREADS, first = lower_int(thread * run, count), end = lower_int(first + run, count);
    for (int digit = 0; digit < DIGITS; ++digit)
        starts[digit * THREADS + thread] = 0;
    for (int i = first; i < end; ++i)
        ++starts[int(unsigned(as_int(from[i])) >> shift & (DIGITS - 1)) * THREADS + thread];
    block_barrier();
    if (thread == 0)
        for (int i = 0, sum = 0; i < DIGITS * THREADS; ++i) {
            const int number = starts[i];
            starts[i] = sum;
            sum += number;
        }
    block_barrier();
    for (int i = first; i < end; ++i) {
        const int place = starts[int(unsigned(as_int(from[i])) >> shift & (DIGITS - 1)) * THREADS + thread]++;
        to[place] = from[i];
        to[count + place] = from[count + i];
    }
    block_barrier();
}

// `room` holds 6 * THREADS numbers. The normals of the mesh's corners, which are written anew in each frame, lend theirs.
template <class Moving, class Meshes, class Points>
WARPCAM_FN void deal_out(const Moving& moving, const Meshes& meshes, const Points& points, int instance, float* room,
                         int* starts, int thread)
{
    const int asset = wp::index(moving.assets, instance), base = wp::index(moving.bases, instance);
    const int count = moving.triangles.shape[0], rows = moving.order.shape[1];
    Bounds all = nowhere();
    for (int face = thread; face < count; face += THREADS)
        all.include(middle_of(moving, points, base, face));
    const float mine[6] = { all.low.x, all.low.y, all.low.z, all.high.x, all.high.y, all.high.z };
    for (int k = 0; k < 6; ++k)
        room[6 * thread + k] = mine[k];
    block_barrier();
    for (int i = 0; i < THREADS; ++i) {
        all.include({ room[6 * i], room[6 * i + 1], room[6 * i + 2] });
        all.include({ room[6 * i + 3], room[6 * i + 4], room[6 * i + 5] });
    }
    block_barrier();
    const Vec size = all.high - all.low;
    const float rate = CELLS / upper(upper(size.x, upper(size.y, size.z)), 1.0e-30f);
    float* pairs = &meshes.normals.data[3 * wp::index(meshes.corner_start, asset)][0];
    float* others = pairs + 2 * count;
    for (int face = thread; face < count; face += THREADS) {
        const Vec at = middle_of(moving, points, base, face);
        const unsigned key = spread(cell_of(at.x, all.low.x, rate)) | spread(cell_of(at.y, all.low.y, rate)) << 1
            | spread(cell_of(at.z, all.low.z, rate)) << 2;
        pairs[face] = as_float(int(key));
        pairs[count + face] = as_float(face);
    }
    block_barrier();
    for (int shift = 0; shift < KEY_BITS; shift += 2 * DIGIT_BITS) {
        sort_by_digit(pairs, others, count, shift, starts, thread);
        sort_by_digit(others, pairs, count, shift + DIGIT_BITS, starts, thread);
    }
    // There are at least as many rows as faces: those of long faces, which once stood in several leaves.
    for (int row = thread; row < rows; row += THREADS)
        *wp::address(moving.order, instance, row) = as_int(pairs[count + int((long long)(row) * count / rows)]);
}

// One instance a block; `index` counts instances, then (CUDA) threads of the block.
template <class Moving, class Meshes, class Points>
WARPCAM_FN void reorder(const Moving& moving, const Meshes& meshes, const Points& points, int index)
{
    WARPCAM_SHARED float room[6 * THREADS];
    WARPCAM_SHARED int starts[DIGITS * THREADS];
    const int thread = index % THREADS, instance = index / THREADS;
    const int age = moving.ages.data[instance];
    const float known = moving.looseness.data[instance];
    block_barrier();
    if (thread == 0)
        moving.ages.data[instance] = (age + 1) % EVERY;
    if (known == FRESH && thread == 0)
        moving.looseness.data[instance] = UNKNOWN;
    if (known == FRESH || (known >= 0.0f && age != 0))
        return;
    const float now = looseness(moving, meshes, wp::index(moving.assets, instance), room, thread);
    if (thread == 0 && known < 0.0f)
        moving.looseness.data[instance] = now;
    if (known < 0.0f || !(now > DECAYED * known))
        return;
    deal_out(moving, meshes, points, instance, room, starts, thread);
    if (thread == 0)
        moving.looseness.data[instance] = UNKNOWN;
}

}  // namespace warpcam
