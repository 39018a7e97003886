// From light to what a display shows: tone mapping curves, then sRGB. Each has Rec. 709 light in and out.
#pragma once
#include "core/srgb.h"

namespace warpcam {

// The curve of an image; none of them: light is cut off at white. Values of flags.py.
enum ToneFlag { REINHARD = 1 << 25, ACES = 1 << 26, KHRONOS_NEUTRAL = 1 << 27, AGX = 1 << 28 };
constexpr int TONE_FLAGS = REINHARD | ACES | KHRONOS_NEUTRAL | AGX;

constexpr float BRIGHTEST = 65504.0f;  // light beyond it is as bright: curves stay finite

// The product with a matrix of these columns.
template <class Vector> WARPCAM_DEVICE Vector sum_of_columns(Vector v, Vec3 x, Vec3 y, Vec3 z)
{
    return v.x * broadcast<Vector>(x) + v.y * broadcast<Vector>(y) + v.z * broadcast<Vector>(z);
}

template <class Vector, class Curve> WARPCAM_DEVICE Vector each_channel(Vector v, const Curve& curve)
{
    return { curve(v.x), curve(v.y), curve(v.z) };
}

// Reinhard et al., Photographic Tone Reproduction for Digital Images (2002), equation 3, for each channel.
template <class Vector> WARPCAM_DEVICE Vector reinhard(Vector light)
{
    return each_channel(light, [](auto value) { return value / (1.0f + value); });
}

// Stephen Hill's fit of ACES' reference rendering and sRGB output transforms, with their desaturation (BakingLab,
// ACES.hlsl).
template <class Vector> WARPCAM_DEVICE Vector aces(Vector light)
{
    const Vector seen = sum_of_columns(light, { 0.59719f, 0.07600f, 0.02840f }, { 0.35458f, 0.90834f, 0.13383f },
                                       { 0.04823f, 0.01566f, 0.83777f });
    const Vector fitted = each_channel(seen, [](auto value) {
        return (value * (value + 0.0245786f) - 0.000090537f) / (value * (0.983729f * value + 0.4329510f) + 0.238081f);
    });
    return sum_of_columns(fitted, { 1.60475f, -0.10208f, -0.00327f }, { -0.53108f, 1.10813f, -0.07276f },
                          { -0.07367f, -0.00605f, 1.07602f });
}

// Khronos PBR Neutral (KhronosGroup/ToneMapping, PBR_Neutral). Where nothing is brighter than START, `squeezed` is the
// peak itself.
template <class Vector> WARPCAM_DEVICE Vector khronos_neutral(Vector light)
{
    using Number = NumberOf<Vector>;
    constexpr float REFLECTED = 0.04f, START = 0.8f - REFLECTED, DESATURATION = 0.15f, ROOM = 1.0f - START;
    const Number least = min(light.x, min(light.y, light.z)), usual = REFLECTED, start = START;
    const Number offset = least < 2.0f * REFLECTED ? least - 6.25f * least * least : usual;
    const Vector base { light.x - offset, light.y - offset, light.z - offset };
    const Number peak = max(max(base.x, max(base.y, base.z)), start);
    const Number squeezed = 1.0f - ROOM * ROOM / (peak + (ROOM - START));
    const Number white = 1.0f - 1.0f / (DESATURATION * (peak - squeezed) + 1.0f);
    const Number kept = (1.0f - white) * squeezed / peak, added = white * squeezed;
    return { kept * base.x + added, kept * base.y + added, kept * base.z + added };
}

// Troy Sobotka's AgX, in Rec. 2020 as Blender has it: matrices as three.js has them, the curve by Benjamin Wrensch's
// polynomial of sixth degree.
template <class Vector> WARPCAM_DEVICE Vector agx(Vector light)
{
    const Vector wide = sum_of_columns(light, { 0.6274f, 0.0691f, 0.0164f }, { 0.3293f, 0.9195f, 0.0880f },
                                       { 0.0433f, 0.0113f, 0.8956f });
    const Vector inset = sum_of_columns(wide, { 0.856627153315983f, 0.137318972929847f, 0.11189821299995f },
                                        { 0.0951212405381588f, 0.761241990602591f, 0.0767994186031903f },
                                        { 0.0482516061458583f, 0.101439036467562f, 0.811302368396859f });
    const Vector curved = each_channel(inset, [](auto value) {
        constexpr float DARKEST = -12.47393f, BRIGHT = 4.026069f;  // 10 stops below and 6.5 above grey of 0.18
        const decltype(value) least = 1.0e-10f;
        const auto x = saturate((log2(max(value, least)) - DARKEST) * (1.0f / (BRIGHT - DARKEST)));
        return -0.00232f + x * (0.1191f + x * (0.4298f + x * (-6.868f + x * (31.96f + x * (-40.14f + x * 15.5f)))));
    });
    const Vector outset = sum_of_columns(curved, { 1.1271005818144368f, -0.1413297634984383f, -0.14132976349843826f },
                                         { -0.11060664309660323f, 1.157823702216272f, -0.11060664309660294f },
                                         { -0.016493938717834573f, -0.016493938717834257f, 1.2519364065950405f });
    const Vector decoded = each_channel(outset, [](auto value) {
        const decltype(value) least = MIN_NORMAL;
        return pow(max(value, least), 2.2f);
    });
    return sum_of_columns(decoded, { 1.6605f, -0.1246f, -0.0182f }, { -0.5876f, 1.1329f, -0.1006f },
                          { -0.0728f, -0.0083f, 1.1187f });
}

// Display colour of light by the curve that FLAGS have.
template <int FLAGS, class Vector> WARPCAM_DEVICE Vector display_color(Vector light)
{
    if constexpr ((FLAGS & TONE_FLAGS) != 0) {
        using Number = NumberOf<Vector>;
        const Number none = 0.0f, most = BRIGHTEST;
        light = each_channel(light, [&](auto value) { return min(max(value, none), most); });
    }
    if constexpr ((FLAGS & REINHARD) != 0)
        light = reinhard(light);
    else if constexpr ((FLAGS & ACES) != 0)
        light = aces(light);
    else if constexpr ((FLAGS & KHRONOS_NEUTRAL) != 0)
        light = khronos_neutral(light);
    else if constexpr ((FLAGS & AGX) != 0)
        light = agx(light);
    return linear_to_srgb(light);
}

}  // namespace warpcam
