// Light from all around: a dome's, in spherical harmonics of order 2, and its image where it is mirrored.
#pragma once
#include "core/srgb.h"
#include "texture/sampler.h"

namespace warpcam {

constexpr int SKY_TERMS = 9;

// Radiance is the sum of the terms times 1, x, y, z, xy, yz, 3z^2 - 1, xz, x^2 - y^2 of the direction, in the world.
struct Sky {
    Vec3 terms[SKY_TERMS];
    Vec3 gain;    // of the sky's image, to its radiance
    int uneven;  // 1: there is more than the first term
    int world;
};

// The sky through a lobe, whose width takes its part of the terms of first and second order.
template <class Vector>
WARPCAM_DEVICE Vector irradiance_sh(const Sky& sky, Vector d, NumberOf<Vector> first, NumberOf<Vector> second)
{
    const auto term = [&](int n) { return broadcast<Vector>(sky.terms[n]); };
    Vector light = term(0);
    if (sky.uneven) {
        light = light + first * (d.x * term(1) + d.y * term(2) + d.z * term(3));
        light = light
                + second
                      * ((d.x * d.y) * term(4) + (d.y * d.z) * term(5) + (3.0f * d.z * d.z - 1.0f) * term(6)
                         + (d.x * d.z) * term(7) + (d.x * d.x - d.y * d.y) * term(8));
    }
    return { max(light.x, 0.0f), max(light.y, 0.0f), max(light.z, 0.0f) };
}

// Diffuse irradiance on a white surface: the clamped cosine takes 2/3 and 1/4 (Ramamoorthi and Hanrahan 2001).
template <class Vector> WARPCAM_DEVICE Vector sky_on(const Sky& sky, Vector normal)
{
    return irradiance_sh<Vector>(sky, normal, 2.0f / 3.0f, 0.25f);
}

// The sky's image around a direction, as far as a step from there reaches.
template <class Textures>
WARPCAM_DEVICE Vec3 sky_image(const Textures& textures, const Image& image, Vec3 direction, Vec3 right, Vec3 down)
{
    return sample_cube(textures.texels.data, image, direction, right, down);
}

// Reflected environment: rough surfaces take the spherical harmonics, smooth ones the image, if there is one.
template <bool IMAGE, class Textures, class Background, class Vector>
WARPCAM_DEVICE Vector sky_along(const Sky& sky, const Textures& textures, const Background& background,
                                Vector direction, NumberOf<Vector> roughness)
{
    using Number = NumberOf<Vector>;
    const Number alpha = roughness * roughness, blur = saturate(2.0f * alpha);
    const Vector wide = irradiance_sh(sky, direction, 1.0f - alpha / 3.0f, 1.0f - 0.75f * alpha);
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        const auto smooth = blur < 1.0f;
        if (any(smooth) && image.levels > 0) {
            const Vector d { direction.x, direction.z, -direction.y };  // a skybox lies on its side
            const Vector across = select(abs(d.x) < 0.6f, broadcast<Vector>({ 1.0f, 0.0f, 0.0f }),
                                         broadcast<Vector>({ 0.0f, 1.0f, 0.0f }));
            const Vector aside = normalized(cross(d, across)), right = 1.5f * alpha * aside,
                         down = 1.5f * alpha * cross(d, aside);
            const Vector sharp =
                mul(broadcast<Vector>(sky.gain), srgb_to_linear(sky_image(textures, image, d, right, down)));
            return select(smooth, sharp + blur * (wide - sharp), wide);
        }
    }
    return wide;
}

}  // namespace warpcam
