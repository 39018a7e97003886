// The shadows of shapes on themselves: what is turned away from a light lies behind what the light falls on, and so in
// its shadow where the light's map has it. There is no light to lose there but the ambient part, so that only lights
// that have one ask. Meshes, which may be open, find theirs with the shadows of all else; planes have none.
#pragma once
#include "shading/fixed_function.h"

namespace warpcam {

constexpr int SHADES_ITSELF = 1 << HEIGHT_FIELD | types_with([](auto shape) { return shape.SHADES_ITSELF; });

// The map of a light that dims, in the camera's frame.
WARPCAM_DEVICE ShadowMap map_of(const LightList& list, const Light& light, const Camera& camera)
{
    const bool spot = light.ambient.w & SPOT;
    const Mat3& r = camera.rotation;
    const Vec3 along = normalized(spot ? as_vec3(light.axis) : -as_vec3(light.place));
    return shadow_map(as_vec3(spot ? light.place : light.axis), along,
                      cross({ r.at[0][0], r.at[0][1], r.at[0][2] }, along),
                      { as_float(light.specular.w), list.near, 0.0f });
}

// The bits of the lights in whose shadow a shape that shades itself has a place, as far as it comes from that shape.
// In the camera's frame; `normal` is the shape's own.
template <class Vector> static WARPCAM_NOINLINE IntOf<Vector> own_shadow(const LightList& list, const Camera& camera,
                                                                         Vector place, Vector normal)
{
    using Int = IntOf<Vector>;
    Int shadow = 0;
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        if (!dims(light))
            continue;
        const bool spot = light.ambient.w & SPOT;
        const ShadowMap map = map_of(list, light, camera);
        const Vector source = broadcast<Vector>(as_vec3(light.place));
        NumberOf<Vector> along;
        MaskOf<Vector> dark = !(dot(normal, spot ? source - place : source) > 0.0f);
        if (map.bounded && any(dark))
            dark = dark & has_place(map, !spot, place, along);
        const Int none = 0, bit = light.place.w;
        shadow |= dark ? bit : none;
    }
    return shadow;
}

}  // namespace warpcam
