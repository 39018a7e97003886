// Costs of stereo matching: Hamming distances of census words, summed over blocks. A team works on a row or a column of
// an image: a warp, or a thread of a CPU.
#pragma once
#include "core/warp.h"
#include "sensors/census.h"

namespace warpcam {

constexpr int MAX_DISPARITIES = 256;
#if defined(__CUDA_ARCH__)
constexpr int TEAM = WARP_SIZE;
#else
constexpr int TEAM = 1;
#endif
constexpr int TEAM_SLOTS = MAX_DISPARITIES / TEAM;  // disparities of a member at most

// Line of an image and member of its team, of a launch's index.
struct TeamPlace {
    int world, line, member;
};

WARPCAM_DEVICE TeamPlace team_place(int index, int lines)
{
    const int team = index / TEAM;
    return { team / lines, team % lines, index % TEAM };
}

WARPCAM_DEVICE int count_bits(unsigned bits)
{
#if defined(__CUDA_ARCH__)
    return __popc(bits);
#else
    return __builtin_popcount(bits);
#endif
}

// Calls with slot and disparity for each disparity of a member.
template <class Function> WARPCAM_DEVICE void for_disparities(int member, int disparities, Function function)
{
#if defined(__CUDA_ARCH__)
#pragma unroll
    for (int slot = 0; slot < TEAM_SLOTS; ++slot) {
        const int disparity = member + TEAM * slot;
        if (disparity < disparities)
            function(slot, disparity);
    }
#else
    for (int disparity = 0; disparity < disparities; ++disparity)
        function(disparity, disparity);
#endif
}

// Sums of Hamming distances along the rows of blocks, to `totals`. Rows go on as their ends.
template <class Mask, class Matcher>
WARPCAM_DEVICE void sum_matching_rows(const Mask& mask, const Matcher& matcher, int index)
{
    const auto [world, row, member] = team_place(index, matcher.height);
    if (!mask.data[world])
        return;
    const int width = matcher.width, disparities = matcher.disparities, radius = matcher.block_radius_x;
    const size_t begin = (size_t(world) * matcher.height + row) * width;
    const unsigned *left = matcher.left.data + begin, *right = matcher.right.data + begin;
    unsigned short* out = matcher.totals.data + begin * disparities;
    const auto distance = [&](int column, int disparity) {
        const int from = column - disparity;
        return from < 0 ? matcher.bits : count_bits((left[column] ^ right[from]) & ~HAS_CONTRAST);
    };
    int sums[TEAM_SLOTS];
    for_disparities(member, disparities, [&](int slot, int disparity) {
        sums[slot] = (radius + 1) * distance(0, disparity);
        for (int column = 1; column <= radius; ++column)
            sums[slot] += distance(min(column, width - 1), disparity);
        out[disparity] = static_cast<unsigned short>(sums[slot]);
    });
    for (int column = 1; column < width; ++column) {
        const int entering = min(column + radius, width - 1), leaving = max(column - radius - 1, 0);
        out += disparities;
        for_disparities(member, disparities, [&](int slot, int disparity) {
            sums[slot] += distance(entering, disparity) - distance(leaving, disparity);
            out[disparity] = static_cast<unsigned short>(sums[slot]);
        });
    }
}

// Sums of `totals` down the columns of blocks, to `costs`. Columns go on as their ends.
template <class Mask, class Matcher>
WARPCAM_DEVICE void sum_matching_columns(const Mask& mask, const Matcher& matcher, int index)
{
    const auto [world, column, member] = team_place(index, matcher.width);
    if (!mask.data[world])
        return;
    const int height = matcher.height, disparities = matcher.disparities, radius = matcher.block_radius_y;
    const size_t step = size_t(matcher.width) * disparities;
    const size_t begin = size_t(world) * height * step + size_t(column) * disparities;
    const unsigned short* sums_of_rows = matcher.totals.data + begin;
    unsigned short* out = matcher.costs.data + begin;
    int sums[TEAM_SLOTS];
    for_disparities(member, disparities, [&](int slot, int disparity) {
        sums[slot] = (radius + 1) * sums_of_rows[disparity];
        for (int row = 1; row <= radius; ++row)
            sums[slot] += sums_of_rows[min(row, height - 1) * step + disparity];
        out[disparity] = static_cast<unsigned short>(sums[slot]);
    });
    for (int row = 1; row < height; ++row) {
        const unsigned short* entering = sums_of_rows + min(row + radius, height - 1) * step;
        const unsigned short* leaving = sums_of_rows + max(row - radius - 1, 0) * step;
        out += step;
        for_disparities(member, disparities, [&](int slot, int disparity) {
            sums[slot] += entering[disparity] - leaving[disparity];
            out[disparity] = static_cast<unsigned short>(sums[slot]);
        });
    }
}

}  // namespace warpcam
