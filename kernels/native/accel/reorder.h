// Reorders the faces of a moving mesh whose tree has become poor.
//
// A tree keeps its nodes and the number of faces of each leaf; the faces in a leaf change: faces are dealt out along a
// space-filling curve through their current positions. The measure is the area of all boxes relative to that of the
// boxes around single faces, so that neither the size of the mesh nor the sizes of its faces count.
#pragma once
#include "accel/bvh4.h"
#include "core/vec3.h"

namespace warpcam {

constexpr float DECAYED = 1.5f;  // times as much as it was after the last order
constexpr float UNKNOWN = -1.0f;  // how good an order is was not measured yet
constexpr int MEASURE_PERIOD = 16;  // frames that share in a measurement
constexpr float ABSENT = 1.0e30f;  // all bounds of a child that is not there, as build/bvh4_builder.h has it
constexpr int DIGIT_BITS = 4, DIGITS = 1 << DIGIT_BITS, KEY_BITS = 32;
constexpr float CURVE_CELLS = 1024.0f;  // of the curve along each axis

struct Bounds {
    Vec3 low, high;

    WARPCAM_DEVICE void include(Vec3 v)
    {
        low = { min(v.x, low.x), min(v.y, low.y), min(v.z, low.z) };  // in this order, so that NaNs do not count
        high = { max(v.x, high.x), max(v.y, high.y), max(v.z, high.z) };
    }
    WARPCAM_DEVICE float area() const  // half of it
    {
        const Vec3 s = high - low;
        return s.x * s.y + s.y * s.z + s.z * s.x;
    }
};

WARPCAM_DEVICE Bounds nowhere() { return { { MISS, MISS, MISS }, { -MISS, -MISS, -MISS } }; }

// The box of a child; nothing where it is not there.
template <class Array> WARPCAM_DEVICE Bounds child_box(const Array& nodes, int row, int child)
{
#if defined(__CUDA_ARCH__)
    return { as_vec3(nodes.data[row + 2 * child]), as_vec3(nodes.data[row + 2 * child + 1]) };
#else
    Bounds box;
    box.low = { nodes.data[row][child], nodes.data[row + 1][child], nodes.data[row + 2][child] };
    box.high = { nodes.data[row + 3][child], nodes.data[row + 4][child], nodes.data[row + 5][child] };
    return box;
#endif
}

// The sum over a block's threads, for all of them.
WARPCAM_DEVICE float total(float mine, float* room, int thread)
{
    room[thread] = mine;
    block_sync();
    float sum = 0.0f;
    for (int i = 0; i < THREADS; ++i)
        sum += room[i];
    block_sync();
    return sum;
}

// The areas of all boxes, and of those around single faces: a share of them in each of EVERY frames.
template <class Moving, class Meshes> WARPCAM_DEVICE void measure(const Moving& moving, const Meshes& meshes, int asset,
                                                                  int share, float* room, int thread, float& boxes,
                                                                  float& alone)
{
    const int nodes = wp::index(meshes.node_start, asset), faces = wp::index(meshes.face_start, asset);
    const int rows = moving.order.shape[1];
    float in_boxes = 0.0f, in_faces = 0.0f;
    for (int i = MEASURE_PERIOD * thread + share; i < 4 * moving.num_nodes; i += MEASURE_PERIOD * THREADS) {
        const Bounds box = child_box(meshes.nodes, nodes + NODE_ROWS * (i / 4), i % 4);
        in_boxes += box.low.x < ABSENT ? box.area() : 0.0f;
    }
    for (int i = MEASURE_PERIOD * thread + share; i < rows; i += MEASURE_PERIOD * THREADS) {
        Bounds box = nowhere();
        for (int k = 0; k < 3; ++k)
            box.include(as_vec3(meshes.faces.data[faces + FACE_ROWS * i + k]));
        in_faces += box.low.x < ABSENT ? box.area() : 0.0f;
    }
    boxes = total(in_boxes, room, thread);
    alone = total(in_faces, room, thread);
}

// Moves the bits of a number below 1024 to every third place.
WARPCAM_DEVICE unsigned expand_bits(unsigned x)
{
    x = (x | x << 16) & 0x030000ffu;
    x = (x | x << 8) & 0x0300f00fu;
    x = (x | x << 4) & 0x030c30c3u;
    return (x | x << 2) & 0x09249249u;
}

WARPCAM_DEVICE unsigned cell_of(float x, float low, float rate)
{
    return unsigned(clamp((x - low) * rate, 0.0f, CURVE_CELLS - 1.0f));
}

// Three times the middle of a face.
template <class Moving, class Points>
WARPCAM_DEVICE Vec3 middle_of(const Moving& moving, const Points& points, int base, int face)
{
    const auto corners = wp::index(moving.triangles, face);
    return as_vec3(points.data[base + corners[0]]) + as_vec3(points.data[base + corners[1]])
           + as_vec3(points.data[base + corners[2]]);
}

// Sorts pairs of a key and a value, by a block's threads together. Each thread has a run of them, so that equal digits
// keep their order. The words are bits of the numbers in `from` and `to`, keys before values.
WARPCAM_DEVICE void sort_by_digit(const float* from, float* to, int count, int shift, int* starts, int thread)
{
    const int run = (count + THREADS - 1) / THREADS, first = min(thread * run, count), end = min(first + run, count);
    for (int digit = 0; digit < DIGITS; ++digit)
        starts[digit * THREADS + thread] = 0;
    for (int i = first; i < end; ++i)
        ++starts[int(unsigned(as_int(from[i])) >> shift & (DIGITS - 1)) * THREADS + thread];
    block_sync();
    if (thread == 0)
        for (int i = 0, sum = 0; i < DIGITS * THREADS; ++i) {
            const int number = starts[i];
            starts[i] = sum;
            sum += number;
        }
    block_sync();
    for (int i = first; i < end; ++i) {
        const int place = starts[int(unsigned(as_int(from[i])) >> shift & (DIGITS - 1)) * THREADS + thread]++;
        to[place] = from[i];
        to[count + place] = from[count + i];
    }
    block_sync();
}

// `room` holds 6 * THREADS numbers. The normals of the mesh's corners, which are written anew in each frame, lend
// theirs.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void deal_out(const Moving& moving, const Meshes& meshes, const Points& points, int instance,
                             float* room, int* starts, int thread)
{
    const int asset = wp::index(moving.assets, instance), base = wp::index(moving.bases, instance);
    const int count = moving.triangles.shape[0], rows = moving.order.shape[1];
    Bounds all = nowhere();
    for (int face = thread; face < count; face += THREADS)
        all.include(middle_of(moving, points, base, face));
    const float mine[6] = { all.low.x, all.low.y, all.low.z, all.high.x, all.high.y, all.high.z };
    for (int k = 0; k < 6; ++k)
        room[6 * thread + k] = mine[k];
    block_sync();
    for (int i = 0; i < THREADS; ++i) {
        all.include({ room[6 * i], room[6 * i + 1], room[6 * i + 2] });
        all.include({ room[6 * i + 3], room[6 * i + 4], room[6 * i + 5] });
    }
    block_sync();
    const Vec3 size = all.high - all.low;
    const float rate = CURVE_CELLS / max(max(size.x, max(size.y, size.z)), 1.0e-30f);
    float* pairs = &meshes.normals.data[3 * wp::index(meshes.corner_start, asset)][0];
    float* others = pairs + 2 * count;
    for (int face = thread; face < count; face += THREADS) {
        const Vec3 at = middle_of(moving, points, base, face);
        const unsigned key = expand_bits(cell_of(at.x, all.low.x, rate))
                             | expand_bits(cell_of(at.y, all.low.y, rate)) << 1
                             | expand_bits(cell_of(at.z, all.low.z, rate)) << 2;
        pairs[face] = as_float(int(key));
        pairs[count + face] = as_float(face);
    }
    block_sync();
    for (int shift = 0; shift < KEY_BITS; shift += 2 * DIGIT_BITS) {
        sort_by_digit(pairs, others, count, shift, starts, thread);
        sort_by_digit(others, pairs, count, shift + DIGIT_BITS, starts, thread);
    }
    // There are at least as many rows as faces: those of long faces, which once stood in several leaves.
    for (int row = thread; row < rows; row += THREADS)
        *wp::address(moving.order, instance, row) = as_int(pairs[count + int((long long)(row)*count / rows)]);
}

