// Physically based shading of a pixel: what its surface sends to the camera, linear.
#pragma once
#include "shading/pbr_material.h"
#include "shading/area_lights.h"

namespace warpcam {

// The structs that a pixel needs, and Physical of types.py.
template <class Scene_, class Physical_> struct PhysicalScene : Scene_ {
    const Physical_& physical;
};
template <class Scene_, class Physical_> PhysicalScene(const Scene_&, const Physical_&)
    -> PhysicalScene<Scene_, Physical_>;

// `place` is the hit in the camera's frame, `ray` the direction that it is seen along in the shape's. Bit l of `shadow`
// says that light l, of those that are kept, does not reach it.
template <int TYPES, int LENS, int FACTS, class Appearances, class Scene_>
WARPCAM_DEVICE Vec3 shade_physically(const Appearances& look, const AreaLights& list, const Scene_& scene, const Camera& camera,
                                float x, float y, const SurfaceInteraction& surface, Vec3 place, Vec3 ray, float depth, Vec3 color,
                                int shadow)
{
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS, MAPS = FACTS & HAS_MAPS, IMAGE = FACTS & HAS_SKYBOX;
    Vec3 normal = smooth_normal<TYPES>(look.pose, scene.meshes, surface);
    const PbrInputs paint
        = paint_at<TYPES, LENS, MAPS>(look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth, color,
                                      normal);
    normal = look.pose.seen(normal);
    Vec3 to_eye = LENS != ORTHOGRAPHIC ? -normalized(place) : Vec3 { 0.0f, 0.0f, 1.0f };
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        to_eye = -CameraRay<LENS> { x, y }.direction();
    const float slant = dot(normal, to_eye), eye_cosine = max(abs(slant), 1.0e-4f);
    Vec3 light = paint.glow, around { 0.0f, 0.0f, 0.0f };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const AreaLight& lamp = list.lamps[n];
        if (SHADOWS && (lamp.place.w & shadow))
            continue;
        const LightSample shine = sample_light(lamp, place);
        if (lamp.diffuse.w & AMBIENT)
            around = around + shine.share * as_vec3(lamp.ambient);
        const float cosine = clipped_cosine(dot(normal, shine.to_light), shine.spread);
        if (!(shine.share * cosine > 0.0f))
            continue;
        const BsdfValue back = reflection_of(paint.skin, normal, shine.to_light, to_eye, eye_cosine, shine.spread);
        light = light + shine.share * (cosine * mul(back.matt, as_vec3(lamp.diffuse))
                                       + mul(back.gloss, as_vec3(lamp.specular)));
    }
    const Vec3 up = transform(camera.rotation, normal);
    const Vec3 mirror = transform(camera.rotation, 2.0f * slant * normal - to_eye);
    const Vec3 even = around + sky_on(list.sky, up);
    const Vec3 mirrored = around
        + sky_along<IMAGE>(list.sky, scene.textures, scene.background, mirror, paint.skin.roughness);
    return light + paint.open * environment_brdf(paint.skin, eye_cosine, even, mirrored);
}

}  // namespace warpcam
