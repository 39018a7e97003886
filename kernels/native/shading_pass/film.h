// From the light of a whole image to what is shown: the light meter of automatic exposure, bloom, and the curve.
#pragma once
#include "output/pixel_store.h"
#include "shading/tone_mapping.h"

namespace warpcam {

constexpr float MOST_STOPS = 127.0f;  // MAX_EXPOSURE of warpcam/core/arrays.py
constexpr float MOST_METERED = 1.0e30f;  // luminance beyond it counts as that

WARPCAM_DEVICE Vec3 three_at(const float* image, size_t at)
{
    return { image[3 * at], image[3 * at + 1], image[3 * at + 2] };
}

// Adds up, in a fixed order, the stops of every `threads`-th pixel of a world that shows light, and counts these.
template <class Mask, class Light, class Sums> WARPCAM_DEVICE void meter_light(const Mask& mask, const Light& light,
                                                                               const Sums& sums, int pixels,
                                                                               int threads, int index)
{
    const int world = index / threads;
    if (!mask.data[world])
        return;
    float stops = 0.0f, count = 0.0f;
    for (int pixel = index - world * threads; pixel < pixels; pixel += threads) {
        const float luminance =
            dot(three_at(light.data, size_t(world) * pixels + pixel), Vec3 { 0.2126f, 0.7152f, 0.0722f });
        if (luminance > 0.0f) {
            stops += wp::log2(min(luminance, MOST_METERED));
            count += 1.0f;
        }
    }
    sums.data[index] = wp::vec2(stops, count);
}

// A place on a line of `size` pixels that is reflected at both ends.
WARPCAM_DEVICE int reflected_place(int place, int size)
{
    const int on = place % (2 * size), within = on < 0 ? on + 2 * size : on;
    return within < size ? within : 2 * size - 1 - within;
}

// The mean around a place on a line of `size` pixels, by weights of those 0, 1, ... `radius` away.
template <class PixelAt>
WARPCAM_DEVICE Vec3 blurred_along(const float* weights, int radius, int place, int size, const PixelAt& pixel_at)
{
    Vec3 sum = weights[0] * pixel_at(place);
    const bool inside = place >= radius && place + radius < size;
    for (int away = 1; away <= radius; ++away) {
        const int before = inside ? place - away : reflected_place(place - away, size);
        const int after = inside ? place + away : reflected_place(place + away, size);
        sum = sum + weights[away] * (pixel_at(before) + pixel_at(after));
    }
    return sum;
}

// Blurs a pixel along its row.
template <class Frame> WARPCAM_DEVICE void scatter_along_rows(const Frame& frame, int index)
{
    const int row = index / frame.width, column = index - row * frame.width;
    if (!frame.mask.data[row / frame.height])
        return;
    const size_t first = size_t(row) * frame.width;
    put_three(reinterpret_cast<float*>(frame.scattered.data), unsigned(index),
              blurred_along(frame.weights.data, frame.radius, column, frame.width,
                            [&](int at) { return three_at(frame.light.data, first + at); }));
}

// Writes a pixel of the images. The alpha of `rgba` is there already, and `hdr` may be the light itself.
template <int FLAGS, class Frame, class Images>
WARPCAM_DEVICE void develop(const Frame& frame, const Images& images, int index)
{
    const int all = index / frame.width, column = index - all * frame.width;
    const int world = all / frame.height, row = all - world * frame.height;
    if (!frame.mask.data[world])
        return;
    Vec3 light = three_at(frame.light.data, index);
    if (frame.scattered.data) {
        const float* const scattered = reinterpret_cast<const float*>(frame.scattered.data);
        const size_t top = size_t(world) * frame.height * frame.width + column;
        const Vec3 around = blurred_along(frame.weights.data, frame.radius, row, frame.height,
                                          [&](int at) { return three_at(scattered, top + size_t(at) * frame.width); });
        light = (1.0f - frame.strength) * light + frame.strength * around;
    }
    const float automatic = frame.automatic.data ? frame.automatic.data[world] : 0.0f;
    const float stops = min(wp::index(frame.exposures, world) + automatic, MOST_STOPS);
    light = pow(2.0f, stops) * mul(as_vec3(wp::index(frame.gains, world)), light);
    if (images.hdr.data)
        put_three(images.hdr.data, unsigned(index), light);
    const unsigned word = to_bytes(display_color<FLAGS>(light));
    for (int channel = 0; channel < 3; ++channel) {
        const auto byte = static_cast<unsigned char>(word >> 8 * channel);
        if (images.rgb.data)
            images.rgb.data[3 * size_t(index) + channel] = byte;
        if (images.rgba.data)
            images.rgba.data[4 * size_t(index) + channel] = byte;
    }
}

}  // namespace warpcam
