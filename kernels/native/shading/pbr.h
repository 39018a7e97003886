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

// The light that a place of a surface sends to the eye, linear; all in the camera's frame. Bit l of `shadow` says that
// light l, of those that are kept, does not reach it.
template <int FACTS, class Scene_, class Vector>
WARPCAM_FN Vector physical_light(const PbrInputs<Vector>& paint, const LampList& list, const Scene_& scene,
                                 const Matrix& rotation, Vector place, Vector normal, Vector to_eye,
                                 IntOf<Vector> shadow)
{
    using Number = NumberOf<Vector>;
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS, IMAGE = FACTS & HAS_SKYBOX;
    const Number slant = dot(normal, to_eye), eye_cosine = upper(magnitude(slant), 1.0e-4f), none = 0.0f;
    Vector light = paint.glow, around { none, none, none };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Lamp& lamp = list.lamps[n];
        const MaskOf<Vector> reached = (lamp.place.w & shadow) == 0;
        if (SHADOWS && !any_of(reached))
            continue;
        const AreaLightSample<Vector> shine = shine_at(lamp, place);
        const Number share = SHADOWS ? (reached ? shine.share : none) : shine.share;
        if (lamp.diffuse.w & AMBIENT)
            around = around + share * broadcast<Vector>(to_vec(lamp.ambient));
        const Number cosine = cosine_over(dot(normal, shine.to_light), shine.spread);
        const MaskOf<Vector> lit = share * cosine > 0.0f;
        if (!any_of(lit))
            continue;
        const BsdfValue<Vector> back =
            reflection_of(paint.skin, normal, shine.to_light, to_eye, eye_cosine, shine.spread);
        const Vector own = share * (cosine * times(back.matt, broadcast<Vector>(to_vec(lamp.diffuse)))
                                    + times(back.gloss, broadcast<Vector>(to_vec(lamp.specular))));
        light = chosen(lit, light + own, light);
    }
    const Vector up = turned(rotation, normal), mirror = turned(rotation, 2.0f * slant * normal - to_eye);
    const Vector even = around + sky_on(list.sky, up);
    const Vector mirrored =
        around + sky_along<IMAGE>(list.sky, scene.textures, scene.background, mirror, paint.skin.roughness);
    return light + paint.open * reflected_around(paint.skin, eye_cosine, even, mirrored);
}

// `place` is the hit in the camera's frame, `ray` the direction that it is seen along in the shape's.
template <int TYPES, int LENS, int FACTS, class Looks, class Scene_>
WARPCAM_FN Vec shade_physically(const Looks& look, const LampList& list, const Scene_& scene, const Camera& camera,
                                float x, float y, const Surface& surface, Vec place, Vec ray, float depth, Vec color,
                                int shadow)
{
    Vec normal = smooth_normal<TYPES>(look.pose, scene.meshes, surface);
    const PbrInputs<Vec> paint = paint_at<TYPES, LENS, (FACTS & HAS_MAPS) != 0>(
        look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth, color, normal);
    normal = look.pose.seen(normal);
    Vec to_eye = LENS != ORTHOGRAPHIC ? -normalized(place) : Vec { 0.0f, 0.0f, 1.0f };
    if constexpr (LENS == SPREAD)
        to_eye = -ViewRay<LENS> { x, y }.direction();
    return physical_light<FACTS>(paint, list, scene, camera.rotation, place, normal, to_eye, shadow);
}

}  // namespace warpcam
