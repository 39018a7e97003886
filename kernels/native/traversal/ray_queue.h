// Rays that wait for triangle meshes, on CUDA. A warp draws tile after tile and gathers the rays that meet boxes of
// meshes; each of its lanes walks one of them, and takes another when it is done, so that lanes are never without a ray
// while there are tiles. Warps do not wait for each other.
#pragma once
#include "accel/bvh4.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

constexpr int MIN_ACTIVE_LANES = 8;  // lanes; fewer wait for company before they do what the others do not need
constexpr int A_FEW_WORDS = 2;  // of 32 shapes, that a lane has in registers

// The rays of one warp. WORDS: 32 shapes of the block's list each.
template <int WORDS> struct RayQueue {
    // bits by place in the list: meshes whose boxes a ray meets
    unsigned waiting[WORDS][WARP_SIZE];  // of the rays of one tile that no lane has taken yet
    unsigned taken[WORDS][WARP_SIZE];  // of the lanes' own; the first word is in a register
    unsigned short pixel[WARP_SIZE];  // of the waiting rays: row * 64 + column in the region

    // Lets the rays of the lanes in `found` wait; nobody waits yet. Returns where the lane's own ray stands.
    WARPCAM_DEVICE int put(unsigned found, const unsigned* met, int words, int place)
    {
        const int lane = threadIdx.x % WARP_SIZE, at = __popc(found & ((1u << lane) - 1));
        if (found >> lane & 1) {
            if constexpr (WORDS <= A_FEW_WORDS) {
#pragma unroll
                for (int word = 0; word < WORDS; ++word)
                    waiting[word][at] = met[word];
            } else {
                for (int word = 0; word < words; ++word)
                    waiting[word][at] = met[word];
            }
            pixel[at] = static_cast<unsigned short>(place);
        }
        return at;
    }

    // Makes a ray that waits the lane's own; returns its first word.
    WARPCAM_DEVICE unsigned take(int ray, int words)
    {
        for (int word = 1; word < words; ++word)
            taken[word][threadIdx.x % WARP_SIZE] = waiting[word][ray];
        return waiting[0][ray];
    }

    // Goes on to the next word of the lane's ray with a mesh, if `left` of this one has none.
    WARPCAM_DEVICE void go_on(int words, int& word, unsigned& left) const
    {
        while (WORDS > 1 && left == 0 && word + 1 < words)
            left = taken[++word][threadIdx.x % WARP_SIZE];
    }
};

// Rays and meshes that a warp has yet to traverse.
struct PendingWork {
    int first, end;  // of the rays that wait
    bool more;  // tiles

    WARPCAM_DEVICE bool any() const { return more || first < end; }

    // Gives rays to the lanes in `idles`, as far as there are any: take(ray). `next_tile(found)` draws another tile as
    // far as it goes without meshes and says how many rays wait then; false if there is none left.
    template <class NextTile, class Take>
    WARPCAM_DEVICE void hand_out(unsigned idles, const NextTile& next_tile, const Take& take)
    {
        const int lane = threadIdx.x % WARP_SIZE;
        while (idles && any()) {
            if (first == end) {
                first = end = 0;
                more = next_tile(end);
                continue;
            }
            const int mine = first + __popc(idles & ((1u << lane) - 1));
            const bool takes = (idles >> lane & 1) && mine < end;
            if (takes)
                take(mine);
            first = min(first + __popc(idles), end);
            idles &= ~__ballot_sync(FULL_WARP, takes);
            __syncwarp();  // the next tile's rays may now stand where these stood
        }
    }
};

}  // namespace warpcam
#endif
