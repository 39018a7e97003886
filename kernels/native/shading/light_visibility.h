// How much of the light of each light, and of that from all around, reaches a place of a physically based scene.
#pragma once
#include "core/conditional.h"
#include "shading/appearance.h"

namespace warpcam {

// Values of flags.py. SOFT_SHADOWS: there is a share for each light; AMBIENT_OCCLUSION: one for light from all around;
// INDIRECT_LIGHT: light from shapes, and the share of light from beyond them.
enum VisibilityFlag { INDIRECT_LIGHT = 1 << 16, SOFT_SHADOWS = 1 << 18, AMBIENT_OCCLUSION = 1 << 19 };
constexpr int SHARE_FLAGS = SOFT_SHADOWS | AMBIENT_OCCLUSION;
constexpr int VISIBILITY_FLAGS = HAS_SHADOWS | SHARE_FLAGS | INDIRECT_LIGHT;

// Of light from all around a pixel has its open share, and how its hidden share rises along the world's axes.
constexpr int AMBIENT_SHARES = 4;
// A rise of 0 has this share, of 127 before the filter and of 255 after it, and one of 1 so many more.
constexpr int LEVEL_BEFORE = 64, LEVEL = 129;
constexpr float RISE_BEFORE = 63.0f, RISE = 126.5f;

// Shares of pixels as occlusion/occlusion_filter.h writes them, of 255: AMBIENT_SHARES if light from all around has some,
// then one of each light that is kept.
template <class Vector> struct PixelShares {
    static constexpr int PIXELS = sizeof(NumberOf<Vector>) / sizeof(float);
    const unsigned char* bytes[PIXELS];

    WARPCAM_DEVICE NumberOf<Vector> at(int channel) const
    {
        NumberOf<Vector> share;
        if constexpr (PIXELS == 1)
            share = float(bytes[0][channel]);
        else
            for (int k = 0; k < PIXELS; ++k)
                share[k] = float(bytes[k][channel]);
        return (1.0f / 255.0f) * share;
    }
};

// Light from shapes that arrives at pixels, as occlusion/indirect_filter.h writes it.
template <class Vector> struct PixelLight {
    static constexpr int PIXELS = sizeof(NumberOf<Vector>) / sizeof(float);
    const float* rows[PIXELS];

    WARPCAM_DEVICE NumberOf<Vector> at(int channel) const
    {
        NumberOf<Vector> value;
        if constexpr (PIXELS == 1)
            value = rows[0][channel];
        else
            for (int k = 0; k < PIXELS; ++k)
                value[k] = rows[k][channel];
        return value;
    }
    WARPCAM_DEVICE Vector mean() const { return { at(0), at(1), at(2) }; }  // of the hemisphere, by cosine
    WARPCAM_DEVICE NumberOf<Vector> open() const { return at(3); }  // share of it where no shape is
};

// What of a light's reaches a place.
template <class Vector> struct ReachedAll {
    static constexpr bool some = true;
    WARPCAM_DEVICE NumberOf<Vector> of(NumberOf<Vector> light) const { return light; }
};
template <class Vector> struct ReachedOrNot {
    MaskOf<Vector> some;
    WARPCAM_DEVICE NumberOf<Vector> of(NumberOf<Vector> light) const
    {
        const NumberOf<Vector> none = 0.0f;
        return some ? light : none;
    }
};
template <class Vector> struct ReachedShare {
    MaskOf<Vector> some;
    NumberOf<Vector> share;
    WARPCAM_DEVICE NumberOf<Vector> of(NumberOf<Vector> light) const { return share * light; }
};

// `shadow`: bit l says that light l, of those that are kept, does not reach it.
template <int FLAGS, class Vector> struct Visibility {
    optional_t<(FLAGS & HAS_SHADOWS) != 0, IntOf<Vector>> shadow;
    optional_t<(FLAGS & SHARE_FLAGS) != 0, PixelShares<Vector>> shares;
    optional_t<(FLAGS & INDIRECT_LIGHT) != 0, PixelLight<Vector>> indirect;

    // `bit`: the light's own, of AreaLight; 0 for a light that nothing hides.
    WARPCAM_DEVICE auto reached(int bit) const
    {
        if constexpr ((FLAGS & SOFT_SHADOWS) != 0) {
            constexpr int FIRST = FLAGS & AMBIENT_OCCLUSION ? AMBIENT_SHARES : 0;
            NumberOf<Vector> share = 1.0f;
            if (bit != 0)
                share = shares.at(FIRST + ctz(unsigned(bit)));
            return ReachedShare<Vector> { share > 0.0f, share };
        } else if constexpr ((FLAGS & HAS_SHADOWS) != 0) {
            return ReachedOrNot<Vector> { (bit & shadow) == 0 };
        } else {
            return ReachedAll<Vector> {};
        }
    }

    // Of the light from all around.
    WARPCAM_DEVICE NumberOf<Vector> open() const { return shares.at(0); }
    WARPCAM_DEVICE Vector rise() const
    {
        const auto along = [&](int axis) { return (1.0f / RISE) * (255.0f * shares.at(1 + axis) - float(LEVEL)); };
        return { along(0), along(1), along(2) };
    }
};

// That of one pixel.
template <int FLAGS, class Frame>
WARPCAM_DEVICE Visibility<FLAGS, Vec3> visibility_of(const Frame& frame, size_t pixel, int shadow)
{
    Visibility<FLAGS, Vec3> found {};
    if constexpr ((FLAGS & HAS_SHADOWS) != 0)
        found.shadow = shadow;
    if constexpr ((FLAGS & SHARE_FLAGS) != 0)
        found.shares.bytes[0] = reinterpret_cast<const unsigned char*>(frame.visible.data + pixel);
    if constexpr ((FLAGS & INDIRECT_LIGHT) != 0)
        found.indirect.rows[0] = reinterpret_cast<const float*>(frame.indirect.data + pixel);
    return found;
}

// The open share with light that goes from surface to surface before it arrives: a fit of Jimenez et al., "Practical
// Realtime Strategies for Accurate Indirect Occlusion", 2016, equation 11. `albedo`: of the place, and of what is around.
template <class Number> WARPCAM_DEVICE Number open_with_bounces(Number open, Number albedo)
{
    const Number a = 2.0404f * albedo - 0.3324f, b = 0.6417f - 4.7951f * albedo, rest = 2.7552f * albedo + 0.6903f;
    return min(max(((a * open + b) * open + rest) * open, open), 1.0f);
}
template <class Vector> WARPCAM_DEVICE Vector open_to_color(NumberOf<Vector> open, Vector albedo)
{
    return { open_with_bounces(open, albedo.x), open_with_bounces(open, albedo.y), open_with_bounces(open, albedo.z) };
}

// What is around a surface that mirrors it, where its own colour says nothing of it: neither dark nor white.
constexpr float HIDING_ALBEDO = 0.5f;

// Of the light from all around, what hidden directions send, by the same fit.
template <class Number> WARPCAM_DEVICE Number hidden_radiance(Number open, float albedo)
{
    const Number hidden = max(1.0f - open, 1.0e-3f), around = albedo;
    return (open_with_bounces(open, around) - open) / hidden;
}

// The open share of a lobe about a direction. What is hidden is taken to be linear in the direction, by least squares over
// the cosine-weighted rays of a pixel, as far as they tell it along the surface: first-order visibility (Sloan, Kautz and
// Snyder, "Precomputed Radiance Transfer", 2002). The wider the lobe, the less of the slope it sees; that of a roughness of
// 1 has the mean.
template <class Vector, class Number = NumberOf<Vector>>
WARPCAM_DEVICE Number lobe_opening(Number open, Vector rise, Vector direction, Number roughness)
{
    return saturate(open - (1.0f - roughness * roughness) * dot(rise, direction));
}

// The open share of the directions about the mirror's (Lagarde and de Rousiers, "Moving Frostbite to Physically Based
// Rendering", 2014, section 4.10.2).
template <class Number> WARPCAM_DEVICE Number specular_opening(Number open, Number eye_cosine, Number roughness)
{
    const Number exponent = exp2(-16.0f * roughness - 1.0f);
    return saturate(exp2(exponent * log2(max(eye_cosine + open, 1.0e-6f))) - 1.0f + open);
}

}  // namespace warpcam
