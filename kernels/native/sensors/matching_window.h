// Pixels of a depth image whose surroundings have about the same disparity, which a match of windows needs. A block
// works on a tile of an image, whose disparities its threads share.
#pragma once
#include "core/warp.h"

namespace warpcam {

constexpr int MATCH_SIDE = 32;  // pixels of a tile across and down
constexpr int MATCH_RUN = 4;  // neighbours whose windows are summed together
constexpr int MATCH_RUNS = MATCH_SIDE / MATCH_RUN;
constexpr float WINDOW_GROWTH = 1.44f;  // tolerance of a neighbour at r pixels, in units of r^2 times the pixel's own
constexpr unsigned UNMATCHED =
    0x7fc00000u;  // bits of the disparity of what is no measurement, NaN: more than all others
constexpr float MAX_FLOAT = 3.4028235e38f;

// Disparities of some pixels that are measured.
struct alignas(16) DisparitySum {
    float total;
    unsigned least;  // bits
    float greatest, count;
};

// Without HOLES nobody asks for counts, which follow from the window.
template <bool HOLES> WARPCAM_DEVICE DisparitySum sum_of(float disparity)
{
    const float measured = max(disparity, 0.0f);
    return { measured, unsigned(as_int(disparity)), measured, HOLES && disparity >= 0.0f ? 1.0f : 0.0f };
}

template <bool HOLES> WARPCAM_DEVICE void join(DisparitySum& sum, const DisparitySum& other)
{
    sum.total += other.total;
    sum.least = other.least < sum.least ? other.least : sum.least;
    sum.greatest = max(sum.greatest, other.greatest);
    if constexpr (HOLES)
        sum.count += other.count;
}

// Sums of 2 radius + 1 places from the first on, from the second, third and fourth; what all have is added up once.
template <bool HOLES, class At> WARPCAM_DEVICE void sum_run(const At& at, int radius, DisparitySum (&sums)[MATCH_RUN])
{
    DisparitySum part = at(2);
    sums[2] = part;
    join<HOLES>(part, at(1));
    sums[1] = part;
    join<HOLES>(part, at(0));
    sums[0] = part;
    DisparitySum common = { 0.0f, ~0u, 0.0f, 0.0f };
    for (int k = 3; k <= 2 * radius; ++k)
        join<HOLES>(common, at(k));
#pragma unroll
    for (int k = 0; k < MATCH_RUN - 1; ++k)
        join<HOLES>(sums[k], common);
    sums[3] = common;
    part = at(2 * radius + 1);
    join<HOLES>(sums[1], part);
    join<HOLES>(part, at(2 * radius + 2));
    join<HOLES>(sums[2], part);
    join<HOLES>(part, at(2 * radius + 3));
    join<HOLES>(sums[3], part);
}

// Disparities of a tile and of what is around it as far as windows reach, and sums of the rows of its columns' windows.
template <int MOST_RADIUS> struct MatchTile {
    static constexpr int REACH = MATCH_SIDE + 2 * MOST_RADIUS;  // pixels that windows have at most across and down
    static constexpr int PITCH = REACH + 1;  // odd: a warp's runs are in banks of their own

    float at[REACH][PITCH];
    DisparitySum rows[REACH][MATCH_SIDE];

    // Places of a row are exchanged within a run, so that stores of runs side by side are in banks of their own.
    WARPCAM_DEVICE DisparitySum& row(int y, int x) { return rows[y][(x & ~3) | ((x + (x >> 3)) & 3)]; }
};

// What a world's windows are measured by.
struct WindowRule {
    float scale;  // disparity at 1 m [pixels]
    float tolerance;  // [pixels]
    float share;  // of the window that must count
    int radius;  // [pixels]
};

// A tile of an image, (height, width), its first pixel, and the thread of the block.
struct TilePlace {
    int width, height, left, top, thread;
};

WARPCAM_DEVICE bool is_measured(float depth) { return depth > 0.0f && depth <= MAX_FLOAT; }

// Disparity of a depth; of what is no measurement not a number of at least 0.
WARPCAM_DEVICE float disparity_of(float depth, float scale)
{
#if defined(__CUDA_ARCH__)
    // A quotient as of `quotient`, but NaN of 0, infinity and what is nearly that.
    const float reciprocal = rcp(depth), nearly = scale * reciprocal;
    return fmaf(fmaf(-depth, nearly, scale), reciprocal, nearly);
#else
    return is_measured(depth) ? scale / depth : -1.0f;
#endif
}

// Disparities of a tile; true if the block's threads found a pixel that is no measurement. A thread has a column, or part
// of it, and asks for some pixels before it waits for the first.
template <class Tile>
WARPCAM_DEVICE bool load_disparities(Tile& tile, const float* image, TilePlace place, WindowRule rule)
{
    constexpr int AT_ONCE = 7;
    const int side = MATCH_SIDE + 2 * rule.radius, lines = max(THREADS / side, 1);
    const int first = THREADS > 1 ? place.thread / side : 0;
    int missing = 0;
    for (int x = place.thread - first * side; x < side && first < lines; x += THREADS) {
        const int column = place.left + x - rule.radius;
        const bool is_inside = column >= 0 && column < place.width;
        for (int y = first; y < side; y += AT_ONCE * lines) {
            const int top = place.top + y - rule.radius;
            float depths[AT_ONCE];
#pragma unroll
            for (int k = 0; k < AT_ONCE; ++k) {
                const int row = top + k * lines;
                const bool is_pixel = is_inside && unsigned(row) < unsigned(place.height);
                depths[k] = is_pixel ? image[row * place.width + column] : -1.0f;
                missing += is_pixel;
            }
#pragma unroll
            for (int k = 0; k < AT_ONCE; ++k) {
                const float disparity = disparity_of(depths[k], rule.scale);
                const bool is_one = disparity >= 0.0f;
                missing -= is_one;
                if (y + k * lines < side)
                    tile.at[y + k * lines][x] = is_one ? disparity : as_float(int(UNMATCHED));
            }
        }
    }
    return block_any(missing != 0);
}

template <bool HOLES, class Tile> WARPCAM_DEVICE void sum_rows(Tile& tile, int radius, int thread)
{
    for (int place = thread; place < (MATCH_SIDE + 2 * radius) * MATCH_RUNS; place += THREADS) {
        const int x = place % MATCH_RUNS * MATCH_RUN, y = place / MATCH_RUNS;
        DisparitySum sums[MATCH_RUN];
        sum_run<HOLES>([&](int k) { return sum_of<HOLES>(tile.at[y][x + k]); }, radius, sums);
#pragma unroll
        for (int k = 0; k < MATCH_RUN; ++k)
            tile.row(y, x + k) = sums[k];
    }
}

// Distance along a row or a column beyond which all pixels count, if none deviates more.
WARPCAM_DEVICE int window_reach(float deviation, float growth, int radius)
{
    int reach = 0;
    while (reach < radius && !(deviation < growth * float((reach + 1) * (reach + 1))))
        ++reach;
    return reach;
}

// True of a measured pixel that does not count, so far across and down from the middle of a window.
WARPCAM_DEVICE bool is_stray(float disparity, float mean, float growth, int across, int down)
{
    return abs(disparity - mean) >= growth * float(across * across + down * down);
}

// Number of strays in a ring: of the pixels so far across or down from the middle of a window, and not more the other way.
template <int PITCH> WARPCAM_DEVICE int ring_strays(const float* middle, int ring, float mean, float growth)
{
    int count = 0;
#pragma unroll
    for (int k = -ring; k < ring; ++k) {
        count += is_stray(middle[k - ring * PITCH], mean, growth, ring, k);
        count += is_stray(middle[ring * PITCH - k], mean, growth, ring, k);
        count += is_stray(middle[-k * PITCH - ring], mean, growth, ring, k);
        count += is_stray(middle[k * PITCH + ring], mean, growth, ring, k);
    }
    return count;
}

// Number of strays in rings up to the reach. Those of a default window are written out.
template <int PITCH> WARPCAM_DEVICE int count_strays(const float* middle, int reach, float mean, float growth)
{
    int count = 0;
    if (reach >= 1)
        count += ring_strays<PITCH>(middle, 1, mean, growth);
    if (reach >= 2)
        count += ring_strays<PITCH>(middle, 2, mean, growth);
    if (reach >= 3)
        count += ring_strays<PITCH>(middle, 3, mean, growth);
    if (reach >= 4)
        count += ring_strays<PITCH>(middle, 4, mean, growth);
    for (int ring = 5; ring <= reach; ++ring)
        count += ring_strays<PITCH>(middle, ring, mean, growth);
    return count;
}

// What pixels of a window are compared with, how far they are from it at most, and how many there are and must count.
struct Window {
    float mean, farthest, count, needed;
};

template <bool HOLES> WARPCAM_DEVICE Window window_of(const DisparitySum& sum, float pixels, float share)
{
    const float count = HOLES ? sum.count : pixels, mean = sum.total * rcp(count);
    return { mean, max(sum.greatest - mean, mean - as_float(int(sum.least))), count, share * pixels };
}

// Whether a large enough share of a window counts for sure, as only its middle and pixels beside it may be strays.
WARPCAM_DEVICE bool is_flat(const Window& window, float growth)
{
    const float strays = window.farthest < growth ? 1.0f : window.farthest < 4.0f * growth ? 9.0f : MISS;
    return window.count - strays >= window.needed;
}

// Whether a large enough share of the window of a tile's pixel counts. Pixels are tried out to where the extremes of the
// window show that all farther ones count.
template <class Tile>
WARPCAM_DEVICE bool is_matched(const Tile& tile, int x, int y, const Window& window, WindowRule rule)
{
    const float growth = WINDOW_GROWTH * rule.tolerance;
    const float* middle = &tile.at[y + rule.radius][x + rule.radius];
    const int reach = window_reach(window.farthest, growth, rule.radius);
    const int strays =
        (abs(*middle - window.mean) >= rule.tolerance) + count_strays<Tile::PITCH>(middle, reach, window.mean, growth);
    return window.count - float(strays) >= window.needed && abs(window.mean) <= MAX_FLOAT;  // numbers alone measure
}

// Sets pixels of a tile to 0 of whose window too small a share counts: a thread has runs of a column.
//
// A neighbour at r pixels counts if its disparity differs from the mean of the window by less than WINDOW_GROWTH r^2
// tolerance, the pixel itself by less than the tolerance.
template <bool HOLES, class Tile>
WARPCAM_DEVICE void keep_pixels(Tile& tile, const float* image, float* out, TilePlace place, WindowRule rule)
{
    const int radius = rule.radius;
    for (int piece = place.thread; piece < MATCH_SIDE * MATCH_RUNS; piece += THREADS) {
        const int x = piece % MATCH_SIDE, y = piece / MATCH_SIDE * MATCH_RUN;
        const int column = place.left + x, top = place.top + y;
        if (column >= place.width || top >= place.height)
            continue;
        DisparitySum sums[MATCH_RUN];
        sum_run<HOLES>([&](int k) { return tile.row(y + k, x); }, radius, sums);
        const int columns = min(column + radius + 1, place.width) - max(column - radius, 0);
        const auto pixels_of = [&](int row) {
            return float(columns * (min(row + radius + 1, place.height) - max(row - radius, 0)));
        };
        int open = 0;
#pragma unroll
        for (int k = 0; k < MATCH_RUN; ++k) {
            const Window window = window_of<HOLES>(sums[k], pixels_of(top + k), rule.share);
            open |= int(!is_flat(window, WINDOW_GROWTH * rule.tolerance)) << k;
        }
        const float* depths = image + (top * place.width + column);
        float* kept = out + (top * place.width + column);
        int dropped = 0;
        while (open) {  // one of the four after another, each thread its own
            const int k = ctz(open);
            open &= open - 1;
            const DisparitySum sum = k < 2 ? (k < 1 ? sums[0] : sums[1]) : (k < 3 ? sums[2] : sums[3]);
            const Window window = window_of<HOLES>(sum, pixels_of(top + k), rule.share);
            if (!is_matched(tile, x, y + k, window, rule) && top + k < place.height)
                dropped |= int(is_measured(depths[k * place.width])) << k;
        }
#pragma unroll
        for (int k = 0; k < MATCH_RUN; ++k)
            if (top + k < place.height)  // bits, as the compiler makes a choice a branch
                kept[k * place.width] = as_float(as_int(depths[k * place.width]) & ((dropped >> k & 1) - 1));
    }
}

template <class Tile>
WARPCAM_DEVICE void keep_tile(Tile& tile, const float* image, float* out, TilePlace place, WindowRule rule)
{
    if (load_disparities(tile, image, place, rule)) {
        sum_rows<true>(tile, rule.radius, place.thread);
        block_sync();
        keep_pixels<true>(tile, image, out, place, rule);
    } else {
        sum_rows<false>(tile, rule.radius, place.thread);
        block_sync();
        keep_pixels<false>(tile, image, out, place, rule);
    }
}

// Keeps the matches of so many tiles of an image, one after another. FIXED, windows have that radius, or at most.
template <int MOST_RADIUS, bool FIXED, class Mask, class Rule, class Images>
WARPCAM_DEVICE void keep_matches(const Mask& mask, int width, int height, int run, const Rule& given,
                                 const Images& source, const Images& target, int index)
{
    const int across = (width + MATCH_SIDE - 1) / MATCH_SIDE, tiles = across * ((height + MATCH_SIDE - 1) / MATCH_SIDE);
    const int blocks = (tiles + run - 1) / run, block = index / THREADS, thread = index - block * THREADS;
    const int world = unsigned(block) / unsigned(blocks), first = (block - world * blocks) * run;
    if (!mask.data[world])
        return;
    const float focal = given.focal.data[world];
    const float pixels = !(focal <= 0.0f) ? focal : 1.0f / given.views.data[world].scale[0];
    const WindowRule rule = { pixels * given.baseline.data[world], max(given.tolerance.data[world], 0.0f),
                              given.share.data[world], FIXED ? MOST_RADIUS : given.radius };
    const float* image = keep_address(source.data + size_t(world) * (width * height));
    float* out = keep_address(target.data + size_t(world) * (width * height));
    WARPCAM_SHARED MatchTile<MOST_RADIUS> tile;
    for (int number = first; number < min(first + run, tiles); ++number) {
        const int line = unsigned(number) / unsigned(across);
        const TilePlace place = { width, height, MATCH_SIDE * (number - line * across), MATCH_SIDE * line, thread };
        keep_tile(tile, image, out, place, rule);
        block_sync();
    }
}

}  // namespace warpcam
