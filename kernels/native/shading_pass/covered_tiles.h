// Tiles of a region before which transparent shapes may lie.
#pragma once
#include "shading_pass/mujoco_transparency.h"

namespace warpcam {

// None of them, where no shape is transparent.
struct NoCoveredTiles {
    WARPCAM_DEVICE bool has(int, int) const { return false; }
};

#if defined(__CUDA_ARCH__)

// A bit each, row after row.
template <int WIDTH, int HEIGHT> struct CoveredTiles {
    static constexpr int ACROSS = WIDTH / TILE_WIDTH;
    static_assert(ACROSS * (HEIGHT / TILE_HEIGHT) <= THREADS);

    unsigned words[THREADS / WARP_SIZE];

    // Each thread of the block looks at a tile; afterwards the block has to meet.
    template <class TransparentShapes_> WARPCAM_DEVICE void gather(const TransparentShapes_& shapes, int thread)
    {
        bool covered = false;
#pragma unroll 1
        for (int slot = 0; slot < shapes.count; ++slot)
            covered |= touches(shapes.touched[slot], thread % ACROSS, thread / ACROSS);
        const unsigned bits = __ballot_sync(FULL_WARP, covered);
        if (thread % WARP_SIZE == 0)
            words[thread / WARP_SIZE] = bits;
    }

    // Of the tile around a pixel of the region.
    WARPCAM_DEVICE bool has(int column, int row) const
    {
        const unsigned tile = unsigned(row / TILE_HEIGHT * ACROSS + column / TILE_WIDTH);
        return words[tile / WARP_SIZE] >> tile % WARP_SIZE & 1u;
    }
};

#endif

}  // namespace warpcam
