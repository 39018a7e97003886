// Physically based shading of a pixel: what its surface sends to the camera, linear.
#pragma once
#include "shading/pbr_material.h"
#include "shading/area_lights.h"
#include "shading/environment_map.h"
#include "shading/light_visibility.h"

namespace warpcam {

// The structs that a pixel needs, and Physical of types.py.
template <class Scene_, class Physical_> struct PhysicalScene : Scene_ {
    const Physical_& physical;
};
template <class Scene_, class Physical_> PhysicalScene(const Scene_&, const Physical_&)
    -> PhysicalScene<Scene_, Physical_>;

// What a ray in the mirror direction meets replaces the sky there, all of it up to SHARP_ROUGHNESS, and none of it from
// ROUGHEST_MIRROR on, as one ray is no lobe.
constexpr float SHARP_ROUGHNESS = 0.5f, ROUGHEST_MIRROR = 0.8f;

template <class Number> WARPCAM_DEVICE Number sharpness(Number roughness)
{
    const Number blur = saturate((roughness - SHARP_ROUGHNESS) * (1.0f / (ROUGHEST_MIRROR - SHARP_ROUGHNESS)));
    return 1.0f - blur * blur * (3.0f - 2.0f * blur);
}

// Light from all around as a surface of that roughness mirrors it, about the mirror direction, in the world.
template <int FLAGS, class Scene_, class Vector>
WARPCAM_DEVICE Vector mirrored_sky(const Sky& sky, const Scene_& scene, Vector mirror, NumberOf<Vector> roughness)
{
    if constexpr ((FLAGS & HAS_ENVIRONMENT) != 0)
        return lobe_of(load_environment(scene.physical.environments, sky.world), mirror, roughness * roughness);
    else
        return sky_along<(FLAGS & HAS_SKYBOX) != 0>(sky, scene.textures, scene.background, mirror, roughness);
}

// The light that a place of a surface sends to the eye, linear; all in the camera's frame. `list`:
// AreaLights, or WorldLights of path/lit_surface.h.
template <int FLAGS, class Lights_, class Scene_, class Vector>
WARPCAM_DEVICE Vector physical_light(const PbrInputs<Vector>& inputs, const Lights_& list, const Scene_& scene,
                                     const Mat3& rotation, Vector place, Vector normal, Vector to_eye,
                                     const Visibility<FLAGS, Vector>& visibility)
{
    using Number = NumberOf<Vector>;
    const Number slant = dot(normal, to_eye), eye_cosine = max(abs(slant), 1.0e-4f), none = 0.0f;
    Vector light = inputs.emission, around { none, none, none };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const AreaLight& area_light = list.area_lights[n];
        const auto reached = visibility.reached(area_light.place.w);
        if (!any(reached.some))
            continue;
        const AreaLightSample<Vector> light_sample = sample_light(area_light, place);
        const Number share = reached.of(light_sample.share);
        if (area_light.diffuse.w & AMBIENT)
            around = around + share * broadcast<Vector>(as_vec3(area_light.ambient));
        const Number cosine = clipped_cosine(dot(normal, light_sample.to_light), light_sample.sine_squared);
        const MaskOf<Vector> lit = share * cosine > 0.0f;
        if (!any(lit))
            continue;
        const BsdfValue<Vector> back =
            reflection_of(inputs.bsdf, normal, light_sample.to_light, to_eye, eye_cosine, light_sample.sine_squared);
        const Vector own = share
                           * (cosine * mul(back.matt, broadcast<Vector>(as_vec3(area_light.diffuse)))
                              + mul(back.gloss, broadcast<Vector>(as_vec3(area_light.specular))));
        light = select(lit, light + own, light);
    }
    const Vector up = transform(rotation, normal), reflected = transform(rotation, 2.0f * slant * normal - to_eye);
    const Vector mirror = lobe_direction(up, reflected, inputs.bsdf.roughness);
    const Vector even = around + sky_on(list.sky, up);
    const Vector mirrored = around + mirrored_sky<FLAGS>(list.sky, scene, mirror, inputs.bsdf.roughness);
    if constexpr ((FLAGS & INDIRECT_LIGHT) != 0) {
        const Number open = visibility.indirect.open();
        Number opening = specular_opening(open, eye_cosine, inputs.bsdf.roughness);
        if constexpr ((FLAGS & HAS_REFLECTIONS) != 0)  // rays find what mirrors show
            opening = opening + sharpness(inputs.bsdf.roughness) * (1.0f - opening);
        const Vector bounced = visibility.indirect.mean();
        const Number hidden = (1.0f - opening) / max(1.0f - open, 1.0e-3f);
        return light
               + inputs.open
                     * environment_brdf(inputs.bsdf, eye_cosine, open * even + bounced,
                                        opening * mirrored + hidden * bounced);
    } else if constexpr ((FLAGS & AMBIENT_OCCLUSION) != 0) {
        const Number open = visibility.open();
        Number opening = lobe_opening(open, visibility.rise(), mirror, inputs.bsdf.roughness);
        if constexpr ((FLAGS & HAS_REFLECTIONS) != 0)  // rays find what hides the sky of mirrors
            opening = opening + sharpness(inputs.bsdf.roughness) * (1.0f - opening);
        // What hides the sky of a mirror faces the surface, so that light from the other side falls on it.
        const Vector facing = around + sky_on(list.sky, -mirror);
        const Vector seen = opening * mirrored + ((1.0f - opening) * hidden_radiance(open, HIDING_ALBEDO)) * facing;
        return light
               + inputs.open
                     * environment_brdf(inputs.bsdf, eye_cosine, mul(open_to_color(open, inputs.bsdf.matt), even),
                                        seen);
    }
    return light + inputs.open * environment_brdf(inputs.bsdf, eye_cosine, even, mirrored);
}

// `place` is the hit in the camera's frame, `ray` the direction that it is seen along in the shape's.
template <class Types, int LENS, int FLAGS, class Appearances, class Scene_>
WARPCAM_DEVICE Vec3 shade_physically(const Appearances& look, const AreaLights& list, const Scene_& scene,
                                     const Camera& camera, float x, float y, const SurfaceInteraction& surface,
                                     Vec3 place, Vec3 ray, float depth, Vec3 color,
                                     const Visibility<FLAGS, Vec3>& visibility)
{
    Vec3 normal = smooth_normal<Types>(look.pose, scene.meshes, surface);
    const PbrInputs<Vec3> inputs = pbr_inputs_at<Types, LENS, (FLAGS & HAS_MAPS) != 0>(
        look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth, color, normal);
    normal = look.pose.seen(normal);
    Vec3 to_eye = LENS != ORTHOGRAPHIC ? -normalized(place) : Vec3 { 0.0f, 0.0f, 1.0f };
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        to_eye = -CameraRay<LENS> { x, y }.direction();
    return physical_light<FLAGS>(inputs, list, scene, camera.rotation, place, normal, to_eye, visibility);
}

}  // namespace warpcam
