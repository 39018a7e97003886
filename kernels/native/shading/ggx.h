// How a metallic-roughness surface reflects light.
//
// The model is appendix B of the glTF 2.0 specification: microfacets of the GGX distribution (Walter et al. 2007), with
// Smith's height-correlated masking (Heitz 2014) and Schlick's Fresnel term (1994), over a matt base that gets what
// they let through. Light from all around is reflected by the split-sum approximation in Karis's analytic form
// ("Physically Based Shading on Mobile", 2014), with what bounces between the facets as Fdez-Aguera adds it ("A
// Multiple-Scattering Microfacet Model for Real-Time Image-based Lighting", 2019): a white surface under an even white
// sky is just white.
#pragma once
#include "core/vec3.h"

namespace warpcam {

constexpr float PI = 3.14159265358979f;
constexpr float MIN_ROUGHNESS = 0.045f;  // roughness below which highlights would be smaller than floats can tell

// What a place of a surface is to light.
struct Bsdf {
    Vec3 matt;      // colour of the base: none under metal
    Vec3 straight;  // reflectance where light falls straight
    float grazing;  // and where it grazes; below 1 only where the former is less than any real surface's
    float roughness, square;  // `square`: of alpha, which is the roughness squared
};

// `reflectance` is that of what is no metal, where light falls straight.
WARPCAM_DEVICE Bsdf make_bsdf(Vec3 color, float roughness, float metallic, float reflectance)
{
    roughness = clamp(roughness, MIN_ROUGHNESS, 1.0f);
    metallic = saturate(metallic);
    const Vec3 dielectric { reflectance, reflectance, reflectance };
    const Vec3 straight = dielectric + metallic * (color - dielectric);
    return { (1.0f - metallic) * color, straight, saturate(17.0f * (straight.x + straight.y + straight.z)), roughness,
             roughness * roughness * roughness * roughness };
}

// The share of microfacets that face `half`, a unit vector: D. The square of a sine from the cross product keeps its
// digits where highlights are small.
WARPCAM_DEVICE float ggx_ndf(Vec3 normal, Vec3 half, float square)
{
    const float along = dot(normal, half);
    const Vec3 aside = cross(normal, half);
    const float sum = along * along * square + dot(aside, aside);
    return along > 0.0f ? square / (PI * sum * sum) : 0.0f;
}

// How much of the facets is neither masked nor in shadow, over 4 (n.l) (n.v): V.
WARPCAM_DEVICE float smith_visibility(float to_light, float to_eye, float square)
{
    const float masked = to_light * sqrt(to_eye * to_eye * (1.0f - square) + square);
    const float shadowed = to_eye * sqrt(to_light * to_light * (1.0f - square) + square);
    return 0.5f / max(masked + shadowed, 1.0e-7f);
}

WARPCAM_DEVICE Vec3 fresnel(const Bsdf& skin, float cosine)
{
    const float rest = 1.0f - saturate(cosine), rest2 = rest * rest, rest5 = rest2 * rest2 * rest;
    return skin.straight + rest5 * (Vec3 { skin.grazing, skin.grazing, skin.grazing } - skin.straight);
}

// What a surface sends to the eye of light from one direction, times pi: of its base, without the cosine to the light,
// and of its facets, with it. `spread` is the squared sine of the angle that the light is seen under from its middle to
// its edge. Halved, as facets halve angles, it widens their distribution: seen in a mirror a light is as bright as it
// is.
struct BsdfValue {
    Vec3 matt, gloss;
};

WARPCAM_DEVICE BsdfValue reflection_of(const Bsdf& skin, Vec3 normal, Vec3 to_light, Vec3 to_eye, float eye_cosine,
                                    float spread)
{
    const Vec3 half = normalized(to_light + to_eye);
    const float light_cosine = saturate(dot(normal, to_light));
    const Vec3 mirrored = fresnel(skin, dot(to_eye, half));
    const float wide = min(skin.square + 0.25f * spread, 1.0f);
    const float gloss = PI * light_cosine * ggx_ndf(normal, half, wide)
        * smith_visibility(light_cosine, eye_cosine, skin.square);
    return { mul(skin.matt, Vec3 { 1.0f, 1.0f, 1.0f } - mirrored), gloss * mirrored };
}

// What a surface sends to the eye of light from everywhere: of what falls on it on average, `even`, and of what comes
// from about the direction that the eye is mirrored in, `mirrored`.
WARPCAM_DEVICE Vec3 environment_brdf(const Bsdf& skin, float eye_cosine, Vec3 even, Vec3 mirrored)
{
    const float r = skin.roughness, x = 1.0f - r, y = 0.0425f - 0.0275f * r;
    const float fade = min(x * x, pow(2.0f, -9.28f * eye_cosine)) * x + y;
    const float scale = max(-1.04f * fade + 1.04f - 0.572f * r, 0.0f);
    const float offset = max(1.04f * fade - 0.04f + 0.022f * r, 0.0f);
    const float lost = max(1.0f - scale - offset, 0.0f);  // by facets that light leaves only after more bounces
    const Vec3 one { 1.0f, 1.0f, 1.0f };
    const float edge = offset * skin.grazing;
    const Vec3 single = scale * skin.straight + Vec3 { edge, edge, edge };
    const Vec3 mean = skin.straight + (1.0f / 21.0f) * (one - skin.straight);
    const Vec3 again = lost * mul(mul(single, mean), { 1.0f / (1.0f - lost * mean.x), 1.0f / (1.0f - lost * mean.y),
                                                          1.0f / (1.0f - lost * mean.z) });
    return mul(single, mirrored) + mul(again + mul(skin.matt, one - single - again), even);
}

}  // namespace warpcam
