// Physically based material at a surface point, with its maps applied.
#pragma once
#include "shading/ggx.h"
#include "shading/appearance.h"
#include "shading/texture_mapping.h"

namespace warpcam {

// Material inputs of a surface point.
template <class Vector> struct PbrInputs {
    Bsdf<Vector> bsdf;
    Vector emission;            // what it emits
    NumberOf<Vector> open;  // share of the light from all around that reaches it
};

// Sets how a surface point reflects light. A negative reflectance, UNLIT in types.py, is that of a surface which sends its
// colour whatever the light is, and reflects nothing.
template <class Vector, class Number = NumberOf<Vector>>
WARPCAM_DEVICE void set_reflection(PbrInputs<Vector>& inputs, Vector color, Number roughness, Number metallic,
                                   float reflectance)
{
    if (reflectance < 0.0f) {
        inputs.emission = color;
        color = broadcast<Vector>({ 0.0f, 0.0f, 0.0f });
        reflectance = 0.0f;
    }
    inputs.bsdf = make_bsdf(color, roughness, metallic, reflectance);
}

// A normal tilted as a map says, whose red and green lie along the texture's u and v (v up). The frame follows the
// triangle: u's gradient, made square to the normal, and to it v.
WARPCAM_DEVICE Vec3 tilted(Vec3 normal, Vec3 map, Vec3 du, Vec3 dv)
{
    const Vec3 along_u = cross(dv, normal),
               along_v = cross(normal, du);  // the place's rates of change, but for a factor
    const float side = dot(du, along_u) < 0.0f ? -1.0f : 1.0f;           // -1 where the texture is mirrored
    if (dot(along_u, along_u) < 1.0e-30f || dot(along_v, along_v) < 1.0e-30f)
        return normal;
    return normalized(map.x * side * normalized(along_u) + map.y * side * normalized(along_v) + map.z * normal);
}

// Material of a surface point, with its maps applied.
struct SurfaceMaterial {
    Vec3 color, emission;  // linear
    float roughness, metallic, reflectance;
    float open;  // share of the light from all around that reaches it
};

// `color` is that of the shape's texture there, linear; `normal` comes in smooth and goes out as the map tilts it.
template <class Types, int LENS, bool MAPS, class Appearances, class Meshes, class Textures>
WARPCAM_DEVICE SurfaceMaterial surface_material(const Appearances& look, const Meshes& meshes, const Textures& textures,
                                                const Camera& camera, float x, float y,
                                                const SurfaceInteraction& surface, Vec3 ray, float depth, Vec3 color,
                                                Vec3& normal)
{
    const PbrMaterial& material = look.material;
    const Vec3 own = mul(as_vec3(material.color), color);
    SurfaceMaterial found {
        own, as_vec3(material.emission) + material.glow * own, material.gloss.x, material.gloss.y, material.gloss.z,
        1.0f
    };
    if constexpr (MAPS) {
        const int normals = material.normals, packed = material.gloss.w, emission_map = material.emission.w;
        const ShapeFromCamera& pose = look.pose;
        if ((normals >= 0 || packed >= 0 || emission_map >= 0) && !(Types::has(PLANE) && pose.type() == PLANE)) {
            const Vec3 right = pose.local(step_right<LENS>(camera, x, y, depth));
            const Vec3 down = pose.local(step_down<LENS>(camera, x, y, depth));
            Mapping at = map_2d<Types>(pose, look.layout, meshes, surface);
            shift(look, at.u, at.v);
            const Vec3 step_right = slide(right, ray, surface.normal), step_down = slide(down, ray, surface.normal);
            const Float2 to_right { dot(at.du, step_right), dot(at.dv, step_right) };
            const Float2 to_below { dot(at.du, step_down), dot(at.dv, step_down) };
            const auto read = [&](int texture) {
                return sample_2d(textures.texels.data, load_image(textures, texture), at.u, at.v, to_right, to_below);
            };
            if (is_texture(textures, packed)) {
                const Vec3 factors = read(packed);
                found.open = factors.x;
                found.roughness *= factors.y;
                found.metallic *= factors.z;
            }
            if (is_texture(textures, emission_map))
                found.emission = mul(found.emission, srgb_to_linear(read(emission_map)));
            if (is_texture(textures, normals))
                normal = tilted(normal, 2.0f * read(normals) - Vec3 { 1.0f, 1.0f, 1.0f }, at.du, -at.dv);
        }
    }
    return found;
}

template <class Types, int LENS, bool MAPS, class Appearances, class Meshes, class Textures>
WARPCAM_DEVICE PbrInputs<Vec3> pbr_inputs_at(const Appearances& look, const Meshes& meshes, const Textures& textures,
                                             const Camera& camera, float x, float y, const SurfaceInteraction& surface,
                                             Vec3 ray, float depth, Vec3 color, Vec3& normal)
{
    const SurfaceMaterial material =
        surface_material<Types, LENS, MAPS>(look, meshes, textures, camera, x, y, surface, ray, depth, color, normal);
    PbrInputs<Vec3> inputs { {}, material.emission, material.open };
    set_reflection(inputs, material.color, material.roughness, material.metallic, material.reflectance);
    return inputs;
}

}  // namespace warpcam
