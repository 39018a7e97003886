// Tiles of a region that may have edges, as anything is seen there or around them, on CUDA.
#pragma once
#include "traversal/trace_tile.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// The tiles of a warp where anything is seen, or around them, by bit: its first, the one after so many, and so on. All
// are where ids have more than a byte.
template <class Centres>
WARPCAM_DEVICE unsigned tiles_with_shapes(const Centres& centres, const Region& region, int across, int tiles)
{
    constexpr int WARPS = THREADS / WARP_SIZE, TOGETHER = 8, WORD = 4;  // pixels
    if (!centres.has_fours())
        return ~0u;
    const int lane = threadIdx.x % WARP_SIZE, warp = threadIdx.x / WARP_SIZE;
    const int down = min(lane / 4, TILE_HEIGHT + 1) - 1, right = lane % 4 * WORD - WORD;
    unsigned found = 0;
    for (int begin = 0; warp + begin * WARPS < tiles; begin += TOGETHER) {
        unsigned ids[TOGETHER];
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            const int tile = min(warp + (begin + n) * WARPS, tiles - 1), row = tile / across;
            const int column = (tile + row) % across;
            ids[n] = centres.four_ids(region.left + column * TILE_WIDTH + right, region.top + row * TILE_HEIGHT + down);
        }
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n)
            found |= unsigned(__any_sync(FULL_WARP, ids[n] != ~0u) != 0) << (begin + n);
    }
    return found;
}

}  // namespace warpcam
#endif
