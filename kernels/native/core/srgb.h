// Display colours and linear light: the sRGB transfer function (IEC 61966-2-1).
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

template <class Number> WARPCAM_DEVICE Number srgb_to_linear(Number value)
{
    return value <= 0.04045f ? value * (1.0f / 12.92f) : pow((value + 0.055f) * (1.0f / 1.055f), 2.4f);
}

// sRGB encoding without an upper bound: light brighter than white is more than 1.
template <class Number> WARPCAM_DEVICE Number encoded_beyond(Number light)
{
    return light <= 0.0031308f ? 12.92f * light : 1.055f * pow(light, 1.0f / 2.4f) - 0.055f;
}

// Cuts off what a display cannot show.
template <class Number> WARPCAM_DEVICE Number linear_to_srgb(Number light) { return encoded_beyond(saturate(light)); }

WARPCAM_DEVICE Vec3 srgb_to_linear(Vec3 color)
{
    return { srgb_to_linear(color.x), srgb_to_linear(color.y), srgb_to_linear(color.z) };
}
WARPCAM_DEVICE Vec3 encoded_beyond(Vec3 light)
{
    return { encoded_beyond(light.x), encoded_beyond(light.y), encoded_beyond(light.z) };
}
WARPCAM_DEVICE Vec3 linear_to_srgb(Vec3 light)
{
    return { linear_to_srgb(light.x), linear_to_srgb(light.y), linear_to_srgb(light.z) };
}

}  // namespace warpcam
