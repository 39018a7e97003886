// Which of a list's shapes each tile of a region touches, marked once for all its tiles.
#pragma once
#include "traversal/shape_list.h"
#include "core/conditional.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

template <int CAPACITY> struct TileMarks {
    static constexpr int TILES = 32;  // of a region of scenes of many meshes, at most: launches.py, region_size()
    // So many ranks of one tile a thread looks at, whose bits are a number of their own.
    static constexpr int RANKS = CAPACITY * TILES / THREADS < 8 ? 8 : CAPACITY * TILES / THREADS,
                         PARTS = CAPACITY / RANKS;
    using Part = conditional_t<RANKS == 8, unsigned char, conditional_t<RANKS == 16, unsigned short, unsigned>>;
    static_assert(sizeof(Part) * 8 == RANKS && CAPACITY % WARP_SIZE == 0);

    unsigned meshes[CAPACITY / WARP_SIZE];
    alignas(4) Part touched[TILES][PARTS];

    // Marks the tiles of a region that has so many across; by a block, which then must meet.
    template <class Types, class List> WARPCAM_DEVICE void mark(const List& list, int across, int thread)
    {
        const int tile = thread % TILES, part = thread / TILES;
        if (part < PARTS) {
            const int row = unsigned(tile) / unsigned(across);
            const unsigned steps = PackedTileRect::steps(tile - row * across, row, 1, 1);
            unsigned bits = 0;
            if (part * RANKS < list.count)  // there are rectangles for all ranks of a word
#pragma unroll
                for (int k = 0; k < RANKS; ++k)
                    bits |= unsigned(list.tiles[part * RANKS + k].touches(steps)) << k;
            touched[tile][part] = static_cast<Part>(bits);
        }
#pragma unroll
        for (int rank = thread; rank < CAPACITY; rank += THREADS) {
            const unsigned some = __ballot_sync(FULL_WARP, rank < list.count && is_mesh<Types>(list.at_rank(rank)));
            if (rank % WARP_SIZE == 0)
                meshes[rank / WARP_SIZE] = some;
        }
    }

    // Ranks that touch a tile, of a word of them.
    WARPCAM_DEVICE unsigned touching(int tile, int word) const
    {
        return reinterpret_cast<const unsigned*>(touched[tile])[word];
    }
    // True if any does.
    WARPCAM_DEVICE bool touches(int tile) const
    {
        unsigned some = 0;
#pragma unroll
        for (int word = 0; word < CAPACITY / WARP_SIZE; ++word)
            some |= touching(tile, word);
        return some != 0u;
    }
};

#endif

}  // namespace warpcam
