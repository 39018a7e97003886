// Lists of the shapes that a region may show: of all that are drawn, or of those in view.
#pragma once
#include "traversal/shape_list.h"
#include "traversal/shapes_in_view.h"
#if !defined(__CUDA_ARCH__)
#include "traversal/sphere_cull_simd.h"
#endif

namespace warpcam {

// Adds the shape at one place among the drawn ones to the list, if the region may show it. HITS_NAME_SLOTS: records
// name their own slots in place of their shapes, and in place of an asset where these stand among the drawn ones.
// hidden(id, formless): the shape is left out; a formless one always is, and is a fault of a world that would draw it.
template <class Types, int LENS, bool HITS_NAME_SLOTS, int CAPACITY, class Shapes, class Meshes, class HeightFields,
          class Hidden>
WARPCAM_DEVICE void list_shape(ShapeList<CAPACITY>& list, int place, const Shapes& shapes, const Meshes& meshes,
                               const HeightFields& fields, const Hidden& hidden, const Camera& camera,
                               const Region& region, int world)
{
    ShapeRecord record;
    TileRect tiles;
    const int id = wp::index(shapes.drawn, place);
    const Visible seen =
        setup_shape<Types, LENS>(load_shape(shapes, world, id), camera, region, meshes, fields, record, tiles);
    if (seen == BROKEN)
        list.broken = 1;
    if ((seen == SEEN || seen == FORMLESS) && !hidden(id, seen == FORMLESS)) {
        const int slot = atomic_append(list.count);
        if (HITS_NAME_SLOTS) {
            record.axis_y.w = slot;
            record.axis_z.w = place;
        }
        list.records[slot] = record;
        list.nearest[slot] = record.size.w & 0x7fffffff;
        list.ids[slot] = id;
        list.touched[slot] = tiles;
    }
}

#if !defined(__CUDA_ARCH__)
constexpr int FEW_SHAPES = 64;  // that are looked at one by one
#endif

// Fills the list with shapes from `begin` on until it is full; returns where to go on. ALONE: by one warp.
template <class Types, int LENS, bool HITS_NAME_SLOTS, bool ALONE, int CAPACITY, class Shapes, class Meshes,
          class HeightFields, class Hidden>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE int build_shape_list(ShapeList<CAPACITY>& list, int begin, const Shapes& shapes,
                                                         const Meshes& meshes, const HeightFields& fields,
                                                         const Hidden& hidden, const Camera& camera,
                                                         const Region& region, int world, int thread)
{
    const int total = shapes.drawn.shape[0];
#if !defined(__CUDA_ARCH__)
    if constexpr (CAPACITY > FEW_SHAPES) {
        const RegionCone cone = region_cone<LENS>(camera, region);
        for (; begin < total && list.count + SIMD_WIDTH <= CAPACITY; begin += SIMD_WIDTH)
            for (unsigned some = spheres_in<LENS>(load_spheres(shapes, world, begin), camera, region, cone); some;
                 some &= some - 1)
                list_shape<Types, LENS, HITS_NAME_SLOTS>(list, begin + ctz(some), shapes, meshes, fields, hidden,
                                                         camera, region, world);
        return min(begin, total);
    }
#endif
    while (begin < total) {
        const int i = begin + thread;
        begin += THREADS;
        if (i < total)
            list_shape<Types, LENS, HITS_NAME_SLOTS>(list, i, shapes, meshes, fields, hidden, camera, region, world);
        // The next round may overflow the list. One warp never has so many, but the compiler spills less with this than
        // without.
        if (total > CAPACITY) {
            block_sync();
            const bool full = list.count + min(THREADS, total - begin) > CAPACITY;
            block_sync();
            if (full)
                break;
        }
    }
    if (ALONE)
        warp_sync();
    else
        block_sync();
    return begin;
}

#if defined(__CUDA_ARCH__)

// Fills the list with shapes in view that are nearer than `farthest`, from `begin` on, until it is full; returns where
// to go on.
template <class Types, int LENS, bool HITS_NAME_SLOTS, int CAPACITY, class Shapes, class Meshes, class HeightFields,
          class Hidden>
WARPCAM_DEVICE int choose_in_view(ShapeList<CAPACITY>& list, int begin, const ListInView& in_view, float farthest,
                                  const TileRect& cells, const Shapes& shapes, const Meshes& meshes,
                                  const HeightFields& fields, const Hidden& hidden, const Camera& camera,
                                  const Region& region, int world, int thread)
{
    WARPCAM_SHARED int counts[2][THREADS / WARP_SIZE], next;
    int* const places = reinterpret_cast<int*>(list.tiles);  // which is filled later
    const int total = in_view.count(), sorted = in_view.sorted();
    int chosen = 0;
    for (int round = 0; begin < total; ++round) {
        if (begin < sorted && in_view.at(begin).nearest() >= farthest) {
            begin = sorted;  // all that follows lies behind what is seen
            continue;
        }
        const int i = begin + thread;
        bool touches = false;
        ShapeInView shape { 0 };
        if (i < total) {
            shape = in_view.at(i);
            touches = shape.touches(cells) && shape.nearest() < farthest;
        }
        const int place = place_among(touches, chosen, counts[round & 1], thread);
        if (touches && place < CAPACITY)
            places[place] = shape.place();
        if (touches && place == CAPACITY)
            next = i;
        if (chosen > CAPACITY) {
            block_sync();
            begin = next;
            break;
        }
        begin += THREADS;
    }
    block_sync();
    for (int i = thread; i < min(chosen, CAPACITY); i += THREADS)
        list_shape<Types, LENS, HITS_NAME_SLOTS>(list, places[i], shapes, meshes, fields, hidden, camera, region,
                                                 world);
    block_sync();
    return begin;
}

// How deep the pixels of a trace target's region are at most, after a pass; by a block. `of_warps`: room for a number of
// each warp.
template <class TraceTarget_> WARPCAM_DEVICE float deepest(const TraceTarget_& trace_target, int* of_warps, int thread)
{
    const auto& target = trace_target.target;
    const Region& region = trace_target.region;
    int most = 0;  // bits of a depth, which are in order
    for (int pixel = thread; pixel < region.width * region.height; pixel += THREADS) {
        const int row = unsigned(pixel) / unsigned(region.width);
        const int i = region.left + (pixel - row * region.width), j = region.top + row;
        if (trace_target.inside(i, j)) {
            const auto at = trace_target.at(i, j);
            most = max(most, as_int(target.shape.data[at] >= 0 ? target.depth.data[at] : trace_target.camera.far));
        }
    }
    most = warp_reduce_max(most);
    if (thread % WARP_SIZE == 0)
        of_warps[thread / WARP_SIZE] = most;
    block_sync();
    for (int warp = 0; warp < THREADS / WARP_SIZE; ++warp)
        most = max(most, of_warps[warp]);
    return as_float(most);
}

#endif

}  // namespace warpcam
