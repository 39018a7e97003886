// Reflection of light by a metallic-roughness surface.
//
// The model is appendix B of the glTF 2.0 specification: microfacets of the GGX distribution (Walter et al. 2007), with
// Smith's height-correlated masking (Heitz 2014) and Schlick's Fresnel term (1994), over a matt base that gets what
// they let through. Light from all around is reflected by the split-sum approximation (Karis, "Real Shading in Unreal
// Engine 4", 2013), with what bounces between the facets as Fdez-Aguera adds it ("A Multiple-Scattering Microfacet Model
// for Real-Time Image-based Lighting", 2019): a white surface under an even white sky is just white.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

constexpr float MIN_ROUGHNESS = 0.045f;  // roughness below which highlights would be smaller than floats can tell

// Reflection parameters of a surface point.
template <class Vector> struct Bsdf {
    Vector matt;  // colour of the base: none under metal
    Vector straight;  // reflectance where light falls straight
    NumberOf<Vector> grazing;  // and where it grazes; below 1 only where the former is less than any real surface's
    NumberOf<Vector> roughness, square;  // `square`: of alpha, which is the roughness squared
};

// `reflectance` is that of what is no metal, where light falls straight.
template <class Vector, class Number = NumberOf<Vector>>
WARPCAM_DEVICE Bsdf<Vector> make_bsdf(Vector color, Number roughness, Number metallic, float reflectance)
{
    const Number least = MIN_ROUGHNESS, one = 1.0f;
    roughness = clamp(roughness, least, one);
    metallic = saturate(metallic);
    const Vector dielectric = broadcast<Vector>({ reflectance, reflectance, reflectance });
    const Vector straight = dielectric + metallic * (color - dielectric);
    return { (1.0f - metallic) * color, straight, saturate(17.0f * (straight.x + straight.y + straight.z)), roughness,
             fourth_power(roughness) };
}

// The share of microfacets that face `half`, a unit vector: D. The square of a sine from the cross product keeps its
// digits where highlights are small.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> ggx_ndf(Vector normal, Vector half, NumberOf<Vector> square)
{
    const auto along = dot(normal, half);
    const Vector aside = cross(normal, half);
    const auto sum = along * along * square + dot(aside, aside);
    return along > 0.0f ? square / (PI * sum * sum) : 0.0f;
}

// Smith visibility V: the part of the microfacets that is neither masked nor in shadow, over 4 (n.l) (n.v).
template <class Number> WARPCAM_DEVICE Number smith_visibility(Number to_light, Number to_eye, Number square)
{
    const Number masked = to_light * sqrt(to_eye * to_eye * (1.0f - square) + square);
    const Number shadowed = to_eye * sqrt(to_light * to_light * (1.0f - square) + square);
    return 0.5f / max(masked + shadowed, 1.0e-7f);
}

template <class Vector> WARPCAM_DEVICE Vector fresnel(const Bsdf<Vector>& bsdf, NumberOf<Vector> cosine)
{
    const NumberOf<Vector> rest = 1.0f - saturate(cosine), rest2 = rest * rest, rest5 = rest2 * rest2 * rest;
    return bsdf.straight + rest5 * (Vector { bsdf.grazing, bsdf.grazing, bsdf.grazing } - bsdf.straight);
}

// Light reflected to the eye from one direction, times pi: by the base, without the cosine to the light, and by the
// microfacets, with it. `sine_squared` is the squared sine of half the angle under which the light is seen. Halved, as
// microfacets halve angles, it widens their distribution, so that a light's mirror image is as bright as the light.
template <class Vector> struct BsdfValue {
    Vector matt, gloss;
};

