// Tiles of a region that may have edges, as anything is seen there or around them, on CUDA.
#pragma once
#include "tiles.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// The tiles of a warp where anything is seen, or around them, by bit: its first, the one after so many, and so on. All are
// where ids have more than a byte.
template <class Target, class Id>
WARPCAM_FN unsigned tiles_with_shapes(const Target& target, const Id* ids_of_view, const Region& region, int across,
                                      int tiles)
{
    constexpr int WARPS = THREADS / LANES, TOGETHER = 8, WORD = 4;  // pixels
    if (sizeof(Id) != 1 || target.width % WORD)
        return ~0u;
    const unsigned* words = reinterpret_cast<const unsigned*>(ids_of_view);
    const int lane = threadIdx.x % LANES, warp = threadIdx.x / LANES;
    const int down = lower_int(lane / 4, TILE_HEIGHT + 1) - 1, right = lane % 4 * WORD - WORD;
    unsigned found = 0;
    for (int begin = 0; warp + begin * WARPS < tiles; begin += TOGETHER) {
        unsigned ids[TOGETHER];
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n) {
            const int tile = lower_int(warp + (begin + n) * WARPS, tiles - 1), row = tile / across;
            const int i = region.left + (tile + row) % across * TILE_WIDTH + right;
            const int j = region.top + row * TILE_HEIGHT + down;
            const int column = upper_int(lower_int(i, target.width - WORD), 0);
            ids[n] = words[(upper_int(lower_int(j, target.height - 1), 0) * target.width + column) / WORD];
        }
#pragma unroll
        for (int n = 0; n < TOGETHER; ++n)
            found |= unsigned(__any_sync(ALL, ids[n] != ~0u) != 0) << (begin + n);
    }
    return found;
}

}  // namespace warpcam
#endif