// Goes on measuring the tree of one instance, and gives its faces a new order, for the next frame, where it has
// decayed.
template <class Moving, class Meshes, class Points>
WARPCAM_DEVICE void keep_order(const Moving& moving, const Meshes& meshes, const Points& points, int instance,
                               int thread)
{
    WARPCAM_SHARED float room[6 * THREADS];
    WARPCAM_SHARED int starts[DIGITS * THREADS];
    const int age = moving.ages.data[instance], share = age % MEASURE_PERIOD;
    const float as_ordered = moving.looseness.data[instance];
    float boxes, alone;
    measure(moving, meshes, wp::index(moving.assets, instance), share, room, thread, boxes, alone);
    if (share > 0) {
        boxes += moving.areas.data[instance][0];
        alone += moving.areas.data[instance][1];
    }
    block_sync();
    if (thread == 0) {
        moving.ages.data[instance] = age + 1 < 2 * MEASURE_PERIOD ? age + 1 : MEASURE_PERIOD;
        moving.areas.data[instance][0] = boxes;
        moving.areas.data[instance][1] = alone;
    }
    if (share + 1 < MEASURE_PERIOD
        || age < MEASURE_PERIOD)  // in the first frames the measurement may have begun in the middle
        return;
    const float now = boxes / max(alone, MIN_NORMAL);
    const bool decayed = as_ordered >= 0.0f && now > DECAYED * as_ordered;
    if (decayed)
        deal_out(moving, meshes, points, instance, room, starts, thread);
    if (thread == 0 && (decayed || as_ordered < 0.0f))
        moving.looseness.data[instance] = decayed ? UNKNOWN : now;
}

}  // namespace warpcam
