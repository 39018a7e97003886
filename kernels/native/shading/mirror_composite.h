// Colours that mirrors show, and their place in the images.
#pragma once
#include "shading/appearance.h"
#include "shading/world_overrides.h"
#include "output/pixel_store.h"

namespace warpcam {

// Dims a material as seen in a mirror: its colour weaker, its highlights unchanged.
WARPCAM_DEVICE void dim(ResolvedMaterial& material, float strength)
{
    material.color.x *= strength;
    material.color.y *= strength;
    material.color.z *= strength;
}

// Adds what the mirror shows, which has been drawn into the images, to the mirror's own colour.
template <int IMAGES, class Images>
WARPCAM_DEVICE void add_mirrored(const Images& images, unsigned at, Vec3& linear, Vec3& display)
{
    if constexpr ((IMAGES & HDR) != 0) {
        const float* seen = images.hdr.data + 3 * size_t(at);
        linear = linear + Vec3 { seen[0], seen[1], seen[2] };
    }
    if constexpr ((IMAGES & (RGB | RGBA)) != 0) {
        const auto* seen = (IMAGES & RGB ? images.rgb.data + 3 * size_t(at) : images.rgba.data + 4 * size_t(at));
        display = display + 1.0f / 255.0f * Vec3 { float(seen[0]), float(seen[1]), float(seen[2]) };
    }
}

// Puts what a surface mirrors and what is seen through it, as occlusion/reflection_rays.h has it of a pixel, in place of the sky.
template <int FLAGS, class Scene_>
WARPCAM_DEVICE void mix_reflections(const Scene_& scene, int world, unsigned at, Vec3& linear, Vec3& display)
{
    const Float3Int mix = load(scene.frame.reflections.data, int(at));
    const Vec3 sum = as_float(mix.w) * linear + exposed<FLAGS>(scene, world, as_vec3(mix));
    linear = { max(sum.x, 0.0f), max(sum.y, 0.0f), max(sum.z, 0.0f) };
    display = display_color<FLAGS>(linear);
}

}  // namespace warpcam
