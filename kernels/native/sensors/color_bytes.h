// Bytes of colours, and numbers or bytes that effects write: ColorTarget of warpcam/sensors/kernels/color_images.py.
#pragma once
#include "core/platform.h"

namespace warpcam {

constexpr int NUMBERS_KIND = 0, LIGHT_BYTES_KIND = 1;

// Byte of linear light, cut off at black and white: see encode_byte in warpcam/sensors/kernels/curves.py.
WARPCAM_DEVICE float encoded_byte(const int* bytes_of_light, float light)
{
    const int bits = as_int(min(max(light, 1.0f / 8192.0f), 1.0f));
    return float((bytes_of_light[(bits >> 16) - 0x3900] + (bits & 0xffff)) >> 16);
}

WARPCAM_DEVICE float display_byte(float value) { return min(max(value, 0.0f), 1.0f) * 255.0f + 0.5f; }

// Writes one number of the colours of all worlds, three for a pixel, or its byte.
template <class Target> WARPCAM_DEVICE void set_number(const Target& target, size_t number, float value)
{
    if (target.kind == NUMBERS_KIND) {
        reinterpret_cast<float*>(target.numbers.data)[number] = value;
        return;
    }
    const float byte =
        target.kind == LIGHT_BYTES_KIND ? encoded_byte(target.bytes_of_light.data, value) : display_byte(value);
    if (target.bytes.shape[2] == 4) {
        const size_t pixel = number / 3;
        const int channel = int(number - 3 * pixel);
        number = 4 * pixel + channel;
        if (channel == 2)
            target.bytes.data[number + 1] = target.truth.data[number + 1];
    }
    target.bytes.data[number] = (unsigned char)byte;
}

// Writes numbers that are rows of so many pixels apart, or their bytes: of some pixels' channel from a pixel of all
// worlds on.
template <class Target, int COUNT> WARPCAM_DEVICE void set_column(const Target& target, size_t pixel, int channel,
                                                                  int width, int count, const float (&values)[COUNT])
{
    if (target.kind == NUMBERS_KIND) {
        float* numbers = keep_address(reinterpret_cast<float*>(target.numbers.data) + (3 * pixel + channel));
#pragma unroll
        for (int k = 0; k < COUNT; ++k, numbers += 3 * width)
            if (k < count)
                *numbers = values[k];
        return;
    }
    float shown[COUNT];  // all are looked up before one is written
    if (target.kind == LIGHT_BYTES_KIND) {
#pragma unroll
        for (int k = 0; k < COUNT; ++k)
            shown[k] = encoded_byte(target.bytes_of_light.data, values[k]);
    } else {
#pragma unroll
        for (int k = 0; k < COUNT; ++k)
            shown[k] = display_byte(values[k]);
    }
    const int channels = target.bytes.shape[2], pitch = channels * width;
    unsigned char* bytes = keep_address(target.bytes.data + (channels * pixel + channel));
#pragma unroll
    for (int k = 0; k < COUNT; ++k, bytes += pitch)
        if (k < count)
            *bytes = (unsigned char)shown[k];
    if (channels != 4 || channel != 2)
        return;
    bytes = target.bytes.data + 4 * pixel;
    for (int k = 0; k < min(count, COUNT); ++k)
        bytes[k * pitch + 3] = target.truth.data[4 * pixel + k * pitch + 3];
}

}  // namespace warpcam
