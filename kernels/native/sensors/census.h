// Center-symmetric census transform: a bit for each pair of pixels that face each other across the middle of a window,
// and one that is set if any pair differs by a contrast.
#pragma once
#include "core/platform.h"

namespace warpcam {

constexpr unsigned HAS_CONTRAST = 0x80000000u;  // no bit of a pair

// A row of a pair's pixels above the middle of the window, and the row that faces it.
struct CensusRows {
    const unsigned char *above, *below;
};

template <class Matcher>
WARPCAM_DEVICE CensusRows census_rows(const Matcher& matcher, const unsigned char* image, int row, int down)
{
    const int last = matcher.height - 1;
    return { image + max(row + down, 0) * matcher.width, image + min(row - down, last) * matcher.width };
}

// Is the first of a pair as bright as the second, and do they differ by the contrast?
WARPCAM_DEVICE unsigned census_bits(int first, int second, int bit, int contrast)
{
    const int difference = first - second;
    const unsigned differs = (difference < 0 ? -difference : difference) >= contrast ? HAS_CONTRAST : 0u;
    return differs | unsigned(difference >= 0) << bit;
}

WARPCAM_DEVICE unsigned census_bits_at(CensusRows rows, int column, int across, int last, int bit, int contrast)
{
    const int first = max(min(column + across, last), 0), second = max(min(column - across, last), 0);
    return census_bits(rows.above[first], rows.below[second], bit, contrast);
}

// Writes the word of a pixel (CUDA) or those of a row of pixels (CPU). The image goes on as its border.
template <class Mask, class Matcher, class Images, class Words>
WARPCAM_DEVICE void take_census(const Mask& mask, const Matcher& matcher, const Images& images, const Words& words,
                                int index)
{
    const int width = matcher.width, height = matcher.height, last = width - 1;
    const int radius_x = matcher.census_radius_x, radius_y = matcher.census_radius_y, contrast = matcher.contrast;
#if defined(__CUDA_ARCH__)
    const int line = index / width, column = index - line * width;
#else
    const int line = index;
#endif
    const int world = line / height, row = line - world * height;
    if (!mask.data[world])
        return;
    const unsigned char* image = images.data + size_t(world) * width * height;
    unsigned* out = words.data + size_t(line) * width;
#if defined(__CUDA_ARCH__)
    unsigned word = 0;
#else
    for (int column = 0; column < width; ++column)
        out[column] = 0;
#endif
    int bit = 0;
    for (int down = -radius_y; down <= 0; ++down) {
        const CensusRows rows = census_rows(matcher, image, row, down);
        for (int across = -radius_x; across <= (down < 0 ? radius_x : -1); ++across, ++bit) {
#if defined(__CUDA_ARCH__)
            word |= census_bits_at(rows, column, across, last, bit, contrast);
#else
            const int begin = min(across < 0 ? -across : across, width), end = max(width - begin, begin);
            for (int column = 0; column < begin; ++column)
                out[column] |= census_bits_at(rows, column, across, last, bit, contrast);
            const unsigned char *first = rows.above + across, *second = rows.below - across;
            for (int column = begin; column < end; ++column)
                out[column] |= census_bits(first[column], second[column], bit, contrast);
            for (int column = end; column < width; ++column)
                out[column] |= census_bits_at(rows, column, across, last, bit, contrast);
#endif
        }
    }
#if defined(__CUDA_ARCH__)
    out[column] = word;
#endif
}

}  // namespace warpcam
