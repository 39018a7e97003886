// Physically based shading of eight hits of one shape, on a CPU: shading/pbr.h, shading/pbr_material.h, shading/ggx.h,
// shading/area_lights.h, shading/environment.h, shading/environment_map.h and core/srgb.h, whose comments hold here.
#pragma once
#include "shading/pbr.h"
#include "shading/surface_simd.h"
#include "shading/texture_simd.h"

namespace warpcam {

inline Vec3x8 srgb_to_linear(const Vec3x8& color)
{
    return { srgb_to_linear(color.x), srgb_to_linear(color.y), srgb_to_linear(color.z) };
}
inline Vec3x8 linear_to_srgb(const Vec3x8& light)
{
    return { linear_to_srgb(light.x), linear_to_srgb(light.y), linear_to_srgb(light.z) };
}

inline Vec3x8 multiple_scattering(Float8 lost, const Vec3x8& single, const Vec3x8& mean)
{
    return lost * div(mul(single, mean), broadcast({ 1.0f, 1.0f, 1.0f }) - lost * mean);
}

template <class Textures> inline Vec3x8 sky_image(const Textures& textures, const Image& image, const Vec3x8& direction,
                                                  const Vec3x8& right, const Vec3x8& down)
{
    Vec3x8 read;
    sample_cubes(textures.texels.data, Levels(image, 6), direction, right, down, read);
    return read;
}

inline Vec3x8 lobe_of(const Environment& environment, const Vec3x8& direction, Float8 alpha)
{
    Vec3x8 light;
    for (int k = 0; k < SIMD_WIDTH; ++k)
        set_lane(light, k, lobe_of(environment, get_lane(direction, k), alpha[k]));
    return light;
}

// `steps(right, down)` says how far it is to what the next pixels show.
template <class Types, bool MAPS, class Appearances, class Meshes, class Textures, class Steps>
inline void pbr_inputs8_at(const Appearances& look, const Meshes& meshes, const Textures& textures, const Steps& steps,
                           const SurfaceInteraction8& surface, const Vec3x8& ray, const Vec3x8& color, Vec3x8& normal,
                           PbrInputs<Vec3x8>& inputs)
{
    const PbrMaterial& material = look.material;
    const ShapeFromCamera& pose = look.pose;
    Float8 roughness = material.gloss.x, metallic = material.gloss.y;
    const Vec3x8 own = mul(broadcast(as_vec3(material.color)), color);
    inputs.emission = broadcast(as_vec3(material.emission)) + (Float8)material.glow * own;
    inputs.open = 1.0f;
    if constexpr (MAPS) {
        const int normals = material.normals, packed = material.gloss.w, emission_map = material.emission.w;
        if ((normals >= 0 || packed >= 0 || emission_map >= 0) && !(Types::has(PLANE) && pose.type() == PLANE)) {
            Vec3x8 right, down;
            steps(right, down);
            Footprints at;
            footprints_2d<Types>(pose, look.layout, meshes, surface, ray, right, down, at);
            if constexpr (Appearances::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            const auto read = [&](int texture) {
                return sample_2d(textures.texels.data, Levels(load_image(textures, texture), 1), at);
            };
            if (is_texture(textures, packed)) {
                const Vec3x8 map = read(packed);
                inputs.open = map.x;
                roughness *= map.y;
                metallic *= map.z;
            }
            if (is_texture(textures, emission_map))
                inputs.emission = mul(inputs.emission, srgb_to_linear(read(emission_map)));
            if (is_texture(textures, normals)) {
                const Vec3x8 map = (Float8)2.0f * read(normals) - broadcast({ 1.0f, 1.0f, 1.0f });
                for (int k = 0; k < SIMD_WIDTH; ++k) {
                    const Mapping on = map_2d<Types>(pose, look.layout, meshes, get_lane(surface, k));
                    set_lane(normal, k, tilted(get_lane(normal, k), get_lane(map, k), on.du, -on.dv));
                }
            }
        }
    }
    set_reflection(inputs, own, roughness, metallic, material.gloss.z);
}

// Where the shares of eight pixels of a region and their light from shapes are. `count` pixels are given; further lanes
// repeat the last.
template <int FLAGS, int WIDTH, class Frame, class Hits>
inline void find_pixel_light(const Frame& frame, size_t first, const short* pixels, int count, Hits& hits)
{
    for (int k = 0; (FLAGS & (SHARE_FLAGS | INDIRECT_LIGHT)) != 0 && k < SIMD_WIDTH; ++k) {
        const int pixel = pixels[min(k, count - 1)];
        const size_t at = first + size_t(pixel / WIDTH) * frame.width + pixel % WIDTH;
        if constexpr ((FLAGS & SHARE_FLAGS) != 0)
            hits.shares.bytes[k] = reinterpret_cast<const unsigned char*>(frame.visible.data + at);
        if constexpr ((FLAGS & INDIRECT_LIGHT) != 0)
            hits.indirect.rows[k] = reinterpret_cast<const float*>(frame.indirect.data + at);
    }
}

template <int FLAGS, class Hits> inline Visibility<FLAGS, Vec3x8> visibility8_of(const Hits& hits)
{
    Visibility<FLAGS, Vec3x8> found;
    if constexpr ((FLAGS & HAS_SHADOWS) != 0)
        found.shadow = hits.shadow;
    if constexpr ((FLAGS & SHARE_FLAGS) != 0)
        found.shares = hits.shares;
    if constexpr ((FLAGS & INDIRECT_LIGHT) != 0)
        found.indirect = hits.indirect;
    return found;
}

// Shades surfaces: light sent to the camera, linear. `color` is their texture's, linear.
template <class Types, int FLAGS, class Appearances, class Scene_, class Steps>
WARPCAM_NOINLINE_CPU inline void shade_eight_physically(const Appearances& look, const AreaLights& list,
                                                        const Scene_& scene, const Mat3& rotation, const Steps& steps,
                                                        const SurfaceInteraction8& surface, const Vec3x8& place,
                                                        const Vec3x8& to_eye, const Vec3x8& ray, const Vec3x8& color,
                                                        const Visibility<FLAGS, Vec3x8>& visibility, Vec3x8& light)
{
    Vec3x8 normal = smooth_normal<Types>(look.pose, scene.meshes, surface);
    PbrInputs<Vec3x8> inputs;
    pbr_inputs8_at<Types, (FLAGS & HAS_MAPS) != 0>(look, scene.meshes, scene.textures, steps, surface, ray, color,
                                                   normal, inputs);
    light = physical_light<FLAGS>(inputs, list, scene, rotation, place, look.pose.seen(normal), to_eye, visibility);
}

}  // namespace warpcam
