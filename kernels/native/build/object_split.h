// Parting the items of a node in two: each goes to one side, as a whole.
#pragma once
#include "build/build_prims.h"

namespace warpcam {
namespace bvh4_build {

// A way to part items: how many go first, and what that costs.
struct ObjectSplit {
    double cost = 1e300;
    int first = 0;  // items in the first part; 0: no split found
    int bulk = 0;   // items in the larger part
    int axis = 0;
    int bin = 0;        // the last bin of the first part
    double overlap = 0.;  // half the surface of what the two parts' boxes share; set by find_split

    void offer(double new_cost, int new_first, int count, int new_axis, int new_bin)
    {
        int new_bulk = larger(new_first, count - new_first);
        if (new_cost < cost || (new_cost == cost && new_bulk < bulk))
            *this = { new_cost, new_first, new_bulk, new_axis, new_bin, 0. };
    }
};

inline void sort_along(const BuildPrim* items, int count, int axis, unsigned char* order)
{
    for (int i = 0; i < count; ++i) {
        float key = items[i].centroid(axis);
        int j = i;
        for (; j > 0 && items[order[j - 1]].centroid(axis) > key; --j)
            order[j] = order[j - 1];
        order[j] = (unsigned char)i;
    }
}

// Parts a few items in the best of all ways that order one axis, with no part above `limit`. Returns the first part's
// count or 0.
inline int split_few(BuildPrim* items, int count, int limit)
{
    unsigned char orders[3][kSweep];
    ObjectSplit best;
    for (int axis = 0; axis < 3; ++axis) {
        unsigned char* order = orders[axis];
        sort_along(items, count, axis, order);
        double after[kSweep];
        Box box = Box::empty();
        for (int i = count - 1; i > 0; --i) {
            box.grow(items[order[i]].box);
            after[i] = box.area() * (count - i);
        }
        box = Box::empty();
        for (int i = 1; i < count; ++i) {
            box.grow(items[order[i - 1]].box);
            if (larger(i, count - i) <= limit)
                best.offer(box.area() * i + after[i], i, count, axis, 0);
        }
    }
    if (best.first == 0)
        return 0;
    BuildPrim sorted[kSweep];
    for (int i = 0; i < count; ++i)
        sorted[i] = items[orders[best.axis][i]];
    for (int i = 0; i < count; ++i)
        items[i] = sorted[i];
    return best.first;
}

// The best way to part many items by bins of their centroids, which lie in `centers`.
inline ObjectSplit find_split(BuildPrim* items, int count, int limit, const Box& centers)
{
    float scale[3];
    for (int axis = 0; axis < 3; ++axis)
        scale[axis] = centers.extent(axis) > kMinExtent ? kBins / centers.extent(axis) : 0.f;
    Box boxes[3][kBins];
    int counts[3][kBins];
    for (int axis = 0; axis < 3; ++axis)
        for (int b = 0; b < kBins; ++b) {
            boxes[axis][b] = Box::empty();
            counts[axis][b] = 0;
        }
    for (int i = 0; i < count; ++i)
        for (int axis = 0; axis < 3; ++axis) {
            int b = smaller((int)((items[i].centroid(axis) - centers.lower[axis]) * scale[axis]), kBins - 1);
            items[i].bin[axis] = (unsigned char)b;
            boxes[axis][b].grow(items[i].box);
            ++counts[axis][b];
        }
    ObjectSplit best;
    for (int axis = 0; axis < 3; ++axis) {
        double after[kBins];
        int n = 0;
        Box box = Box::empty();
        for (int b = kBins - 1; b > 0; --b) {
            box.grow(boxes[axis][b]);
            n += counts[axis][b];
            after[b] = n ? box.area() * n : 0.;
        }
        n = 0;
        box = Box::empty();
        for (int b = 0; b < kBins - 1; ++b) {
            box.grow(boxes[axis][b]);
            n += counts[axis][b];
            if (n > 0 && n < count && larger(n, count - n) <= limit)
                best.offer(box.area() * n + after[b + 1], n, count, axis, b);
        }
    }
    if (best.first == 0)
        return best;
    Box parts[2] = { Box::empty(), Box::empty() };
    for (int b = 0; b < kBins; ++b)
        parts[b > best.bin].grow(boxes[best.axis][b]);
    best.overlap = parts[0].clip(parts[1]) ? parts[0].area() : 0.;
    return best;
}

inline void part(BuildPrim* items, int count, const ObjectSplit& split)
{
    for (int i = 0, j = count - 1;; ++i, --j) {
        while (i <= j && items[i].bin[split.axis] <= split.bin)
            ++i;
        while (i <= j && items[j].bin[split.axis] > split.bin)
            --j;
        if (i >= j)
            break;
        swap(items[i], items[j]);
    }
}

// The last resort: half and half, by the order of the centroids along the axis where they spread most. Never fails.
inline int split_halves(BuildPrim* items, int count, const Box& centers)
{
    int axis = 0;
    for (int k = 1; k < 3; ++k)
        if (centers.extent(k) > centers.extent(axis))
            axis = k;
    int half = count / 2, low = 0, high = centers.extent(axis) > 0.f ? count - 1 : 0;
    while (low < high) {  // quickselect; the pivot is the median of three
        float a = items[low].centroid(axis), b = items[(low + high) / 2].centroid(axis), c = items[high].centroid(axis);
        float pivot = larger(smaller(a, b), smaller(larger(a, b), c));
        int i = low, j = high;
        while (i <= j) {
            while (items[i].centroid(axis) < pivot)
                ++i;
            while (items[j].centroid(axis) > pivot)
                --j;
            if (i <= j)
                swap(items[i++], items[j--]);
        }
        if (half <= j)
            high = j;
        else if (half >= i)
            low = i;
        else
            break;
    }
    return half;
}

}  // namespace bvh4_build
}  // namespace warpcam