template <class Vector, class Number = NumberOf<Vector>>
WARPCAM_DEVICE BsdfValue<Vector> reflection_of(const Bsdf<Vector>& bsdf, Vector normal, Vector to_light, Vector to_eye,
                                               Number eye_cosine, Number sine_squared)
{
    const Vector half = normalized(to_light + to_eye);
    const Number light_cosine = saturate(dot(normal, to_light));
    const Vector mirrored = fresnel(bsdf, dot(to_eye, half));
    const Number wide = min(bsdf.square + 0.25f * sine_squared, 1.0f);
    const Number gloss =
        PI * light_cosine * ggx_ndf(normal, half, wide) * smith_visibility(light_cosine, eye_cosine, bsdf.square);
    return { mul(bsdf.matt, broadcast<Vector>({ 1.0f, 1.0f, 1.0f }) - mirrored), gloss * mirrored };
}

// Light that leaves the facets only after more bounces, which `lost` of it does.
WARPCAM_DEVICE Vec3 multiple_scattering(float lost, Vec3 single, Vec3 mean)
{
    return lost
           * mul(mul(single, mean),
                 { 1.0f / (1.0f - lost * mean.x), 1.0f / (1.0f - lost * mean.y), 1.0f / (1.0f - lost * mean.z) });
}

// Share of light from everywhere that facets reflect at once: `scale` times the reflectance at normal incidence plus
// `offset` times that at grazing incidence. Ratios of polynomials, by least squares from the table of
// build/facet_albedo.py, from which they differ by 0.05 and 0.02 at most and by 0.01 and 0.002 in the mean square.
template <class Number> WARPCAM_DEVICE void facet_albedo(Number eye_cosine, Number r, Number& scale, Number& offset)
{
    const Number s = sqrt(eye_cosine), one = 1.0f, none = 0.0f;
    const Number scale_above =
        -0.1419f + r * (1.7198f + r * (3.7164f - 1.3953f * r))
        + s * (1.0952f + r * (-8.5217f + 0.1744f * r) + s * (1.7158f + 2.6708f * r - 0.6562f * s));
    const Number scale_below = 1.0f + r * (0.0817f + 3.0964f * r) + s * (-1.1697f - 4.0271f * r + 2.1943f * s);
    const Number offset_above =
        1.035f + r * (-0.8866f + r * (0.3014f - 0.0598f * r))
        + s * (-2.6438f + r * (1.6844f - 0.2509f * r) + s * (2.1256f - 0.8008f * r - 0.5176f * s));
    const Number offset_below = 1.0f + r * (1.1164f + 6.0958f * r) + s * (-2.4181f - 7.0514f * r + 4.2393f * s);
    scale = clamp(scale_above / scale_below, none, one);
    offset = clamp(offset_above / offset_below, none, one - scale);
}

// The direction about which a lobe sees most of what is around: from the mirror direction to the normal as facets get
// rougher (Lagarde and de Rousiers, "Moving Frostbite to Physically Based Rendering", 2014, section 4.9.3).
template <class Vector> WARPCAM_DEVICE Vector lobe_direction(Vector normal, Vector mirror, NumberOf<Vector> roughness)
{
    const auto alpha = roughness * roughness, smooth = 1.0f - alpha;
    return normalized(normal + (smooth * (sqrt(smooth) + alpha)) * (mirror - normal));
}

// Light reflected to the eye from everywhere: of the mean irradiance, `even`, and of the radiance from about the mirror
// direction, `mirrored`.
template <class Vector> WARPCAM_DEVICE Vector environment_brdf(const Bsdf<Vector>& bsdf, NumberOf<Vector> eye_cosine,
                                                               Vector even, Vector mirrored)
{
    using Number = NumberOf<Vector>;
    Number scale, offset;
    facet_albedo(eye_cosine, bsdf.roughness, scale, offset);
    const Number lost = max(1.0f - scale - offset, 0.0f);  // by facets that light leaves only after more bounces
    const Number edge = offset * bsdf.grazing, part = 1.0f / 21.0f;
    const Vector one = broadcast<Vector>({ 1.0f, 1.0f, 1.0f }),
                 single = scale * bsdf.straight + Vector { edge, edge, edge };
    const Vector mean = bsdf.straight + part * (one - bsdf.straight), again = multiple_scattering(lost, single, mean);
    return mul(single, mirrored) + mul(again + mul(bsdf.matt, one - single - again), even);
}

}  // namespace warpcam
