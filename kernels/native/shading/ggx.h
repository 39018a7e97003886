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
constexpr float SMOOTHEST = 0.045f;  // roughness below which highlights would be smaller than floats can tell

// What a place of a surface is to light.
struct Skin {
    Vec matt;      // colour of the base: none under metal
    Vec straight;  // reflectance where light falls straight
    float grazing;  // and where it grazes; below 1 only where the former is less than any real surface's
    float roughness, square;  // `square`: of alpha, which is the roughness squared
};

// `reflectance` is that of what is no metal, where light falls straight.
WARPCAM_FN Skin skin_of(Vec color, float roughness, float metallic, float reflectance)
{
    roughness = between(roughness, SMOOTHEST, 1.0f);
    metallic = saturated(metallic);
    const Vec dielectric { reflectance, reflectance, reflectance };
    const Vec straight = dielectric + metallic * (color - dielectric);
    return { (1.0f - metallic) * color, straight, saturated(17.0f * (straight.x + straight.y + straight.z)), roughness,
             roughness * roughness * roughness * roughness };
}

// The share of microfacets that face `half`, a unit vector: D. The square of a sine from the cross product keeps its
// digits where highlights are small.
WARPCAM_FN float facing_facets(Vec normal, Vec half, float square)
{
    const float along = dot(normal, half);
    const Vec aside = cross(normal, half);
    const float sum = along * along * square + dot(aside, aside);
    return along > 0.0f ? square / (PI * sum * sum) : 0.0f;
}

// How much of the facets is neither masked nor in shadow, over 4 (n.l) (n.v): V.
WARPCAM_FN float open_facets(float to_light, float to_eye, float square)
{
    const float masked = to_light * root(to_eye * to_eye * (1.0f - square) + square);
    const float shadowed = to_eye * root(to_light * to_light * (1.0f - square) + square);
    return 0.5f / upper(masked + shadowed, 1.0e-7f);
}

WARPCAM_FN Vec fresnel(const Skin& skin, float cosine)
{
    const float rest = 1.0f - saturated(cosine), rest2 = rest * rest, rest5 = rest2 * rest2 * rest;
    return skin.straight + rest5 * (Vec { skin.grazing, skin.grazing, skin.grazing } - skin.straight);
}

// What a surface sends to the eye of light from one direction, times pi: of its base, without the cosine to the light,
// and of its facets, with it. `spread` is the squared sine of the angle that the light is seen under from its middle to
// its edge. Halved, as facets halve angles, it widens their distribution: seen in a mirror a light is as bright as it
// is.
struct Reflection {
    Vec matt, gloss;
};

WARPCAM_FN Reflection reflection_of(const Skin& skin, Vec normal, Vec to_light, Vec to_eye, float eye_cosine,
                                    float spread)
{
    const Vec half = normalized(to_light + to_eye);
    const float light_cosine = saturated(dot(normal, to_light));
    const Vec mirrored = fresnel(skin, dot(to_eye, half));
    const float wide = lower(skin.square + 0.25f * spread, 1.0f);
    const float gloss = PI * light_cosine * facing_facets(normal, half, wide)
        * open_facets(light_cosine, eye_cosine, skin.square);
    return { times(skin.matt, Vec { 1.0f, 1.0f, 1.0f } - mirrored), gloss * mirrored };
}

// What a surface sends to the eye of light from everywhere: of what falls on it on average, `even`, and of what comes
// from about the direction that the eye is mirrored in, `mirrored`.
WARPCAM_FN Vec reflected_around(const Skin& skin, float eye_cosine, Vec even, Vec mirrored)
{
    const float r = skin.roughness, x = 1.0f - r, y = 0.0425f - 0.0275f * r;
    const float fade = lower(x * x, power(2.0f, -9.28f * eye_cosine)) * x + y;
    const float scale = upper(-1.04f * fade + 1.04f - 0.572f * r, 0.0f);
    const float offset = upper(1.04f * fade - 0.04f + 0.022f * r, 0.0f);
    const float lost = upper(1.0f - scale - offset, 0.0f);  // by facets that light leaves only after more bounces
    const Vec one { 1.0f, 1.0f, 1.0f };
    const float edge = offset * skin.grazing;
    const Vec single = scale * skin.straight + Vec { edge, edge, edge };
    const Vec mean = skin.straight + (1.0f / 21.0f) * (one - skin.straight);
    const Vec again = lost * times(times(single, mean), { 1.0f / (1.0f - lost * mean.x), 1.0f / (1.0f - lost * mean.y),
                                                          1.0f / (1.0f - lost * mean.z) });
    return times(single, mirrored) + times(again + times(skin.matt, one - single - again), even);
}

}  // namespace warpcam
