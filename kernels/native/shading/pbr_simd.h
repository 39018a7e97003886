// Physically based shading of eight hits of one shape, on a CPU: shading/pbr.h, shading/pbr_material.h, shading/ggx.h,
// shading/area_lights.h, shading/environment.h and core/srgb.h, whose comments hold here.
#pragma once
#include "shading/pbr.h"
#include "shading/surface_simd.h"
#include "shading/texture_simd.h"

namespace warpcam {

inline Vecs decoded(const Vecs& color) { return { decoded(color.x), decoded(color.y), decoded(color.z) }; }
inline Vecs encoded(const Vecs& light) { return { encoded(light.x), encoded(light.y), encoded(light.z) }; }

inline Vecs multiple_scattering(Floats lost, const Vecs& single, const Vecs& mean)
{
    return lost * divided(times(single, mean), eight_of({ 1.0f, 1.0f, 1.0f }) - lost * mean);
}

template <class Textures> inline Vecs sky_image(const Textures& textures, const Image& image, const Vecs& direction,
                                                const Vecs& right, const Vecs& down)
{
    Vecs read;
    sample_cubes(textures.texels.data, Levels(image, 6), direction, right, down, read);
    return read;
}

// `steps(right, down)` says how far it is to what the next pixels show.
template <int TYPES, bool MAPS, class Looks, class Meshes, class Textures, class Steps>
inline void paints_at(const Looks& look, const Meshes& meshes, const Textures& textures, const Steps& steps,
                      const Surfaces& surface, const Vecs& ray, const Vecs& color, Vecs& normal, PbrInputs<Vecs>& paint)
{
    const Coat& coat = look.finish;
    const Pose& pose = look.pose;
    Floats roughness = coat.gloss.x, metallic = coat.gloss.y;
    paint.glow = eight_of(to_vec(coat.glow));
    paint.open = 1.0f;
    if constexpr (MAPS) {
        const int normals = coat.normals, packed = coat.gloss.w, glowing = coat.glow.w;
        if ((normals >= 0 || packed >= 0 || glowing >= 0) && !((TYPES >> PLANE & 1) && pose.type() == PLANE)) {
            Vecs right, down;
            steps(right, down);
            Footprints at;
            footprints_2d<TYPES>(pose, look.layout, meshes, surface, ray, right, down, at);
            if constexpr (Looks::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            const auto read = [&](int texture) {
                return sample_2d(textures.texels.data, Levels(load_image(textures, texture), 1), at);
            };
            if (is_texture(textures, packed)) {
                const Vecs map = read(packed);
                paint.open = map.x;
                roughness *= map.y;
                metallic *= map.z;
            }
            if (is_texture(textures, glowing))
                paint.glow = times(paint.glow, decoded(read(glowing)));
            if (is_texture(textures, normals)) {
                const Vecs map = (Floats)2.0f * read(normals) - eight_of({ 1.0f, 1.0f, 1.0f });
                for (int k = 0; k < PACKET; ++k) {
                    const Mapping on = map_2d<TYPES>(pose, look.layout, meshes, one_of(surface, k));
                    put_one(normal, k, tilted(one_of(normal, k), one_of(map, k), on.du, -on.dv));
                }
            }
        }
    }
    paint.skin = skin_of(times(eight_of(to_vec(coat.color)), color), roughness, metallic, coat.gloss.z);
}

// What the surfaces send to the camera, linear. `color` is their texture's, linear.
template <int TYPES, int FACTS, class Looks, class Scene_, class Steps>
WARPCAM_APART inline void shade_eight_physically(const Looks& look, const LampList& list, const Scene_& scene,
                                                 const Matrix& rotation, const Steps& steps, const Surfaces& surface,
                                                 const Vecs& place, const Vecs& to_eye, const Vecs& ray,
                                                 const Vecs& color, Ints shadow, Vecs& light)
{
    Vecs normal = smooth_normal<TYPES>(look.pose, scene.meshes, surface);
    PbrInputs<Vecs> paint;
    paints_at<TYPES, (FACTS & HAS_MAPS) != 0>(look, scene.meshes, scene.textures, steps, surface, ray, color, normal,
                                              paint);
    light = physical_light<FACTS>(paint, list, scene, rotation, place, look.pose.seen(normal), to_eye, shadow);
}

}  // namespace warpcam
