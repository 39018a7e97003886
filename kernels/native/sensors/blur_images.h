// Gaussian blur of images, whose colours are rows of numbers: all channels are treated alike, and threads that read
// together read what is next to each other.
#pragma once
#include "core/vec3.h"
#include "sensors/color_bytes.h"

namespace warpcam {

constexpr int BLUR_ROWS = 16;  // of a column of numbers that a thread has
constexpr int NEAR_PIXELS = 3;  // least radius that is not blurred across and down at once [pixels], less one
constexpr float MAX_SIGMA = 10.0f;  // as in warpcam/sensors/kernels/neighborhoods.py

// Weights out to three standard deviations: the middle has 1, the next pixel ratio, then ratio^4, ratio^9, ...
struct BlurWeights {
    int radius;  // [pixels]
    float ratio;
};

WARPCAM_DEVICE BlurWeights blur_weights(float sigma)
{
    if (!(sigma > 0.0f))  // NaN, too
        return { 0, 0.0f };
    const float spread = min(sigma, MAX_SIGMA);
    return { (int)wp::ceil(3.0f * spread), wp::exp(-0.5f / (spread * spread)) };
}

// Where a thread works: numbers of a column from a row on, and the numbers in its row of the first and the last pixel.
struct BlurPlace {
    int column, top, first, last;
};

WARPCAM_DEVICE BlurPlace blur_place(int piece, int width)
{
    const int strip = unsigned(piece) / unsigned(width), column = piece - strip * width, first = column % 3;
    return { column, BLUR_ROWS * strip, first, width - 3 + first };
}

// Writes the numbers of a place in a world's image; width is that of rows of numbers.
template <class Target> WARPCAM_DEVICE void set_place(const Target& target, int world, BlurPlace place, int width,
                                                      int height, const float (&values)[BLUR_ROWS])
{
    const int across = width / 3;
    const size_t pixel = size_t(world) * (across * height) + (place.top * across + place.column / 3);
    set_column(target, pixel, place.first, across, height - place.top, values);
}

WARPCAM_DEVICE int blur_pieces(int width, int height) { return width * ((height + BLUR_ROWS - 1) / BLUR_ROWS); }

// Blurs a piece along rows, which go on as the pixels at their ends.
WARPCAM_DEVICE void blur_rows_of(const float* image, float* out, BlurPlace place, int width, int height,
                                 BlurWeights gaussian)
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    int rows[BLUR_ROWS];
    float totals[BLUR_ROWS];
#pragma unroll
    for (int k = 0; k < BLUR_ROWS; ++k) {
        rows[k] = min(place.top + k, height - 1) * width;
        totals[k] = image[rows[k] + place.column];
    }
    float ratio = gaussian.ratio, weight = 1.0f, weights = 1.0f;
    const float growth = ratio * ratio;
    for (int distance = 1; distance <= gaussian.radius; ++distance) {
        weight *= ratio;
        ratio *= growth;
        const int before = max(place.column - 3 * distance, place.first);
        const int after = min(place.column + 3 * distance, place.last);
#pragma unroll
        for (int k = 0; k < BLUR_ROWS; ++k)
            totals[k] += weight * (image[rows[k] + before] + image[rows[k] + after]);
        weights += 2.0f * weight;
    }
    const float share = rcp(weights);
#pragma unroll
    for (int k = 0; k < BLUR_ROWS; ++k)
        if (place.top + k < height)
            out[rows[k] + place.column] = totals[k] * share;
}

// Blurs along rows where that is not done across and down at once. So many lanes share the pieces of a world: few of
// them, as most images have nothing to do here.
template <class Mask, class Sigma, class Images>
WARPCAM_DEVICE void blur_rows(const Mask& mask, int width, int height, int lanes, const Sigma& sigma,
                              const Images& source, const Images& target, int index)
{
    const int world = index / lanes;
    if (!mask.data[world])
        return;
    const BlurWeights gaussian = blur_weights(sigma.data[world]);
    if (gaussian.radius <= NEAR_PIXELS)
        return;
    const size_t start = size_t(world) * width * height;
    for (int piece = index - world * lanes; piece < blur_pieces(width, height); piece += lanes)
        blur_rows_of(source.data + start, target.data + start, blur_place(piece, width), width, height, gaussian);
}

// Means down a column of blurred rows; a row is read once for all numbers of the thread.
WARPCAM_DEVICE void blur_column(const float* rows, BlurPlace place, int width, int height, BlurWeights gaussian,
                                float (&means)[BLUR_ROWS])
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    float before[BLUR_ROWS], after[BLUR_ROWS];
#pragma unroll
    for (int k = 0; k < BLUR_ROWS; ++k)
        means[k] = before[k] = after[k] = rows[min(place.top + k, height - 1) * width + place.column];
    float ratio = gaussian.ratio, weight = 1.0f, weights = 1.0f;
    const float growth = ratio * ratio;
    for (int distance = 1; distance <= gaussian.radius; ++distance) {
        weight *= ratio;
        ratio *= growth;
#pragma unroll
        for (int k = 0; k < BLUR_ROWS - 1; ++k) {
            before[BLUR_ROWS - 1 - k] = before[BLUR_ROWS - 2 - k];
            after[k] = after[k + 1];
        }
        before[0] = rows[max(place.top - distance, 0) * width + place.column];
        after[BLUR_ROWS - 1] = rows[min(place.top + BLUR_ROWS - 1 + distance, height - 1) * width + place.column];
#pragma unroll
        for (int k = 0; k < BLUR_ROWS; ++k)
            means[k] += weight * (before[k] + after[k]);
        weights += 2.0f * weight;
    }
    const float share = rcp(weights);
