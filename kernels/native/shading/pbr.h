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
template <int TYPES, int LENS, int FACTS, class Looks, class Scene_>
WARPCAM_FN Vec shade_physically(const Looks& look, const LampList& list, const Scene_& scene, const Camera& camera,
                                float x, float y, const Surface& surface, Vec place, Vec ray, float depth, Vec color,
                                int shadow)
{
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS, MAPS = FACTS & HAS_MAPS, IMAGE = FACTS & HAS_SKYBOX;
    Vec normal = smooth_normal<TYPES>(look.pose, scene.meshes, surface);
    const Paint paint
        = paint_at<TYPES, LENS, MAPS>(look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth, color,
                                      normal);
    normal = look.pose.seen(normal);
    Vec to_eye = LENS != ORTHOGRAPHIC ? -normalized(place) : Vec { 0.0f, 0.0f, 1.0f };
    if constexpr (LENS == SPREAD)
        to_eye = -ViewRay<LENS> { x, y }.direction();
    const float slant = dot(normal, to_eye), eye_cosine = upper(magnitude(slant), 1.0e-4f);
    Vec light = paint.glow, around { 0.0f, 0.0f, 0.0f };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Lamp& lamp = list.lamps[n];
        if (SHADOWS && (lamp.place.w & shadow))
            continue;
        const Shine shine = shine_at(lamp, place);
        if (lamp.diffuse.w & AMBIENT)
            around = around + shine.share * to_vec(lamp.ambient);
        const float cosine = cosine_over(dot(normal, shine.to_light), shine.spread);
        if (!(shine.share * cosine > 0.0f))
            continue;
        const Reflection back = reflection_of(paint.skin, normal, shine.to_light, to_eye, eye_cosine, shine.spread);
        light = light + shine.share * (cosine * times(back.matt, to_vec(lamp.diffuse))
                                       + times(back.gloss, to_vec(lamp.specular)));
    }
    const Vec up = turned(camera.rotation, normal);
    const Vec mirror = turned(camera.rotation, 2.0f * slant * normal - to_eye);
    const Vec even = around + sky_on(list.sky, up);
    const Vec mirrored = around
        + sky_along<IMAGE>(list.sky, scene.textures, scene.background, mirror, paint.skin.roughness);
    return light + paint.open * reflected_around(paint.skin, eye_cosine, even, mirrored);
}

}  // namespace warpcam
