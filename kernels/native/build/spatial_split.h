// Parting the items of a node by a plane: a face on both sides of it is cut, and each side gets its share. Long thin
// faces, whose boxes are mostly empty and overlap their neighbours', then end in several small boxes (the idea of Stich
// et al., HPG 2009).
#pragma once
#include "build/build_prims.h"

namespace warpcam {
namespace bvh4_build {

constexpr int kPlanes = 16;  // a cut is sought at the borders of so many slabs along each axis

// A plane to part a node by, and what that costs.
struct SpatialSplit {
    double cost = 1e300;
    int axis = 0;
    float plane = 0.f;
};

// The equal slabs that a node's box falls into along one axis.
struct Slices {
    float lower, step, inverse;

    Slices(const Box& box, int axis)
        : lower(box.lower[axis]), step(box.extent(axis) / kPlanes), inverse(kPlanes / box.extent(axis))
    {
    }

    int slab(float x) const { return larger(smaller((int)((x - lower) * inverse), kPlanes - 1), 0); }
    float plane(int slab) const { return lower + step * (float)(slab + 1); }  // its upper end
};

// Grows the boxes of the slabs first..last by an item's shares. Not to the last bit: it only serves to compare cuts.
inline void slice(const Faces& mesh, const BuildPrim& item, int axis, const Slices& slices, int first, int last,
                  Box* boxes)
{
    struct Edge {
        float x, v[2], slope[2];
    };  // v + slope * (distance from x) across the axis
    const int across[2] = { axis == 0 ? 1 : 0, axis == 2 ? 1 : 2 };
    const float* corner[3] = { mesh.corner(item.face, 0), mesh.corner(item.face, 1), mesh.corner(item.face, 2) };
    if (corner[1][axis] < corner[0][axis])
        swap(corner[0], corner[1]);
    if (corner[2][axis] < corner[1][axis])
        swap(corner[1], corner[2]);
    if (corner[1][axis] < corner[0][axis])
        swap(corner[0], corner[1]);
    auto edge = [&](const float* a, const float* b) {
        float length = b[axis] - a[axis], inverse = length > kMinExtent ? 1.f / length : 0.f;
        float u = a[across[0]], v = a[across[1]];
        return Edge { a[axis], { u, v }, { (b[across[0]] - u) * inverse, (b[across[1]] - v) * inverse } };
    };
    const Edge whole = edge(corner[0], corner[2]),
               parts[2] = { edge(corner[0], corner[1]), edge(corner[1], corner[2]) };
    float middle = corner[1][axis], from = item.box.lower[axis], low[2],
          high[2];  // low, high: the section of the face at `from`
    auto cross = [&](float x, float* lower, float* upper) {
        const Edge& part = parts[x >= middle];
        for (int k = 0; k < 2; ++k) {
            float a = whole.v[k] + whole.slope[k] * (x - whole.x), b = part.v[k] + part.slope[k] * (x - part.x);
            lower[k] = smaller(a, b);
            upper[k] = larger(a, b);
        }
    };
    cross(from, low, high);
    for (int slab = first; slab <= last; ++slab) {
        float to = slab < last ? slices.plane(slab) : item.box.upper[axis], next_low[2], next_high[2];
        cross(to, next_low, next_high);
        Box share;
        share.lower[axis] = from;
        share.upper[axis] = to;
        bool bend = middle >= from && middle <= to;
        for (int k = 0; k < 2; ++k) {
            float v = bend ? parts[1].v[k] : low[k];
            share.lower[across[k]] = smaller(smaller(low[k], next_low[k]), v);
            share.upper[across[k]] = larger(larger(high[k], next_high[k]), v);
            low[k] = next_low[k];
            high[k] = next_high[k];
        }
        if (share.clip(item.box))
            boxes[slab].grow(share);
        from = to;
    }
}

// The best cut of a node's items into two parts of at most `limit`, through at most `spare` of them. Both parts may
// have as many items as the node: what a cut gains is smaller boxes.
inline SpatialSplit find_cut(const Faces& mesh, const BuildPrim* items, int count, int limit, int spare, const Box& box)
{
    SpatialSplit best;
    for (int axis = 0; axis < 3; ++axis) {
        if (!(box.extent(axis) > kMinExtent))
            continue;
        Slices slices(box, axis);
        Box boxes[kPlanes];
        int enter[kPlanes] = {}, t_far[kPlanes] = {};
        for (Box& share : boxes)
            share = Box::empty();
        for (int i = 0; i < count; ++i) {
            int first = slices.slab(items[i].box.lower[axis]), last = slices.slab(items[i].box.upper[axis]);
            ++enter[first];
            ++t_far[last];
            if (first == last)
                boxes[first].grow(items[i].box);
            else
                slice(mesh, items[i], axis, slices, first, last, boxes);
        }
        double after[kPlanes];
        int num_after[kPlanes], n = 0;
        Box side = Box::empty();
        for (int slab = kPlanes - 1; slab > 0; --slab) {
            side.grow(boxes[slab]);
            n += t_far[slab];
            num_after[slab] = n;
            after[slab] = n ? side.area() * n : 0.;
        }
        n = 0;
        side = Box::empty();
        for (int slab = 0; slab < kPlanes - 1; ++slab) {
            side.grow(boxes[slab]);
            n += enter[slab];
            int m = num_after[slab + 1];
            if (n == 0 || m == 0 || larger(n, m) > limit || n + m - count > spare)
                continue;
            double cost = side.area() * n + after[slab + 1];
            if (cost < best.cost)
                best = { cost, axis, slices.plane(slab) };
        }
    }
    return best;
}

// Cuts an item that has room on both sides of the plane. Each side's box holds all of the face that is in the item's
// box, whatever rounding does, and is never empty.
inline void cut_item(const Faces& mesh, const BuildPrim& item, const SpatialSplit& cut, Box& low, Box& high)
{
    Box sides[2] = { Box::empty(), Box::empty() };
    int axis = cut.axis;
    for (int k = 0; k < 3; ++k) {
        const float *a = mesh.corner(item.face, k), *b = mesh.corner(item.face, (k + 1) % 3);
        if (a[axis] <= cut.plane)
            sides[0].grow(a, a);
        if (a[axis] >= cut.plane)
            sides[1].grow(a, a);
        if (smaller(a[axis], b[axis]) >= cut.plane || larger(a[axis], b[axis]) <= cut.plane)
            continue;
        double t = ((double)cut.plane - a[axis]) / ((double)b[axis] - a[axis]);
        Box point;
        for (int i = 0; i < 3; ++i) {
            double size = (a[i] < 0.f ? -(double)a[i] : a[i]) + (b[i] < 0.f ? -(double)b[i] : b[i]);
            double p = a[i] + t * ((double)b[i] - a[i]), error = 1e-7 * (p < 0. ? -p : p) + 1e-15 * size + 1e-45;
            point.lower[i] = larger((float)(p - error), smaller(a[i], b[i]));
            point.upper[i] = smaller((float)(p + error), larger(a[i], b[i]));
        }
        point.lower[axis] = point.upper[axis] = cut.plane;
        sides[0].grow(point);
        sides[1].grow(point);
    }
    low = high = item.box;
    low.upper[axis] = high.lower[axis] = cut.plane;
    Box whole[2] = { low, high };
    if (!low.clip(sides[0]))
        low = whole[0];
    if (!high.clip(sides[1]))
        high = whole[1];
}

// Result of a spatial split: two runs of items with room behind each.
struct Parts {
    int first, first_room;  // items in the first run, and where the second starts
    int second, second_room;  // 0 items: the cut was not made, and all is as it was but for the order
};

// Makes a cut: of `room` places that begin with `count` items.
inline Parts part(const Faces& mesh, BuildPrim* items, int count, int room, int limit, const SpatialSplit& cut)
{
    int axis = cut.axis, low = 0,
        high = count;  // items before `low` are below the plane, items from `high` on above it
    Box boxes[2] = { Box::empty(), Box::empty() };
    double weights[2] = { 0., 0. };
    for (int i = 0; i < high;) {
        int side = items[i].box.upper[axis] <= cut.plane ? 0 : items[i].box.lower[axis] >= cut.plane ? 1 : 2;
        double area = items[i].box.area();
        weights[0] += side == 0 ? area : side == 2 ? 0.5 * area : 0.;
        weights[1] += side == 1 ? area : side == 2 ? 0.5 * area : 0.;
        if (side < 2)
            boxes[side].grow(items[i].box);
        if (side == 0)
            swap(items[low++], items[i++]);
        else if (side == 1)
            swap(items[i], items[--high]);
        else
            ++i;
    }
    int both = high - low, above = count - high, spare = room - count - both;
    if (spare < 0 || high == 0 || low == count || larger(high, count - low) > limit)
        return {};
    double sum = weights[0] + weights[1];
    Parts parts;
    parts.first_room = high + (int)(spare * (sum > 0. ? weights[0] / sum : 0.5));
    parts.second_room = room - parts.first_room;
    parts.first = low;
    parts.second = above;
    BuildPrim* second = items + parts.first_room;
    for (int i = above - 1; i >= 0; --i)
        second[i] = items[high + i];
    bool may_stay_whole = low > 0 && above > 0;
    for (int i = low; i < high; ++i) {
        BuildPrim shares[2] = { items[i], items[i] };
        cut_item(mesh, items[i], cut, shares[0].box, shares[1].box);
        bool keep[2] = { true, true };
        if (may_stay_whole) {  // on one side, if that costs less
            double alone[2], with_share[2], with_all[2];
            int most[2] = { high, count - low };
            for (int side = 0; side < 2; ++side) {
                Box box = boxes[side], all = boxes[side];
                box.grow(shares[side].box);
                all.grow(items[i].box);
                alone[side] = boxes[side].area() * (most[side] - 1);
                with_share[side] = box.area() * most[side];
                with_all[side] = all.area() * most[side];
            }
            double cost = with_share[0] + with_share[1], costs[2] = { with_all[0] + alone[1], with_all[1] + alone[0] };
            int side = costs[1] < costs[0];
            if (costs[side] < cost) {
                shares[side] = items[i];
                keep[1 - side] = false;
            }
        }
        if (keep[0])
            items[parts.first++] = shares[0];
        if (keep[1])
            second[parts.second++] = shares[1];
        for (int side = 0; side < 2; ++side)
            if (keep[side])
                boxes[side].grow(shares[side].box);
    }
    return parts;
}

}  // namespace bvh4_build
}  // namespace warpcam
