// The pixels of some rows of an image that have edges, on CUDA. What the trace has found there is kept in shared
// memory: see PixelCache. Each warp goes down rows of 32 pixels, a lane a column, and notes those that may have an
// edge; these are then looked at once more, 32 at a time, whatever tiles they lie in.
#pragma once
#include "antialiasing/pixel_cache.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// Pixels of each row that may have an edge, and whose surface is bent.
template <int HEIGHT> struct EdgeMarks {
    unsigned maybe[HEIGHT], bent[HEIGHT];
};

// A pixel's place is counted row after row.
template <int LENS, int WIDTH, int HEIGHT, int IMAGES, class Target> struct EdgeFinder {
    using Centres = PixelCache<Target, IMAGES, WIDTH, HEIGHT>;
    static constexpr int LINE = Centres::LINE, WARPS = THREADS / WARP_SIZE;
    static_assert(WIDTH <= WARP_SIZE && HEIGHT % WARPS == 0, "a lane for each column, as many rows for each warp");

    EdgeMarks<HEIGHT>& marks;
    const EdgeTester<LENS, Centres>& seen;
    int left, top;  // of the first pixel, in the image

    // Some of the pixels around one, a bit for each pair of them.
    struct Ring {
        unsigned beside, across;
    };

    // Index at which a pixel is stored, by its position.
    WARPCAM_DEVICE static unsigned cache_index(unsigned place)
    {
        return place / WIDTH * LINE + place % WIDTH + LINE + 1;
    }

    // Notes which pixels may have an edge. Then a barrier.
    WARPCAM_DEVICE void look() const
    {
        const Target& target = seen.centres.target;
        constexpr int ROWS = HEIGHT / WARPS;
        const int lane = threadIdx.x % WARP_SIZE, first = threadIdx.x / WARP_SIZE * ROWS, i = left + lane;
        const bool inside = lane < WIDTH && i < target.width, amid = i > 0 && i + 1 < target.width;
        unsigned pixel = unsigned((first + 1) * LINE + min(lane, WIDTH - 1) + 1);
        int above = seen.shape(pixel - LINE), here = seen.shape(pixel);
        float depth_above = seen.depth(pixel - LINE), depth_here = seen.depth(pixel);
#pragma unroll 2
        for (int row = first; row < first + ROWS; ++row, pixel += LINE) {
            const int j = top + row;
            const int below = seen.shape(pixel + LINE);
            const float depth_below = seen.depth(pixel + LINE);
            const bool within =
                (here == above) & (here == below) & (here == seen.shape(pixel - 1)) & (here == seen.shape(pixel + 1));
            const bool bent =
                (amid & seen.turns_at(seen.depth(pixel - 1), depth_here, seen.depth(pixel + 1), seen.scale_x))
                | ((j > 0) & (j + 1 < target.height)
                   & seen.turns_at(depth_above, depth_here, depth_below, seen.scale_y));
            const bool there = inside & (j < target.height), bent_there = within & bent & (here >= 0);
            const unsigned maybe = __ballot_sync(FULL_WARP, there & (!within | bent_there));
            const unsigned bent_lanes = __ballot_sync(FULL_WARP, bent_there);
            if (lane == 0) {
                marks.maybe[row] = maybe;
                marks.bent[row] = bent_lanes;
            }
            above = here;
            here = below;
            depth_above = depth_here;
            depth_here = depth_below;
        }
    }

    // Lists these pixels and returns how many there are: those of tiles of 4x8 pixels, whose samples see the fewest
    // shapes, one after another. Then a barrier.
    WARPCAM_DEVICE int list_pixels(unsigned short* pixels) const
    {
        constexpr unsigned TILE_COLUMNS_PER_WARP = 4, HIGH = WARP_SIZE / TILE_COLUMNS_PER_WARP,
                           ACROSS = WIDTH / TILE_COLUMNS_PER_WARP, TILES = ACROSS * (HEIGHT / HIGH);
        static_assert(TILES <= WARP_SIZE, "a lane for each");
        const unsigned lane = threadIdx.x % WARP_SIZE, warp = threadIdx.x / WARP_SIZE;
        unsigned mask = 0;  // of the lane's tile
        if (lane < TILES)
#pragma unroll
            for (unsigned k = 0; k < HIGH; ++k)
                mask |= (marks.maybe[lane / ACROSS * HIGH + k] >> lane % ACROSS * TILE_COLUMNS_PER_WARP
                         & ((1u << TILE_COLUMNS_PER_WARP) - 1))
                        << TILE_COLUMNS_PER_WARP * k;
        int until = __popc(mask);
#pragma unroll
        for (int step = 1; step < WARP_SIZE; step *= 2) {
            const int before = __shfl_up_sync(FULL_WARP, until, step);
            until += int(lane) >= step ? before : 0;
        }
        for (unsigned tile = warp; tile < TILES; tile += WARPS) {
            const unsigned its = __shfl_sync(FULL_WARP, mask, tile);
            const int end = __shfl_sync(FULL_WARP, until, tile);
            const unsigned row = tile / ACROSS * HIGH + lane / TILE_COLUMNS_PER_WARP,
                           column = tile % ACROSS * TILE_COLUMNS_PER_WARP + lane % TILE_COLUMNS_PER_WARP;
            if (its >> lane & 1)
                pixels[end - __popc(its >> lane)] = static_cast<unsigned short>(row * WIDTH + column);
        }
        return __shfl_sync(FULL_WARP, until, WARP_SIZE - 1);
    }

    // EdgeTester::edge() of a pixel that may have an edge, by its position.
    template <bool SIDED, class HasSides> WARPCAM_DEVICE unsigned edge(unsigned place, const HasSides& has_sides) const
    {
        const unsigned pixel = cache_index(place);
        const bool bent = marks.bent[place / WIDTH] >> place % WIDTH & 1;
        // the pixels around by the pairs that a sample lies at, from the one below on by way of the left: those beside,
        // and those across
        const unsigned beside[4] { pixel + LINE, pixel - 1, pixel - LINE, pixel + 1 };
        const unsigned across[4] { pixel + LINE - 1, pixel - LINE - 1, pixel - LINE + 1, pixel + LINE + 1 };
        const int here = seen.shape(pixel);
        const Colour<IMAGES> its = seen.template colour<IMAGES>(pixel);
        Ring other {}, gaps {}, wide {};
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            other.beside |= unsigned(seen.shape(beside[k]) != here) << k;
            other.across |= unsigned(seen.shape(across[k]) != here) << k;
        }
        const bool within = !other.beside;
        const int tolerance = within ? TOLERANCE_WITHIN : COLOR_TOLERANCE;
#pragma unroll
        for (int k = 0; k < 4; ++k) {
            const auto one = seen.template colour<IMAGES>(beside[k]), two = seen.template colour<IMAGES>(across[k]);
            gaps.beside |= unsigned(its.differs(one, tolerance)) << k;
            gaps.across |= unsigned(its.differs(two, tolerance)) << k;
            if (SIDED) {
                wide.beside |= unsigned(its.differs(one, TOLERANCE_OF_SIDES)) << k;
                wide.across |= unsigned(its.differs(two, TOLERANCE_OF_SIDES)) << k;
            }
        }
        unsigned pairs = within ? (bent ? EVERY_SAMPLE : 0) : other.beside | other.across;
        pairs &= gaps.beside | gaps.across | gaps.beside >> 1 | gaps.beside << 3;
        if (SIDED && !within && has_sides(here))
            pairs |= (wide.beside | wide.across) & ~(other.beside | other.across);
        pairs &= EVERY_SAMPLE;
        const bool plain = pairs && !within && !(gaps.beside & ~other.beside) && !(gaps.across & ~other.across);
        // the pairs are those of samples 0, 2, 3 and 1
        return (pairs & 1) | (pairs << 1 & 12) | (pairs >> 2 & 2) | (plain ? PLAIN : 0);
    }
};

}  // namespace warpcam
#endif
