// Rays that wait for triangle meshes, on CUDA: a queue in the shared memory of a block.
#pragma once
#include "bvh4.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// WORDS: 32 shapes of the block's list each.
template <int WORDS> struct RayQueue {
    static constexpr int SIZE = WORDS > 2 ? 256 : 512;

    int count, next;               // rays in the queue; the first that nobody has taken
    unsigned meshes[WORDS][SIZE];  // bits by place in the list: meshes whose boxes the ray meets
    unsigned short pixel[SIZE];    // row * 64 + column in the region

    WARPCAM_FN void clear() { count = next = 0; }

    // Is there room for one more tile of each warp?
    WARPCAM_FN bool has_room() const { return *const_cast<const volatile int*>(&count) <= SIZE - THREADS; }

    // Puts in a warp's rays for which `keep` holds; there is room. Returns where the lane's own ray stands.
    WARPCAM_FN int put(bool keep, const unsigned* met, int words, int place)
    {
        const int lane = threadIdx.x % LANES;
        const unsigned kept = __ballot_sync(ALL, keep);
        if (kept == 0)
            return 0;
        int at = 0;
        if (lane == 0)
            at = atomicAdd(&count, __popc(kept));
        at = __shfl_sync(ALL, at, 0) + __popc(kept & ((1u << lane) - 1));
        if (keep) {
            for (int word = 0; word < words; ++word)
                meshes[word][at] = met[word];
            pixel[at] = static_cast<unsigned short>(place);
        }
        return at;
    }

    // Takes the next rays for a warp; returns the first of them. There may be fewer than `wanted` left.
    WARPCAM_FN int take(int wanted)
    {
        int first = 0;
        if (threadIdx.x % LANES == 0)
            first = atomicAdd(&next, wanted);
        return __shfl_sync(ALL, first, 0);
    }

    // Goes on to the ray's next word with a mesh, if `left` of this one has none.
    WARPCAM_FN void go_on(int ray, int words, int& word, unsigned& left) const
    {
        while (left == 0 && word + 1 < words)
            left = meshes[++word][ray];
    }
};

}  // namespace warpcam
#endif