#pragma unroll
    for (int k = 0; k < BLUR_ROWS; ++k)
        means[k] *= share;
}

// Means across and down with a radius of at most NEAR_PIXELS: those along the rows are kept by the thread. INSIDE, no
// pixel is beyond an end of its row, and a row's numbers are at fixed distances from one address.
template <bool INSIDE> WARPCAM_DEVICE void blur_nearby(const float* image, BlurPlace place, int width, int height,
                                                       BlurWeights gaussian, float (&means)[BLUR_ROWS])
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    // Pixels beyond the radius have no weight; the middle stands for them.
    float weights[NEAR_PIXELS], ratio = gaussian.ratio, weight = 1.0f, sum = 1.0f;
    const float growth = ratio * ratio;
    int before[NEAR_PIXELS], after[NEAR_PIXELS];
#pragma unroll
    for (int k = 0; k < NEAR_PIXELS; ++k) {
        weight *= ratio;
        ratio *= growth;
        weights[k] = k < gaussian.radius ? weight : 0.0f;
        sum += 2.0f * weights[k];
        const int distance = 3 * (k + 1);
        before[k] = INSIDE ? -distance : max(-distance, place.first - place.column);
        after[k] = INSIDE ? distance : min(distance, place.last - place.column);
    }
    constexpr int ROWS = BLUR_ROWS + 2 * NEAR_PIXELS;
    const float* numbers = keep_address(image + place.column);
    float across[ROWS];
#pragma unroll
    for (int row = 0; row < ROWS; ++row) {
        const float* middle = numbers + max(min(place.top + row - NEAR_PIXELS, height - 1), 0) * width;
        float total = middle[0];
#pragma unroll
        for (int k = 0; k < NEAR_PIXELS; ++k)
            total += weights[k] * (middle[before[k]] + middle[after[k]]);
        across[row] = total;
    }
    const float share = rcp(sum * sum);
#pragma unroll
    for (int row = 0; row < BLUR_ROWS; ++row) {
        const int middle = row + NEAR_PIXELS;
        float total = across[middle];
#pragma unroll
        for (int k = 0; k < NEAR_PIXELS; ++k)
            total += weights[k] * (across[middle - 1 - k] + across[middle + 1 + k]);
        means[row] = share * total;
    }
}

// Means of an image whose rows blur_rows blurred where that is not done at once.
WARPCAM_DEVICE void blur_numbers(const float* image, const float* rows, BlurPlace place, int width, int height,
                                 float sigma, float (&means)[BLUR_ROWS])
{
    const BlurWeights gaussian = blur_weights(sigma);
    const int reach = 3 * NEAR_PIXELS;
    bool is_inside = place.column >= reach && place.column < width - reach;
#if defined(__CUDA_ARCH__)
    is_inside = __all_sync(__activemask(), is_inside);  // a warp goes one way
#endif
    if (gaussian.radius > NEAR_PIXELS)
        blur_column(rows, place, width, height, gaussian, means);
    else if (is_inside)
        blur_nearby<true>(image, place, width, height, gaussian, means);
    else
        blur_nearby<false>(image, place, width, height, gaussian, means);
}

// Blurs an image; of those that blur_rows wrote, the columns.
template <class Mask, class Sigma, class Images, class Target>
WARPCAM_DEVICE void blur_image(const Mask& mask, int width, int height, const Sigma& sigma, const Images& source,
                               const Images& rows, const Target& target, int index)
{
    const int pieces = blur_pieces(width, height), world = unsigned(index) / unsigned(pieces);
    if (!mask.data[world])
        return;
    const BlurPlace place = blur_place(index - world * pieces, width);
    const size_t start = size_t(world) * width * height;
    float means[BLUR_ROWS];
    blur_numbers(source.data + start, rows.data + start, place, width, height, sigma.data[world], means);
    set_place(target, world, place, width, height, means);
}

// Adds an amount of what blur_image would take from an image.
template <class Mask, class Numbers, class Images, class Target>
WARPCAM_DEVICE void sharpen_image(const Mask& mask, int width, int height, const Numbers& amount, const Numbers& sigma,
                                  const Images& source, const Images& rows, const Target& target, int index)
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    const int pieces = blur_pieces(width, height), world = unsigned(index) / unsigned(pieces);
    if (!mask.data[world])
        return;
    const BlurPlace place = blur_place(index - world * pieces, width);
    const size_t start = size_t(world) * width * height;
    const float gain = amount.data[world];
    float values[BLUR_ROWS];
    blur_numbers(source.data + start, rows.data + start, place, width, height, sigma.data[world], values);
    const float* numbers = keep_address(source.data + start + place.column);
#pragma unroll
    for (int k = 0; k < BLUR_ROWS; ++k) {
        const float middle = numbers[min(place.top + k, height - 1) * width];
        values[k] = middle + gain * (middle - values[k]);
    }
    set_place(target, world, place, width, height, values);
}

}  // namespace warpcam
