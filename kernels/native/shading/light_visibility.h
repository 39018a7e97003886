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

// Shares of pixels as occlusion/occlusion_filter.h writes them, of 255: of light from all around if it has one, then of
// each light that is kept.
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
            constexpr int FIRST = FLAGS & AMBIENT_OCCLUSION ? 1 : 0;
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
template <class Vector> WARPCAM_DEVICE Vector open_with_bounces(NumberOf<Vector> open, Vector albedo)
{
    using Number = NumberOf<Vector>;
    const auto raised = [&](Number c) {
        const Number a = 2.0404f * c - 0.3324f, b = 0.6417f - 4.7951f * c, rest = 2.7552f * c + 0.6903f;
        return min(max(((a * open + b) * open + rest) * open, open), 1.0f);
    };
    return { raised(albedo.x), raised(albedo.y), raised(albedo.z) };
}

// The open share of the directions about the mirror's (Lagarde and de Rousiers, "Moving Frostbite to Physically Based
// Rendering", 2014, section 4.10.2).
template <class Number> WARPCAM_DEVICE Number specular_opening(Number open, Number eye_cosine, Number roughness)
{
    const Number exponent = exp2(-16.0f * roughness - 1.0f);
    return saturate(exp2(exponent * log2(max(eye_cosine + open, 1.0e-6f))) - 1.0f + open);
}

}  // namespace warpcam
