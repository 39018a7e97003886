// Pixels of a depth image whose surroundings have about the same disparity, which a match of windows needs. A block
// works on a tile of an image, whose disparities its threads share.
#pragma once
#include "core/warp.h"

namespace warpcam {

constexpr int MATCH_SIDE = 32;  // pixels of a tile across and down
constexpr int MATCH_RUN = 4;  // neighbours whose windows are summed together
constexpr int MATCH_RUNS = MATCH_SIDE / MATCH_RUN;
constexpr float WINDOW_GROWTH = 1.44f;  // tolerance of a neighbour at r pixels, in units of r^2 times the pixel's own
constexpr float UNMATCHED = -1.0f;  // disparity of what is no measurement: as bits more than all others

// Measured disparities of some pixels.
struct alignas(16) DisparitySum {
    float total, count;
    unsigned least;  // bits
    float greatest;
};

WARPCAM_DEVICE DisparitySum sum_of(float disparity)
{
    const float measured = max(disparity, 0.0f);
    return { measured, disparity >= 0.0f ? 1.0f : 0.0f, unsigned(as_int(disparity)), measured };
}

WARPCAM_DEVICE void join(DisparitySum& sum, const DisparitySum& other)
{
    sum.total += other.total;
    sum.count += other.count;
    sum.least = other.least < sum.least ? other.least : sum.least;
    sum.greatest = max(sum.greatest, other.greatest);
}

// Sums of 2 radius + 1 places from the first on, from the second, third and fourth; what all have is added up once.
template <class At> WARPCAM_DEVICE void sum_run(const At& at, int radius, DisparitySum (&sums)[MATCH_RUN])
{
    DisparitySum part = at(2);
    sums[2] = part;
    join(part, at(1));
    sums[1] = part;
    join(part, at(0));
    sums[0] = part;
    DisparitySum common = { 0.0f, 0.0f, ~0u, 0.0f };
    for (int k = 3; k <= 2 * radius; ++k)
        join(common, at(k));
#pragma unroll
    for (int k = 0; k < MATCH_RUN - 1; ++k)
        join(sums[k], common);
    sums[3] = common;
    part = at(2 * radius + 1);
    join(sums[1], part);
    join(part, at(2 * radius + 2));
    join(sums[2], part);
    join(part, at(2 * radius + 3));
    join(sums[3], part);
}

// Disparities of a tile and of what is around it as far as windows reach. Of its columns, sums of the windows' rows, and
// then of its pixels, sums of the windows.
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

template <class Tile, class Depths> WARPCAM_DEVICE void load_disparities(Tile& tile, const Depths* image, int width,
                                                                         int height, int left, int top, WindowRule rule,
                                                                         int thread)
{
    constexpr int LANES = min(THREADS, WARP_SIZE);
    const int radius = rule.radius;
    for (int y = thread / LANES; y < MATCH_SIDE + 2 * radius; y += THREADS / LANES) {
        for (int x = thread % LANES; x < MATCH_SIDE + 2 * radius; x += LANES) {
            const int column = left + x - radius, row = top + y - radius;
            float disparity = UNMATCHED;
            if (column >= 0 && column < width && row >= 0 && row < height) {
                const float depth = image[row * width + column];
                if (depth > 0.0f && depth <= 3.4028235e38f)
                    disparity = quotient(rule.scale, depth, rcp(depth));
            }
            tile.at[y][x] = disparity;
        }
    }
}

template <class Tile> WARPCAM_DEVICE void sum_rows(Tile& tile, int radius, int thread)
{
    for (int place = thread; place < (MATCH_SIDE + 2 * radius) * MATCH_RUNS; place += THREADS) {
        const int x = place % MATCH_RUNS * MATCH_RUN, y = place / MATCH_RUNS;
        DisparitySum sums[MATCH_RUN];
        sum_run([&](int k) { return sum_of(tile.at[y][x + k]); }, radius, sums);
#pragma unroll
        for (int k = 0; k < MATCH_RUN; ++k)
            tile.row(y, x + k) = sums[k];
    }
}

// Sums of the windows of a tile's pixels, from those of rows.
template <class Tile> WARPCAM_DEVICE void sum_windows(Tile& tile, int radius, int thread)
{
    constexpr int PIECES = MATCH_SIDE * MATCH_RUNS / THREADS;
    static_assert(PIECES * THREADS == MATCH_SIDE * MATCH_RUNS, "a block has all pieces of columns at once");
    DisparitySum sums[PIECES][MATCH_RUN];
    for (int piece = 0; piece < PIECES; ++piece) {
        const int place = piece * THREADS + thread, x = place % MATCH_SIDE, y = place / MATCH_SIDE * MATCH_RUN;
        sum_run([&](int k) { return tile.row(y + k, x); }, radius, sums[piece]);
    }
    block_sync();
    for (int piece = 0; piece < PIECES; ++piece) {
        const int place = piece * THREADS + thread, x = place % MATCH_SIDE, y = place / MATCH_SIDE * MATCH_RUN;
#pragma unroll
        for (int k = 0; k < MATCH_RUN; ++k)
            tile.row(y + k, x) = sums[piece][k];
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
    return disparity >= 0.0f && !(abs(disparity - mean) < growth * float(across * across + down * down));
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

// Sets pixels of a tile to 0 of whose window too small a share counts.
//
// A neighbour at r pixels counts if its disparity differs from the mean of the window by less than WINDOW_GROWTH r^2
// tolerance, the pixel itself by less than the tolerance. Pixels are tried out to where the extremes of the window show
// that all farther ones count: none on most flat surfaces.
template <class Tile, class Depths> WARPCAM_DEVICE void keep_tile(Tile& tile, const Depths* image, Depths* out,
                                                                  int width, int height, int left, int top,
                                                                  WindowRule rule, int thread)
{
    load_disparities(tile, image, width, height, left, top, rule, thread);
    block_sync();
    sum_rows(tile, rule.radius, thread);
    block_sync();
    sum_windows(tile, rule.radius, thread);
    block_sync();
    const int radius = rule.radius;
    const float growth = WINDOW_GROWTH * rule.tolerance;
    for (int place = thread; place < MATCH_SIDE * MATCH_SIDE; place += THREADS) {
        const int x = place % MATCH_SIDE, y = place / MATCH_SIDE, column = left + x, row = top + y;
        if (column >= width || row >= height)
            continue;
        float depth = image[row * width + column];
        const float disparity = tile.at[y + radius][x + radius];
        if (disparity != UNMATCHED) {  // what is no number measures nothing
            const DisparitySum sum = tile.row(y, x);
            const float mean = quotient(sum.total, sum.count, rcp(sum.count));
            const float farthest = max(sum.greatest - mean, mean - as_float(int(sum.least)));
            const int reach = window_reach(farthest, growth, radius);
            const float* middle = &tile.at[y + radius][x + radius];
            int alike = int(sum.count) - !(abs(disparity - mean) < rule.tolerance);
            alike -= count_strays<Tile::PITCH>(middle, reach, mean, growth);
            const int columns = min(column + radius + 1, width) - max(column - radius, 0);
            const int lines = min(row + radius + 1, height) - max(row - radius, 0);
            if (!(float(alike) >= rule.share * float(lines * columns)))
                depth = 0.0f;
        }
        out[row * width + column] = depth;
    }
}

// Keeps the matches of so many tiles of an image, one after another.
template <int MOST_RADIUS, class Mask, class Rule, class Images>
WARPCAM_DEVICE void keep_matches(const Mask& mask, int width, int height, int run, const Rule& given,
                                 const Images& source, const Images& target, int index)
{
    const int across = (width + MATCH_SIDE - 1) / MATCH_SIDE, tiles = across * ((height + MATCH_SIDE - 1) / MATCH_SIDE);
    const int blocks = (tiles + run - 1) / run, block = index / THREADS, thread = index - block * THREADS;
    const int world = block / blocks, first = (block - world * blocks) * run;
    if (!mask.data[world])
        return;
    const float focal = given.focal.data[world];
    const float pixels = !(focal <= 0.0f) ? focal : 1.0f / given.views.data[world].scale[0];
    const WindowRule rule = { pixels * given.baseline.data[world], given.tolerance.data[world], given.share.data[world],
                              given.radius };
    const size_t start = size_t(world) * width * height;
    WARPCAM_SHARED MatchTile<MOST_RADIUS> tile;
    for (int number = first; number < min(first + run, tiles); ++number) {
        const int line = number / across;
        keep_tile(tile, source.data + start, target.data + start, width, height, MATCH_SIDE * (number - line * across),
                  MATCH_SIDE * line, rule, thread);
        block_sync();
    }
}

}  // namespace warpcam
