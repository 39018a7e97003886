// Strips of a region that a warp looks through for points that may lie in shadow, on CUDA, and the masks of their
// pixels.
#pragma once
#include "shadow/plane_receiver_cull.h"
#include "shadow/shadow_tile.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

// A strip of tiles beside each other, which a warp looks through before it works on one of them: each lane has as many
// pixels of a row as there are tiles. Four, or as few as leave each warp of the block a strip in small regions.
template <int WIDTH, int HEIGHT> struct Strip {
    static constexpr int TILES = WIDTH * HEIGHT >= 4 * THREADS ? 4 : WIDTH * HEIGHT / THREADS;
    static constexpr int ACROSS = WIDTH / (TILES * TILE_WIDTH);
    static constexpr unsigned COUNT = ACROSS * (HEIGHT / TILE_HEIGHT);
    static_assert(TILES * THREADS <= WIDTH * HEIGHT && ACROSS * TILES * TILE_WIDTH == WIDTH);

    // Start of the strip, of a lane's first pixel in it, and of the tile that a lane's pixels belong to.
    WARPCAM_DEVICE static int column(unsigned strip) { return strip % ACROSS * (TILES * TILE_WIDTH); }
    WARPCAM_DEVICE static int row(unsigned strip) { return strip / ACROSS * TILE_HEIGHT; }
    WARPCAM_DEVICE static int lane_column(int lane) { return lane % TILE_WIDTH * TILES; }
    WARPCAM_DEVICE static int lane_row(int lane) { return lane / TILE_WIDTH; }
    WARPCAM_DEVICE static int tile_column(int lane) { return lane_column(lane) & ~(TILE_WIDTH - 1); }

    // Strips of a warp if strips are dealt out: see shadow/plane_receiver_cull.h.
    static constexpr int WARPS = THREADS / WARP_SIZE, EACH = COUNT / WARPS;
    static_assert(WARPS <= 4);
    static constexpr unsigned ALL_OF_WARP = EACH < 8 ? EACH_STRIP & ((1u << 4 * (EACH % 8)) - 1u) : EACH_STRIP;
    WARPCAM_DEVICE static unsigned of_warp(unsigned warp, unsigned number) { return warp + WARPS * number; }

    // The lanes whose pixels belong to the same tile as a lane's.
    WARPCAM_DEVICE static unsigned lanes_of(int lane)
    {
        return (TILES == 4 ? 0x03030303u : TILES == 2 ? 0x0f0f0f0fu : FULL_WARP) << (tile_column(lane) / TILES);
    }
};

template <int COUNT, class Value, class Result> WARPCAM_DEVICE void load_several(const Value* from, Result* to)
{
    const AlignedArray<Value, COUNT> values = load_vector<COUNT>(from);
#pragma unroll
    for (int k = 0; k < COUNT; ++k)
        to[k] = values.at[k];
}

template <int COUNT, class Value> WARPCAM_DEVICE void clear_several(Value* to)
{
    *reinterpret_cast<AlignedArray<Value, COUNT>*>(to) = {};
}

// True if any of the lane's pixels in a strip shows a point below the union of the casters' bounds. `fresh` clears
// their masks.
template <int COUNT, int LENS, class List, class Target>
WARPCAM_DEVICE bool find_asking(const Target& target, size_t at, int inside, float i, float j, const List& list,
                                const ReceiverView<LENS>& view, bool fresh)
{
    int id[COUNT];
    float depth[COUNT] = {};
#pragma unroll
    for (int k = 0; k < COUNT; ++k)
        id[k] = -1;
    if (inside >= COUNT && target.width % COUNT == 0) {
        load_several<COUNT>(target.shape.data + at, id);
        load_several<COUNT>(target.depth.data + at, depth);
        if (fresh)
            clear_several<COUNT>(target.shadow.data + at);
    } else {
#pragma unroll
        for (int k = 0; k < COUNT; ++k)
            if (k < inside) {
                id[k] = target.shape.data[at + k];
                depth[k] = target.depth.data[at + k];
                if (fresh)
                    target.shadow.data[at + k] = 0;
            }
    }
    bool asks = false;
#pragma unroll
    for (int k = 0; k < COUNT; ++k)
        asks |=
            id[k] >= 0 && may_be_shaded(list, place_of(view.light.distant, view.lit.point(i + float(k), j, depth[k])));
    return asks;
}

