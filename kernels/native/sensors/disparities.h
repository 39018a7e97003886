// Disparities of least cost, and their median.
#pragma once
#include "core/platform.h"
#include "sensors/census.h"

namespace warpcam {

constexpr float NO_DISPARITY = -1.0f;

// The least of costs from a place to before another; more than any cost of an empty range.
WARPCAM_DEVICE int least_cost(const unsigned short* costs, int begin, int end)
{
    unsigned short least = 0xffff;
    for (int d = begin; d < end; ++d)
        least = costs[d] < least ? costs[d] : least;
    return least;
}

// Place of the least of a curve through three costs, the middle one of which is the least: of a parabola, or of two lines
// of opposite slopes.
WARPCAM_DEVICE float least_between(int below, int least, int above, int is_equiangular)
{
    const int bend = is_equiangular ? max(below, above) - least : below + above - 2 * least;
    return bend > 0 ? 0.5f * float(below - above) / float(bend) : 0.0f;
}

// Writes the disparity of a pixel of the left image to `found`, between whole numbers, or NO_DISPARITY where another is
// nearly as good or the window has no contrast; and that of the same pixel of the right image to `found_right`, a whole number.
template <class Mask, class Matcher>
WARPCAM_DEVICE void choose_disparities(const Mask& mask, const Matcher& matcher, int index)
{
    const int width = matcher.width, disparities = matcher.disparities, pixels = width * matcher.height;
    const int world = index / pixels, column = index % pixels % width;
    if (!mask.data[world])
        return;
    const unsigned short* totals = matcher.totals.data + size_t(index) * disparities;
    // A pixel sees nothing of the right image beyond its edge.
    const int count = min(disparities, column + 1);
    const int least = least_cost(totals, 0, count);
    int best = 0;
    while (totals[best] != least)
        ++best;
    const int second = min(least_cost(totals, 0, best - 1), least_cost(totals, best + 2, count));
    float disparity = float(best);
    if (best > 0 && best + 1 < count)
        disparity += least_between(totals[best - 1], least, totals[best + 1], matcher.is_equiangular);
    const bool is_unique = matcher.uniqueness == 0 || 100 * least < second * (100 - matcher.uniqueness);
    const bool has_contrast = matcher.left.data[index] & HAS_CONTRAST;
    matcher.found.data[index] = is_unique && has_contrast ? disparity : NO_DISPARITY;

    const int count_right = min(disparities, width - column);
    int best_right = 0, least_right = totals[0];
    for (int d = 1; d < count_right; ++d) {
        const int cost = totals[size_t(d) * (disparities + 1)];
        if (cost < least_right)
            least_right = cost, best_right = d;
    }
    matcher.found_right.data[index] = best_right;
}

// The median of a square of so many pixels a side about a pixel of a row-major image, its own value at the border.
// Pixels without a disparity count as NO_DISPARITY.
WARPCAM_DEVICE float median_disparity(const float* image, int width, int height, int pixel, int side)
{
    constexpr int MOST = 49;
    const int radius = side / 2, row = pixel / width, column = pixel % width;
    if (side == 1 || row < radius || column < radius || row >= height - radius || column >= width - radius)
        return image[pixel];
    float values[MOST];
    const int count = side * side;
    for (int i = 0; i < count; ++i) {
        const float value = image[pixel + (i / side - radius) * width + i % side - radius];
        int place = i;
        for (; place > 0 && values[place - 1] > value; --place)
            values[place] = values[place - 1];
        values[place] = value;
    }
    return values[count / 2];
}

// Writes disparity and depth of a pixel, 0 where it has none or is out of range.
template <class Mask, class Matcher, class Measured>
WARPCAM_DEVICE void measure_depth(const Mask& mask, const Matcher& matcher, const Measured& out, int index)
{
    const int width = matcher.width, height = matcher.height, pixels = width * height, world = index / pixels;
    if (!mask.data[world])
        return;
    const float* image = matcher.checked.data + size_t(world) * pixels;
    float disparity = median_disparity(image, width, height, index - world * pixels, matcher.median);
    float depth = 0.0f;
    if (disparity > 0.0f)
        depth = out.baseline.data[world] / (out.views.data[world].scale[0] * disparity);
    if (!(depth >= out.min_depth.data[world] && depth <= out.max_depth.data[world]))
        disparity = depth = 0.0f;
    out.disparity.data[index] = max(disparity, 0.0f);
    out.depth.data[index] = depth;
}

}  // namespace warpcam
