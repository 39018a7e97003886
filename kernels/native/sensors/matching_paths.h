// Semi-global matching: costs along lines of an image, there and back, added up. A team works on a line: a warp, or a
// thread of a CPU.
//
// Along a path cost L of disparity d at a pixel is C(d) + min(L'(d), L'(d - 1) + p1, L'(d + 1) + p1, m + p2) - m, with
// L' of the pixel before and m its least (Hirschmueller, "Stereo Processing by Semiglobal Matching and Mutual
// Information", 2008).
#pragma once
#include "sensors/matching_costs.h"

namespace warpcam {

enum MatchingAxis { ALONG_ROWS, ALONG_COLUMNS, ALONG_FALLING_DIAGONALS, ALONG_RISING_DIAGONALS };

constexpr int NO_PATH = 0x7000;  // more than any cost, and no overflow of 16 bits with p2 added

// Pixels of a line of an image, one after another.
struct MatchingLine {
    int first, step, count;  // number of the first pixel, from one to the next, and how many
};

template <class Matcher> WARPCAM_DEVICE int count_lines(const Matcher& matcher, int axis)
{
    if (axis == ALONG_ROWS)
        return matcher.height;
    return axis == ALONG_COLUMNS ? matcher.width : matcher.width + matcher.height - 1;
}

template <class Matcher> WARPCAM_DEVICE MatchingLine matching_line(const Matcher& matcher, int axis, int line)
{
    const int width = matcher.width, height = matcher.height;
    if (axis == ALONG_ROWS)
        return { line * width, 1, width };
    if (axis == ALONG_COLUMNS)
        return { line, width, height };
    const int row = max(line - width + 1, 0);
    if (axis == ALONG_FALLING_DIAGONALS) {
        const int column = line < width ? line : 0;
        return { row * width + column, width + 1, min(width - column, height - row) };
    }
    const int column = min(line, width - 1);
    return { row * width + column, width - 1, min(column + 1, height - row) };
}

#if defined(__CUDA_ARCH__)

// The way along a line. Each lane has COUNT neighbouring disparities; those beyond the last have none.
template <int COUNT> struct MatchingWalk {
    using Costs = AlignedArray<unsigned short, COUNT>;

    const unsigned short* costs;
    unsigned short* totals;
    int p1, p2, lane;
    bool is_used, is_last;  // whether the lane has disparities, and the last
    bool is_first_way;  // totals are written, not added to

    WARPCAM_DEVICE void run(long long begin, long long step, int pixels)
    {
        int paths[COUNT];
        int least = 0;
        Costs cost {}, total {};
        load(begin, cost, total);
        for (int pixel = 0; pixel < pixels; ++pixel) {
            Costs next_cost {}, next_total {};
            if (pixel + 1 < pixels)  // asked for long before it is used
                load(begin + step, next_cost, next_total);
            int values[COUNT];
            if (pixel == 0) {
                for (int k = 0; k < COUNT; ++k)
                    values[k] = cost.at[k];
            } else {
                const int before = __shfl_up_sync(FULL_WARP, paths[COUNT - 1], 1);
                const int after = __shfl_down_sync(FULL_WARP, paths[0], 1);
                for (int k = 0; k < COUNT; ++k) {
                    const int lower = k > 0 ? paths[k > 0 ? k - 1 : 0] : lane > 0 ? before : NO_PATH;
                    const int upper = k + 1 < COUNT ? paths[k + 1 < COUNT ? k + 1 : k] : is_last ? NO_PATH : after;
                    const int way = min(min(paths[k], least + p2), min(lower, upper) + p1);
                    values[k] = cost.at[k] + way - least;
                }
            }
            int own = NO_PATH;
            for (int k = 0; k < COUNT; ++k) {
                paths[k] = is_used ? values[k] : NO_PATH;
                own = min(own, paths[k]);
            }
            least = warp_reduce_min(own);
            if (is_used) {
                Costs sum;
                for (int k = 0; k < COUNT; ++k)
                    sum.at[k] = static_cast<unsigned short>(total.at[k] + paths[k]);
                *reinterpret_cast<Costs*>(totals + begin) = sum;
            }
            cost = next_cost;
            total = next_total;
            begin += step;
        }
    }

    WARPCAM_DEVICE void load(long long begin, Costs& cost, Costs& total) const
    {
        if (!is_used)
            return;
        cost = load_vector<COUNT>(costs + begin);
        if (!is_first_way)
            total = load_vector<COUNT>(totals + begin);
    }
};

template <int COUNT, class Matcher>
WARPCAM_DEVICE void add_matching_paths_of(const Matcher& matcher, int world, MatchingLine line, bool is_first, int lane)
{
    const int disparities = matcher.disparities;
    const size_t image = size_t(world) * matcher.width * matcher.height * disparities + lane * COUNT;
    MatchingWalk<COUNT> walk {
        matcher.costs.data + image, matcher.totals.data + image,       matcher.p1, matcher.p2, lane,
        lane * COUNT < disparities, (lane + 1) * COUNT >= disparities, is_first
    };
    const long long step = (long long)line.step * disparities, begin = (long long)line.first * disparities;
    walk.run(begin, step, line.count);
    walk.is_first_way = false;
    walk.run(begin + (line.count - 1) * step, -step, line.count);
}

#else

// The way along a line. Paths have a place more on either side, which none takes.
template <class Matcher> WARPCAM_DEVICE void walk_matching_line(const Matcher& matcher, const unsigned short* costs,
                                                                unsigned short* totals, long long step, int pixels,
                                                                bool is_first)
{
    using Cost = unsigned short;
    const int disparities = matcher.disparities;
    const Cost p1 = Cost(matcher.p1), p2 = Cost(matcher.p2);
    Cost rows[2][MAX_DISPARITIES + 2];
    Cost *paths = rows[0], *before = rows[1];
    Cost least = 0;
    for (int pixel = 0; pixel < pixels; ++pixel) {
        if (pixel == 0) {
            for (int d = 0; d < disparities; ++d)
                paths[d + 1] = costs[d];
        } else {
            const Cost jump = Cost(least + p2);
            for (int d = 0; d < disparities; ++d) {
                const Cost beside = Cost((before[d] < before[d + 2] ? before[d] : before[d + 2]) + p1);
                const Cost near = beside < before[d + 1] ? beside : before[d + 1];
                paths[d + 1] = Cost(costs[d] + Cost((near < jump ? near : jump) - least));
            }
        }
        paths[0] = paths[disparities + 1] = NO_PATH;
        least = NO_PATH;
        for (int d = 0; d < disparities; ++d)
            least = paths[d + 1] < least ? paths[d + 1] : least;
        if (is_first)
            for (int d = 0; d < disparities; ++d)
                totals[d] = paths[d + 1];
        else
            for (int d = 0; d < disparities; ++d)
                totals[d] = Cost(totals[d] + paths[d + 1]);
        Cost* const swapped = paths;
        paths = before;
        before = swapped;
        costs += step;
        totals += step;
    }
}

#endif

// Adds the costs of the two paths along a line to `totals`; along rows, which come first, they are written.
template <class Mask, class Matcher>
WARPCAM_DEVICE void add_matching_paths(const Mask& mask, const Matcher& matcher, int axis, int index)
{
    const auto [world, number, member] = team_place(index, count_lines(matcher, axis));
    if (!mask.data[world])
        return;
    const MatchingLine line = matching_line(matcher, axis, number);
    const bool is_first = axis == ALONG_ROWS;
#if defined(__CUDA_ARCH__)
    if (matcher.disparities <= WARP_SIZE)
        add_matching_paths_of<1>(matcher, world, line, is_first, member);
    else if (matcher.disparities <= 2 * WARP_SIZE)
        add_matching_paths_of<2>(matcher, world, line, is_first, member);
    else if (matcher.disparities <= 4 * WARP_SIZE)
        add_matching_paths_of<4>(matcher, world, line, is_first, member);
    else
        add_matching_paths_of<8>(matcher, world, line, is_first, member);
#else
    const long long step = (long long)line.step * matcher.disparities;
    const size_t first = (size_t(world) * matcher.width * matcher.height + line.first) * matcher.disparities;
    const size_t last = first + (line.count - 1) * step;
    walk_matching_line(matcher, matcher.costs.data + first, matcher.totals.data + first, step, line.count, is_first);
    walk_matching_line(matcher, matcher.costs.data + last, matcher.totals.data + last, -step, line.count, false);
#endif
}

}  // namespace warpcam
