// Display colours and linear light: the sRGB transfer function (IEC 61966-2-1).
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

template <class Number> WARPCAM_FN Number decoded(Number value)
{
    return value <= 0.04045f ? value * (1.0f / 12.92f) : power((value + 0.055f) * (1.0f / 1.055f), 2.4f);
}

// What is brighter than white is more than 1.
template <class Number> WARPCAM_FN Number encoded_beyond(Number light)
{
    return light <= 0.0031308f ? 12.92f * light : 1.055f * power(light, 1.0f / 2.4f) - 0.055f;
}

// Cuts off what a display cannot show.
template <class Number> WARPCAM_FN Number encoded(Number light) { return encoded_beyond(saturated(light)); }

WARPCAM_FN Vec decoded(Vec color) { return { decoded(color.x), decoded(color.y), decoded(color.z) }; }
WARPCAM_FN Vec encoded_beyond(Vec light)
{
    return { encoded_beyond(light.x), encoded_beyond(light.y), encoded_beyond(light.z) };
}
WARPCAM_FN Vec encoded(Vec light) { return { encoded(light.x), encoded(light.y), encoded(light.z) }; }

}  // namespace warpcam
