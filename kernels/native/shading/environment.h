// Light from all around: a dome's, in spherical harmonics of order 2, and its image where it is mirrored.
#pragma once
#include "core/srgb.h"
#include "texture/sampler.h"

namespace warpcam {

constexpr int SKY_TERMS = 9;

// Radiance is the sum of the terms times 1, x, y, z, xy, yz, 3z^2 - 1, xz, x^2 - y^2 of the direction, in the world.
struct Sky {
    Vec terms[SKY_TERMS];
    Vec gain;    // of the sky's image, to its radiance
    int uneven;  // 1: there is more than the first term
};

// The sky through a lobe, whose width takes its part of the terms of first and second order.
WARPCAM_FN Vec sky_through(const Sky& sky, Vec d, float first, float second)
{
    Vec light = sky.terms[0];
    if (sky.uneven) {
        light = light + first * (d.x * sky.terms[1] + d.y * sky.terms[2] + d.z * sky.terms[3]);
        light = light + second * (d.x * d.y * sky.terms[4] + d.y * d.z * sky.terms[5]
                                  + (3.0f * d.z * d.z - 1.0f) * sky.terms[6] + d.x * d.z * sky.terms[7]
                                  + (d.x * d.x - d.y * d.y) * sky.terms[8]);
    }
    return { upper(light.x, 0.0f), upper(light.y, 0.0f), upper(light.z, 0.0f) };
}

// What a matt white surface shows: the clamped cosine takes 2/3 and 1/4 (Ramamoorthi and Hanrahan 2001).
WARPCAM_FN Vec sky_on(const Sky& sky, Vec normal) { return sky_through(sky, normal, 2.0f / 3.0f, 0.25f); }

// What a surface mirrors: from the terms where it is rough, from the image, if there is one, where it is smooth.
template <bool IMAGE, class Textures, class Background>
WARPCAM_FN Vec sky_along(const Sky& sky, const Textures& textures, const Background& background, Vec direction,
                         float roughness)
{
    const float alpha = roughness * roughness, blur = saturated(2.0f * alpha);
    const Vec wide = sky_through(sky, direction, 1.0f - alpha / 3.0f, 1.0f - 0.75f * alpha);
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        if (blur < 1.0f && image.levels > 0) {
            const Vec d { direction.x, direction.z, -direction.y };  // a skybox lies on its side
            const Vec aside =
                normalized(cross(d, magnitude(d.x) < 0.6f ? Vec { 1.0f, 0.0f, 0.0f } : Vec { 0.0f, 1.0f, 0.0f }));
            const Vec right = 1.5f * alpha * aside, down = 1.5f * alpha * cross(d, aside);
            const Vec sharp = times(sky.gain, decoded(sample_cube(textures.texels.data, image, d, right, down)));
            return sharp + blur * (wide - sharp);
        }
    }
    return wide;
}

}  // namespace warpcam
