// Light from all around, as a path meets it that leaves the scene.
#pragma once
#include "shading/environment.h"

namespace warpcam {

// The sky's image where it has one, else its terms, with the light that is everywhere. `direction`: in the world.
template <bool IMAGE, class Physical, class Textures, class Background>
WARPCAM_DEVICE Vec3 path_sky(const Physical& physical, const Textures& textures, const Background& background,
                             int world, int headlight, Vec3 d)
{
    const auto term = [&](int n) { return as_vec3(per_world(physical.sky, world, n)); };
    const Vec3 even = as_vec3(wp::index(physical.plain.headlight, headlight));
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        const Vec3 gain = term(SKY_TERMS);
        if (image.levels > 0 && dot(gain, gain) > 0.0f) {
            const Vec3 none { 0.0f, 0.0f, 0.0f };
            return even + mul(gain, srgb_to_linear(sky_image(textures, image, { d.x, d.z, -d.y }, none, none)));
        }
    }
    const Vec3 sum = even + term(0) + d.x * term(1) + d.y * term(2) + d.z * term(3) + (d.x * d.y) * term(4)
                     + (d.y * d.z) * term(5) + (3.0f * d.z * d.z - 1.0f) * term(6) + (d.x * d.z) * term(7)
                     + (d.x * d.x - d.y * d.y) * term(8);
    return { max(sum.x, 0.0f), max(sum.y, 0.0f), max(sum.z, 0.0f) };
}

}  // namespace warpcam
