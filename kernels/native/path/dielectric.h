// Light at the border of a clear material, as glass: reflected or refracted, at microfacets where it is rough.
//
// Facets are GGX's (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", 2007), drawn as they are seen;
// which way light goes is drawn by Fresnel's equations.
#pragma once
#include "path/random.h"
#include "path/reflection.h"

namespace warpcam {

constexpr float CLEAR = 0.05f;  // roughness below which a border has no facets

// Reflectance at a border; `ratio` is the index of refraction of where the light comes from over that behind. `through`
// is the cosine on the other side, 0 where all is reflected.
WARPCAM_DEVICE float fresnel_exact(float cosine, float ratio, float& through)
{
    const float square = 1.0f - ratio * ratio * (1.0f - cosine * cosine);
    through = wp::sqrt(max(square, 0.0f));
    if (!(square > 0.0f))
        return 1.0f;
    const float across = (ratio * cosine - through) / (ratio * cosine + through);
    const float along = (cosine - ratio * through) / (cosine + ratio * through);
    return 0.5f * (across * across + along * along);
}

// Index of refraction of a material with that reflectance at normal incidence.
WARPCAM_DEVICE float refractive_index(float reflectance)
{
    const float root = wp::sqrt(clamp(reflectance, 0.0f, 0.98f));
    return (1.0f + root) / (1.0f - root);
}

// Where a path goes on at a border.
struct BorderStep {
    Vec3 direction;
    float weight;  // of radiance; 0: nothing comes from there
    bool through;
};

// `index`: of refraction behind the border over that before it; `thin`: the material ends at once, and light goes on
// straight after all that is reflected within.
WARPCAM_DEVICE BorderStep cross_border(Vec3 normal, Vec3 to_eye, float index, float roughness, bool thin, Random4 drawn)
{
    Vec3 facet = normal;
    const float square = fourth_power(roughness);
    if (roughness > CLEAR) {
        const FrameAxes axes(normal);
        facet = axes.world(visible_facet(axes.local(to_eye), wp::sqrt(square), drawn.x, drawn.y));
    }
    const float cosine = max(dot(to_eye, facet), 0.0f), ratio = 1.0f / index;
    float through;
    float reflected = fresnel_exact(cosine, ratio, through);
    if (thin)
        reflected = 2.0f * reflected / (1.0f + reflected);
    BorderStep step { to_eye, 1.0f, !(drawn.z < reflected) };
    if (!step.through)
        step.direction = 2.0f * cosine * facet - to_eye;
    else if (thin)
        step.direction = -to_eye;
    else
        step.direction = normalized((ratio * cosine - through) * facet - ratio * to_eye);
    const float side = dot(step.direction, normal);
    if (step.through ? side >= 0.0f : side <= 0.0f)
        step.weight = 0.0f;
    if (step.through && !thin)
        step.weight *= ratio * ratio;
    if (roughness > CLEAR)
        step.weight *= 2.0f * abs(side) / (abs(side) + wp::sqrt(square + (1.0f - square) * side * side));
    return step;
}

}  // namespace warpcam
