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

// Writes one number of the colours of all worlds, three for a pixel, or its byte.
template <class Target> WARPCAM_DEVICE void set_number(const Target& target, size_t number, float value)
{
    if (target.kind == NUMBERS_KIND) {
        reinterpret_cast<float*>(target.numbers.data)[number] = value;
        return;
    }
    const float byte = target.kind == LIGHT_BYTES_KIND ? encoded_byte(target.bytes_of_light.data, value)
                                                       : min(max(value, 0.0f), 1.0f) * 255.0f + 0.5f;
    if (target.bytes.shape[2] == 4) {
        const size_t pixel = number / 3;
        const int channel = int(number - 3 * pixel);
        number = 4 * pixel + channel;
        if (channel == 2)
            target.bytes.data[number + 1] = target.truth.data[number + 1];
    }
    target.bytes.data[number] = (unsigned char)byte;
}

}  // namespace warpcam
