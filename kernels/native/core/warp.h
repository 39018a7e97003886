// Warps and blocks of CUDA, and what takes their place in a CPU thread: barriers, reductions, appending.
#pragma once
#include "core/platform.h"

namespace warpcam {

// A place in a shared list of so many, which it makes longer by one.
WARPCAM_DEVICE int atomic_append(int& count)
{
#if defined(__CUDA_ARCH__)
    return atomicAdd(&count, 1);
#else
    return count++;
#endif
}

// Returns the object in shared memory by an address that stays in a register: the compiler computes a variable's own
// address anew at each use, in three or four instructions. For whole warps.
template <class Shared> WARPCAM_DEVICE Shared& keep_shared_address(Shared& shared)
{
#if defined(__CUDA_ARCH__)
    const unsigned address = __shfl_sync(FULL_WARP, static_cast<unsigned>(__cvta_generic_to_shared(&shared)), 0);
    return *static_cast<Shared*>(__cvta_shared_to_generic(address));
#else
    return shared;
#endif
}

// A number that all lanes of a warp have, which then stays in a uniform register. For whole warps.
WARPCAM_DEVICE int warp_uniform(int number)
{
#if defined(__CUDA_ARCH__)
    return __shfl_sync(FULL_WARP, number, 0);
#else
    return number;
#endif
}

#if defined(__CUDA_ARCH__)
// The sum of all lanes' numbers.
WARPCAM_DEVICE int warp_reduce_add(int number)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_add_sync(FULL_WARP, number);
#else
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        number += __shfl_xor_sync(FULL_WARP, number, step);
    return number;
#endif
}

// The greatest of them.
WARPCAM_DEVICE int warp_reduce_max(int number)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_max_sync(FULL_WARP, number);
#else
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        number = max(number, __shfl_xor_sync(FULL_WARP, number, step));
    return number;
#endif
}

// The least of them.
WARPCAM_DEVICE int warp_reduce_min(int number)
{
#if __CUDA_ARCH__ >= 800
    return __reduce_min_sync(FULL_WARP, number);
#else
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        number = min(number, __shfl_xor_sync(FULL_WARP, number, step));
    return number;
#endif
}
#endif

WARPCAM_DEVICE void block_sync()
{
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
}

// Whether it is so for any thread of a block, which meets.
WARPCAM_DEVICE bool block_any(bool is_so)
{
#if defined(__CUDA_ARCH__)
    return __syncthreads_or(is_so);
#else
    return is_so;
#endif
}

WARPCAM_DEVICE void warp_sync()
{
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
}

// For a team of so many threads: a block, or one of its warps.
template <int WARP_OR_ONE> WARPCAM_DEVICE void team_barrier()
{
    if constexpr (WARP_OR_ONE == THREADS)
        block_sync();
    else
        warp_sync();
}

#if defined(__CUDA_ARCH__)
// The place of each thread that is `chosen` among those of the block that are, in the threads' order, from `begin` on;
// makes that the place after the last. `counts`: room for a number of each warp. The block meets.
WARPCAM_DEVICE int place_among(bool chosen, int& begin, int* counts, int thread)
{
    const unsigned votes = __ballot_sync(FULL_WARP, chosen);
    if (thread % WARP_SIZE == 0)
        counts[thread / WARP_SIZE] = __popc(votes);
    block_sync();
    int place = begin + __popc(votes & ((1u << thread % WARP_SIZE) - 1u));
    for (int warp = 0; warp < THREADS / WARP_SIZE; ++warp) {
        place += warp < thread / WARP_SIZE ? counts[warp] : 0;
        begin += counts[warp];
    }
    return place;
}

// Barriers for some warps of a block, so many threads in all: those that wait, and those that say that they were there.
enum Barrier { FIRST_WARPS = 1, SHAPES_SORTED, MOTIONS_THERE };

template <Barrier NUMBER, int COUNT> WARPCAM_DEVICE void named_barrier_sync()
{
    __syncwarp();
    asm volatile("bar.sync %0, %1;" ::"n"(int(NUMBER)), "n"(COUNT) : "memory");
}
template <Barrier NUMBER, int COUNT> WARPCAM_DEVICE void named_barrier_arrive()
{
    __syncwarp();
    asm volatile("bar.arrive %0, %1;" ::"n"(int(NUMBER)), "n"(COUNT) : "memory");
}
#endif

}  // namespace warpcam
