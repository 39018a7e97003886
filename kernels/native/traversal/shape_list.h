// The shapes of one region of one view, nearest first.
#pragma once
#include "traversal/infinite_plane.h"
#include "camera/shape_setup.h"
#if !defined(__CUDA_ARCH__)
#include "traversal/tile_overlap_simd.h"
#endif

namespace warpcam {

constexpr int analytic_types(int types)
{
    return types
           & ~(1 << HEIGHT_FIELD | 1 << MESH | 1 << PER_SHAPE_SCALE | 1 << TWO_SIDED | 1 << ALPHA_TESTED
               | 1 << SHADING_BACKS | 1 << DEFORMING_MESHES | 1 << TRANSPARENT_CASTERS | 1 << TEXTURE_FROM_ABOVE
               | 1 << TEXTURELESS_SHAPES | 1 << MIDDLE_FIRST | 1 << PROJECTED | 1 << TRIPLANAR | 1 << TEXTURE_ALPHA
               | 1 << LIT_NORMALS | 1 << COINCIDENT | 1 << PLANES_FROM_BEHIND);
}

// Integer type of slots and ranks: a byte for up to 256.
template <bool MANY> struct SlotOf {
    using Type = unsigned char;
};
template <> struct SlotOf<true> {
    using Type = unsigned short;
};

// Shapes that a region's rays are tested against. Ranks run from near to far.
template <int CAPACITY> struct ShapeList {
    static constexpr int SIZE = CAPACITY;
    using Slot = typename SlotOf<(CAPACITY > 256)>::Type;

    ShapeRecord records[CAPACITY];
    int nearest[CAPACITY];          // by slot; the bits of a depth, which are in order
    int ids[CAPACITY];              // by slot
    TileRect touched[CAPACITY];      // by slot
#if defined(__CUDA_ARCH__)
    PackedTileRect tiles[(CAPACITY + WARP_SIZE - 1) / WARP_SIZE
                         * WARP_SIZE];  // the same by rank, then none to a multiple of WARP_SIZE
#else
    TileParts<CAPACITY> tiles;      // the same by rank
#endif
    Slot order[CAPACITY];  // by rank: the slot
    int count;
    int next_tile;
    int broken;
#if defined(__CUDA_ARCH__)
    InfinitePlane floor;
#endif

    WARPCAM_DEVICE const ShapeRecord& at_rank(int rank) const { return records[order[rank]]; }
};

#if !defined(__CUDA_ARCH__)

constexpr int MANY_TO_SORT = 96;  // shapes; of fewer each is sooner compared with each

// Sorts by depth, as sort_by_depth() does, by radix.
template <int CAPACITY, class Note> inline void sort_many(ShapeList<CAPACITY>& list, const Note& note)
{
    using Slot = typename ShapeList<CAPACITY>::Slot;
    constexpr int DIGITS = 4;
    const int count = list.count;
    int starts[DIGITS][256] = {};
    for (int slot = 0; slot < count; ++slot)
        for (int digit = 0; digit < DIGITS; ++digit)
            ++starts[digit][list.nearest[slot] >> 8 * digit & 255];
    Slot orders[2][CAPACITY];
    for (int slot = 0; slot < count; ++slot)  // slots run as ids do
        orders[0][slot] = static_cast<Slot>(count - 1 - slot);
    for (int digit = 0; digit < DIGITS; ++digit) {
        int* const start = starts[digit];
        for (int value = 0, sum = 0; value < 256; ++value) {
            const int own = start[value];
            start[value] = sum;
            sum += own;
        }
        const Slot* const from = orders[digit % 2];
        Slot* const to = digit + 1 < DIGITS ? orders[(digit + 1) % 2] : list.order;
        for (int k = 0; k < count; ++k)
            to[start[list.nearest[from[k]] >> 8 * digit & 255]++] = from[k];
    }
    for (int rank = 0; rank < count; ++rank) {
        const int slot = list.order[rank];
        list.tiles.put(rank, list.touched[slot]);
        note(slot, rank);
    }
}

#endif

// Gives each slot its rank, which note(slot, rank) is told. The order does not depend on who came first; of shapes at
// one place the later is seen, as where shapes are drawn one over the other.
template <int CAPACITY, class Note>
WARPCAM_DEVICE void sort_by_depth(ShapeList<CAPACITY>& list, int thread, const Note& note)
{
#if !defined(__CUDA_ARCH__)
    if (list.count > MANY_TO_SORT)
        return sort_many(list, note);
#endif
    for (int i = thread; i < list.count; i += THREADS) {
        const int key = list.nearest[i], id = list.ids[i];
        unsigned rank = 0, with_equals = 0;
        for (int j = 0; j < list.count; ++j) {
            const int beyond = list.nearest[j] - key;
            rank += unsigned(beyond) >> 31;
            with_equals += unsigned(beyond - 1) >> 31;
        }
        if (with_equals > rank + 1)
            for (int j = 0; j < list.count; ++j)
                rank += list.nearest[j] == key && list.ids[j] > id;
        list.order[rank] = static_cast<typename ShapeList<CAPACITY>::Slot>(i);
        note(i, int(rank));
#if defined(__CUDA_ARCH__)
        list.tiles[rank] = { PackedTileRect::of(list.touched[i]) };
#else
        list.tiles.put(rank, list.touched[i]);
#endif
    }
#if defined(__CUDA_ARCH__)
    const int room = list.count == 0 ? WARP_SIZE : (list.count + WARP_SIZE - 1) / WARP_SIZE * WARP_SIZE;
    for (int rank = list.count + thread; rank < room; rank += THREADS)
        list.tiles[rank] = { PackedTileRect::NONE };
#endif
}

}  // namespace warpcam
