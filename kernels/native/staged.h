// Images on their way by shared memory, so that whole lines of memory are written at once: the pixels of some stacks of tiles
// beside each other are kept until the last of these is drawn; the warp that has drawn it stores them all.
#pragma once
#include "prepare.h"
#include "vectors.h"

namespace warpcam {

constexpr int words_staged(int images)
{
    return (images & 1) + (images >> 1 & 1) + 3 * (images >> 4 & 1) + 3 * (images >> 6 & 1);
}

// IMAGES: bits of canvas.h; those of three numbers a pixel take three words, the others one. TALL: tiles of a stack. ROOM:
// groups of STACKS that are kept at once.
template <int IMAGES, int TALL, int STACKS_ = 4, int ROOM_ = 2> struct Stage {
    static constexpr int WORDS = words_staged(IMAGES);
    static constexpr int STACKS = STACKS_, ROOM = ROOM_, ROWS = TALL * TILE_HEIGHT, ACROSS = STACKS * TILE_WIDTH;
    static constexpr int ROW = ACROSS + TILE_WIDTH;  // of one word a pixel; rows of a tile begin at different banks
    static constexpr int IMAGE = ROWS * ROW;         // the same

    alignas(16) unsigned words[ROOM][WORDS > 0 ? WORDS * IMAGE : 1];
    int drawn[ROOM];   // stacks
    int stored[ROOM];  // groups

    WARPCAM_FN void begin(int thread)
    {
        if (thread < ROOM)
            drawn[thread] = stored[thread] = 0;
    }

#if defined(__CUDA_ARCH__)
    // Waits until there is room for a group.
    WARPCAM_FN void await(unsigned group) const
    {
        const unsigned place = static_cast<unsigned>(__cvta_generic_to_shared(&stored[group % ROOM]));
        int turns;
        do
            asm volatile("ld.acquire.cta.shared.s32 %0, [%1];" : "=r"(turns) : "r"(place) : "memory");
        while (any_lane(turns < int(group / ROOM)));
    }

    // Where COUNT words of each pixel lie: those of a lane's pixel in a group's first tile.
    template <int COUNT> WARPCAM_FN unsigned* place_of(unsigned group, int column, int lane)
    {
        return words[group % ROOM] + COUNT * (lane / TILE_WIDTH * ROW + column * TILE_WIDTH + lane % TILE_WIDTH);
    }

    // A warp has drawn a stack: is it the last one of its group?
    WARPCAM_FN bool last(unsigned group, int lane)
    {
        __syncwarp();
        const unsigned place = static_cast<unsigned>(__cvta_generic_to_shared(&drawn[group % ROOM]));
        unsigned before = 0;
        asm volatile("{\n .reg .pred first;\n setp.eq.s32 first, %2, 0;\n @first atom.acq_rel.cta.shared.add.u32 %0, [%1], 1;\n}"
                     : "+r"(before)
                     : "r"(place), "r"(lane)
                     : "memory");
        return __shfl_sync(ALL, before, 0) % STACKS == STACKS - 1;
    }

    // Stores COUNT words of each pixel of a group, which lie behind FIRST others. `image`: where those of its first pixel go;
    // `width`: of a row there [pixels].
    template <int FIRST, int COUNT> WARPCAM_FN void store(unsigned group, void* image, int width, int lane) const
    {
        constexpr int PIECES = COUNT * ACROSS / 4, AT_ONCE = LANES / PIECES > 0 ? LANES / PIECES : 1;  // of 16 bytes; rows
        const unsigned* from = words[group % ROOM] + FIRST * IMAGE + COUNT * ROW * (lane / PIECES) + 4 * (lane % PIECES);
        uint4* to = reinterpret_cast<uint4*>(image) + lane / PIECES * (COUNT * width / 4) + lane % PIECES;
        if (lane < AT_ONCE * PIECES)
#pragma unroll
            for (int row = 0; row < ROWS; row += AT_ONCE)
#pragma unroll
                for (int piece = 0; piece < PIECES; piece += LANES)
                    if (PIECES <= LANES || piece + lane < PIECES)
                        to[row * (COUNT * width / 4) + piece]
                            = *reinterpret_cast<const uint4*>(from + row * COUNT * ROW + 4 * piece);
    }

    // A group is stored: there is room for another.
    WARPCAM_FN void leave(unsigned group, int lane)
    {
        __syncwarp();
        const unsigned place = static_cast<unsigned>(__cvta_generic_to_shared(&stored[group % ROOM]));
        asm volatile("{\n .reg .pred first;\n setp.eq.s32 first, %2, 0;\n @first st.release.cta.shared.u32 [%0], %1;\n}" ::"r"(place),
                     "r"(group / ROOM + 1), "r"(lane)
                     : "memory");
    }
#endif
};

}  // namespace warpcam