// True if warps have strips of their own, among which those that show nothing but a plane are handled apart: see
// shadow/plane_receiver_cull.h.
template <class Types, int LENS, int WIDTH, int HEIGHT> constexpr bool uses_plane_cull()
{
    using Strips = Strip<WIDTH, HEIGHT>;
    return (Types::has(PLANE)) && !Types::has(MESH) && LENS == PINHOLE && Strips::TILES == 4
           && Strips::EACH * Strips::WARPS == Strips::COUNT && Strips::EACH <= 8 && Strips::WARPS % Strips::ACROSS == 0;
}

// Adds a light's bit to a pixel's mask. BESIDE: other warps may be adding those of other lights.
template <bool BESIDE, class Target> WARPCAM_DEVICE void mark_shadow(const Target& target, size_t at, unsigned bit)
{
    if constexpr (BESIDE) {  // in the word that holds it: masks begin anywhere
        const size_t address = reinterpret_cast<size_t>(target.shadow.data + at), within = address % sizeof(unsigned);
        atomicOr(reinterpret_cast<unsigned*>(address - within), bit << 8 * unsigned(within));
    } else {
        target.shadow.data[at] |= static_cast<int>(bit);
    }
}

// Takes one of a block's strips, of which each is a bit: those of its four warps lie beside each other. False if there
// is none.
WARPCAM_DEVICE bool take_strip(unsigned& strips, unsigned& strip, int lane)
{
    unsigned bit = 0;
    if (lane == 0)
        for (unsigned left = *const_cast<volatile unsigned*>(&strips); left && !bit;) {
            const unsigned lowest = left & -left;
            bit = atomicAnd(&strips, ~lowest) & lowest;
            left &= ~lowest;
        }
    bit = __shfl_sync(FULL_WARP, bit, 0);
    if (!bit)
        return false;
    strip = ctz(bit);
    return true;
}

// Bit mask of a warp's strips that show nothing but a plane. Clears the masks of all strips in a region that the image
// holds.
template <int WIDTH, int HEIGHT, class Target>
WARPCAM_DEVICE unsigned find_floors(const Target& target, size_t corner, int plane)
{
    using Strips = Strip<WIDTH, HEIGHT>;
    constexpr int COUNT = Strips::TILES;
    const int lane = threadIdx.x % WARP_SIZE;
    const unsigned first = Strips::of_warp(threadIdx.x / WARP_SIZE, 0);
    const size_t start = corner
                         + unsigned((Strips::row(first) + Strips::lane_row(lane)) * target.width + Strips::column(first)
                                    + Strips::lane_column(lane));
    decltype(load4(target.shape.data)) ids[Strips::EACH];
#pragma unroll
    for (int number = 0; number < Strips::EACH; ++number) {
        const size_t at = start + unsigned(number * (Strips::WARPS / Strips::ACROSS * TILE_HEIGHT) * target.width);
        ids[number] = load4(target.shape.data + at);
        clear_several<COUNT>(target.shadow.data + at);
    }
    unsigned floors = 0;
#pragma unroll
    for (int number = 0; number < Strips::EACH; ++number)
        floors |= __all_sync(FULL_WARP, all_are(ids[number], plane)) ? 1u << 4 * number : 0u;
    __syncwarp();  // masks that one lane clears another may write
    return floors;
}

#endif

// Clears the masks of a region.
template <int WIDTH, int HEIGHT, class Target>
WARPCAM_DEVICE void clear_shadows(const Target& target, const Region& region, int world, int thread)
{
#if defined(__CUDA_ARCH__)
    constexpr int TOGETHER = 16;
    auto* corner = target.shadow.data + (size_t(world) * target.height + region.top) * target.width + region.left;
    if (region.left + WIDTH <= target.width && region.top + HEIGHT <= target.height
        && (reinterpret_cast<size_t>(corner) | unsigned(target.width)) % TOGETHER == 0) {
        for (int number = thread; number < WIDTH * HEIGHT / TOGETHER; number += THREADS)
            clear_several<TOGETHER>(
                corner + unsigned(number / (WIDTH / TOGETHER) * target.width + number % (WIDTH / TOGETHER) * TOGETHER));
        return;
    }
#endif
    for (int pixel = thread; pixel < WIDTH * HEIGHT; pixel += THREADS) {
        const int i = region.left + pixel % WIDTH, j = region.top + pixel / WIDTH;
        if (i < target.width && j < target.height)
            target.shadow.data[(size_t(world) * target.height + j) * target.width + i] = 0;
    }
}

}  // namespace warpcam
