// Per-world values beside the tables of shapes, materials and lights: texture offsets, background, exposure. Only
// scenes and cameras that ask for them have any.
#pragma once
#include "shading/appearance.h"
#include "shading/environment_map.h"
#include "shading/tone_mapping.h"

namespace warpcam {

template <class Textures> WARPCAM_DEVICE bool is_cube(const Textures& textures, int texture)
{
    return is_texture(textures, texture) && wp::index(textures.kind, texture) == TEXTURE_CUBE;
}

// Features of a scene and of a camera, beside those of shading/appearance.h. Values of flags.py.
enum OverrideFact {
    PER_WORLD_BACKGROUND = 1 << 21,   // worlds have a background or a skybox of their own
    HEADLIGHTS = 1 << 22,  // worlds have a headlight of their own
    HAS_EXPOSURE = 1 << 23      // the camera has an exposure
};

// Background of one world, in place of types.py's Background of all.
struct Backdrop {
    wp::vec3 color;
    int skybox;
};

template <int FLAGS, class Scene_> WARPCAM_DEVICE decltype(auto) background_of(const Scene_& scene, int world)
{
    if constexpr ((FLAGS & PER_WORLD_BACKGROUND) != 0) {
        const auto& overrides = scene.frame.overrides;
        const int skybox = wp::index(overrides.skyboxes, remainder(world, overrides.skyboxes.shape[0]));
        return Backdrop { wp::index(overrides.backgrounds, remainder(world, overrides.backgrounds.shape[0])),
                          is_cube(scene.textures, skybox) ? skybox : -1 };
    } else {
        return (scene.background);
    }
}

// Distance of the skybox, as a part of how far MuJoCo's camera sees: SKYBOX of sources/mujoco/layers.py.
constexpr float SKY_DISTANCE = 0.7f;

// Point of the skybox that a ray along `ray` reaches from `start`, relative to the eye: see shading/haze.h. For lenses
// with parallel rays, which see the skybox at its own width.
template <class Number, class Vector> WARPCAM_DEVICE Vector place_on_sky(Vector start, Vector ray, Number radius)
{
    const Number none = 0.0f, least = 1.0e-18f;
    const Number along = start.x * ray.x + start.y * ray.y, square = ray.x * ray.x + ray.y * ray.y;
    const Number rest = max(radius * radius - start.x * start.x - start.y * start.y, none);
    const Number aside = rest / max(along + sqrt(along * along + square * rest), least);
    const Number upright = max((radius - (ray.z < 0.0f ? -start.z : start.z)) / max(abs(ray.z), least), none);
    return start + min(aside, upright) * ray;
}

// Colour where nothing is hit. The skybox lies on its side: its y axis is the world's z. `horizon`: see
// shading/plane_grid.h; 0: the skybox is too far away to tell where rays begin.
template <int LENS, int FLAGS, class Textures, class Background>
WARPCAM_DEVICE Vec3 background_color(const Textures& textures, const Background& background, const Camera& camera,
                                     float horizon, float x, float y)
{
    const Image image = FLAGS & HAS_SKYBOX ? load_image(textures, background.skybox) : Image { 0, 0, 0, 0 };
    if ((FLAGS & HAS_SKYBOX) && image.levels > 0) {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const bool flat = LENS == ORTHOGRAPHIC && !(horizon > 0.0f);
        Vec3 ray = transform(camera.rotation, CameraRay<LENS> { x, y }.direction());
        Vec3 right = flat ? none : transform(camera.rotation, step_right<LENS>(camera, x, y, 1.0f));
        Vec3 down = flat ? none : transform(camera.rotation, step_down<LENS>(camera, x, y, 1.0f));
        if (LENS == ORTHOGRAPHIC && !flat)
            ray = place_on_sky(transform(camera.rotation, { x, y, 0.0f }), ray, SKY_DISTANCE * horizon);
        if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {  // it is too far away to tell where they begin
            right = transform(camera.rotation, CameraRay<LENS> { x, y }.across().direction);
            down = transform(camera.rotation, CameraRay<LENS> { x, y }.down().direction);
        }
        return sample_cube(textures.texels.data, image, { ray.x, ray.z, -ray.y }, { right.x, right.z, -right.y },
                           { down.x, down.z, -down.y });
    }
    return as_vec3(background.color);
}

// An environment where nothing is hit.
template <int LENS>
WARPCAM_DEVICE Vec3 environment_at(const Environment& environment, const Camera& camera, float x, float y)
{
    const CameraRay<LENS> ray { x, y };
    const auto turned = [&](Vec3 v) { return transform(camera.rotation, v); };
    const Vec3 direction = turned(ray.direction());
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        return environment_behind(environment, direction, turned(ray.across().direction), turned(ray.down().direction));
    if constexpr (LENS == ORTHOGRAPHIC)
        return environment_behind(environment, direction, { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f });
    return environment_behind(environment, direction, turned(step_right<LENS>(camera, x, y, 1.0f)),
                              turned(step_down<LENS>(camera, x, y, 1.0f)));
}

// Index of the headlight's first colour.
template <int FLAGS> WARPCAM_DEVICE int headlight_of(int world) { return FLAGS & HEADLIGHTS ? 3 * (world + 1) : 0; }

// Moves a shape's texture, in images; not a cube's.
template <class Appearances, class Scene_>
WARPCAM_DEVICE void load_shift(Appearances& look, const Scene_& scene, int world, int id)
{
    if constexpr (Appearances::SHIFTED) {
        const int index = material_of(scene.shapes, scene.materials, world, id);
        look.shift_u = look.shift_v = 0.0f;
        if (index >= 0) {
            const auto offset = per_world(scene.frame.overrides.texture_offsets, world, index);
            look.shift_u = offset[0];
            look.shift_v = offset[1];
        }
    }
}

// Applies the camera's exposure to light.
template <int FLAGS, class Scene_> WARPCAM_DEVICE Vec3 exposed(const Scene_& scene, int world, Vec3 light)
{
    if constexpr ((FLAGS & HAS_EXPOSURE) != 0) {
        const auto& overrides = scene.frame.overrides;
        return pow(2.0f, wp::index(overrides.exposures, world))
               * mul(as_vec3(wp::index(overrides.gains, world)), light);
    }
    return light;
}

// Applies the exposure to a surface; the display colour of a physically based surface follows from its light.
template <int FLAGS, class Scene_>
WARPCAM_DEVICE void expose(const Scene_& scene, int world, Vec3& linear, Vec3& display)
{
    if constexpr ((FLAGS & HAS_EXPOSURE) != 0) {
        linear = exposed<FLAGS>(scene, world, linear);
        display = FLAGS & PHYSICAL ? display_color<FLAGS>(linear) : exposed<FLAGS>(scene, world, display);
    }
}

}  // namespace warpcam
