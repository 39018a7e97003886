// The surface where a path meets a shape: its place and normals, its material with its maps applied, its opacity.
#pragma once
#include "path/trace_path.h"
#include "shading/appearance_cache.h"

namespace warpcam {

// Materials and maps as shading/pbr.h reads them.
template <int FLAGS> using PathNeeds = ShadingNeeds<HDR, FLAGS | PHYSICAL>;

struct PathSurface {
    Vec3 point;    // from the camera, along the world's axes [m]
    Vec3 outward;  // unit normal of the geometry
    Vec3 normal;   // unit, towards where the ray comes from, smooth and as a map tilts it
    SurfaceMaterial material;
    float alpha;   // opacity
    float transmission;  // share of what is not reflected that goes through
    float margin;  // by which a ray from here is moved off the surface [m]
    bool front;    // the ray comes from outside
};

// Texture coordinates, without the steps to other pixels: pixels are averaged by their many rays.
template <class Types, class Appearances, class Meshes>
WARPCAM_DEVICE Footprint texture_place(const Appearances& look, const Meshes& meshes, const SurfaceInteraction& surface,
                                       Vec3 ray)
{
    const Vec3 none { 0.0f, 0.0f, 0.0f };
    Footprint at = footprint_2d<Types>(look.pose, look.layout, meshes, surface, ray, none, none);
    shift(look, at.u, at.v);
    return at;
}

// Opacity of a texture and of a map there.
template <class Types, int FLAGS, class Appearances, class Scene_>
WARPCAM_DEVICE float path_opacity(const Appearances& look, const Scene_& scene, const SurfaceInteraction& surface,
                                  Vec3 ray, int world, int id)
{
    float alpha = min(opacity(scene.shapes, scene.materials, world, id), 1.0f);
    if constexpr (PathNeeds<FLAGS>::TEXTURED) {
        if constexpr (Types::has(TEXTURE_ALPHA))
            if (look.layout.image.levels > 0 && !look.layout.cube) {
                const Footprint at = texture_place<Types>(look, scene.meshes, surface, ray);
                alpha *= sample_alpha(scene.textures.texels.data, look.layout.image, at.u, at.v, at.right, at.down);
            }
        if constexpr (Types::has(ALPHA_TESTED) && PathNeeds<FLAGS>::MAPPED) {
            const int material = material_of(scene.shapes, scene.materials, world, id);
            const int texture = material < 0 ? -1 : texture_of(scene.materials, world, material, ROLE_OPACITY);
            if (is_texture(scene.textures, texture) && look.layout.own) {
                const Footprint at = texture_place<Types>(look, scene.meshes, surface, ray);
                alpha *= sample_2d(scene.textures.texels.data, load_image(scene.textures, texture), at.u, at.v,
                                   at.right, at.down)
                             .x;
            }
        }
    }
    return alpha;
}

// `hub`: upright() of the view's camera; `inside`: the ray ran in the shape.
template <class Types, int FLAGS, class Scene_>
WARPCAM_NOINLINE_CPU WARPCAM_INLINED void find_path_surface(const Scene_& scene, const Camera& hub, int world,
                                                            const PathRay& ray, const PathHit& hit,
                                                            const Float3Int* rows, bool inside, PathSurface& found)
{
    const auto look = load_appearance_for<Types, PathNeeds<FLAGS>>(scene, hub, world, hit.shape);
    const ShapeFromCamera& pose = look.pose;
    found.point = ray.point + hit.t * ray.direction;
    const Vec3 local = pose.local(found.point) + pose.eye();
    const Vec3 along = pose.local(inside ? -ray.direction : ray.direction);
    const SurfaceInteraction surface = surface_at<Types>(pose, scene.meshes, scene.fields, hit.face, local, along);
    found.outward = normalized(pose.seen(surface.normal));
    found.front = dot(found.outward, ray.direction) < 0.0f;
    Vec3 texture { 1.0f, 1.0f, 1.0f }, normal = smooth_normal<Types>(pose, scene.meshes, surface);
    if constexpr (PathNeeds<FLAGS>::TEXTURED)
        texture = srgb_to_linear(
            texture_color<Types, PINHOLE>(look, scene.meshes, scene.textures, hub, 0.0f, 0.0f, surface, along, 1.0f));
    found.material = surface_material<Types, PINHOLE, PathNeeds<FLAGS>::MAPPED>(
        look, scene.meshes, scene.textures, hub, 0.0f, 0.0f, surface, along, 1.0f, texture, normal);
    const Vec3 back = -ray.direction, facing = found.front ? found.outward : -found.outward;
    normal = normalized(pose.seen(normal));
    normal = found.front ? normal : -normal;
    found.normal = dot(normal, back) > 1.0e-3f ? normal : facing;
    found.alpha = path_opacity<Types, FLAGS>(look, scene, surface, along, world, hit.shape);
    const int index = material_of(scene.shapes, scene.materials, world, hit.shape);
    found.transmission = index < 0 ? 0.0f : saturate(per_world(scene.physical.transmission, world, index));
    const float radius = as_float(load(rows, PATH_SHAPE_ROWS * hit.slot).w);
    const Vec3 p = found.point;
    found.margin = 2.0e-6f * (abs(p.x) + abs(p.y) + abs(p.z) + (radius < MISS ? 2.0f * radius : 0.0f));
}

}  // namespace warpcam
