// Shading of one pixel's visible surface.
#pragma once
#include "shading/plane_shading.h"
#include "output/hit_attributes.h"
#include "shading/texture_mapping.h"
#include "shading/pbr.h"
#include "camera/mirror_plane.h"
#include "shading/self_shadow.h"
#include "shading/fixed_function.h"
#include "texture/sampler.h"
#include "shading/world_overrides.h"

namespace warpcam {

// The structs of types.py that a pixel needs.
template <class Frame_, class Images_, class Shapes_, class Meshes_, class Fields_, class Materials_, class Textures_,
          class Background_>
struct Scene {
    const Frame_& frame;
    const Images_& images;
    const Shapes_& shapes;
    const Meshes_& meshes;
    const Fields_& fields;
    const Materials_& materials;
    const Textures_& textures;
    const Background_& background;
};
template <class... Structs> Scene(const Structs&...) -> Scene<Structs...>;

// Additional tables that shading/pbr.h reads.
template <class Scene_> WARPCAM_DEVICE None physical_of(const Scene_&) { return {}; }
template <class Scene_, class Physical_>
WARPCAM_DEVICE const Physical_& physical_of(const PhysicalScene<Scene_, Physical_>& scene)
{
    return scene.physical;
}

// Gives pixels without a hit that of another pixel of their warp, so that all its threads take the same branches; their
// results are not used. Returns false if the whole warp has no hit.
WARPCAM_DEVICE bool fill_inactive_lanes(bool hit, Hit& found)
{
#if defined(__CUDA_ARCH__)
    const unsigned hits = __ballot_sync(FULL_WARP, hit);
    if (hits != FULL_WARP && hits != 0u) {
        const int leader = ctz(hits);
        const int shape = __shfl_sync(FULL_WARP, found.shape, leader);
        const int face = __shfl_sync(FULL_WARP, found.face, leader);
        const float depth = __shfl_sync(FULL_WARP, found.depth, leader);
        if (!hit)
            found = { depth, shape, face };
    }
    return hits != 0u;
#else
    return hit;
#endif
}

// The texture's colour at a place of a 2-D one.
template <class Appearances, class Textures>
WARPCAM_DEVICE Vec3 sample_at(const Appearances& look, const Textures& textures, Footprint at)
{
    const TextureLayout& layout = look.layout;
    shift(look, at.u, at.v);
#if defined(__CUDA_ARCH__)
    if (Appearances::USE_ATLAS && layout.atlas)
        return sample_2d_atlas(layout.atlas, layout.image, at.u, at.v, at.right, at.down);
#endif
    return sample_2d(textures.texels.data, layout.image, at.u, at.v, at.right, at.down);
}

// The texture's colour at a hit; white where there is none.
template <class Types, int LENS, class Appearances, class Meshes, class Textures>
WARPCAM_DEVICE Vec3 texture_color(const Appearances& look, const Meshes& meshes, const Textures& textures,
                                  const Camera& camera, float x, float y, const SurfaceInteraction& surface, Vec3 ray,
                                  float depth)
{
    const TextureLayout& layout = look.layout;
    if (layout.image.levels <= 0)
        return { 1.0f, 1.0f, 1.0f };
    const ShapeFromCamera& pose = look.pose;
    const float stretch = LENS == PINHOLE ? depth : 1.0f;
    Vec3 right = has_table(LENS) ? pose.local(step_right<LENS>(camera, x, y, depth))
                                 : stretch * camera.scale_x * Vec3 { pose.axis_x.x, pose.axis_y.x, pose.axis_z.x };
    Vec3 down = has_table(LENS) ? pose.local(step_down<LENS>(camera, x, y, depth))
                                : -stretch * camera.scale_y * Vec3 { pose.axis_x.y, pose.axis_y.y, pose.axis_z.y };
    if (layout.cube) {
        const CubeMapping mapping = map_cube<Types>(pose, layout, surface);
        const Vec3 to_right = mul(mapping.scale, slide(right, ray, surface.normal));
        const Vec3 to_below = mul(mapping.scale, slide(down, ray, surface.normal));
#if defined(__CUDA_ARCH__)
        if (Appearances::USE_ATLAS && layout.atlas)
            return sample_cube_atlas(layout.atlas, layout.image, mapping.direction, to_right, to_below);
#endif
        return sample_cube(textures.texels.data, layout.image, mapping.direction, to_right, to_below);
    }
    if constexpr (Types::has(TRIPLANAR)) {
        if (is_blended<Types>(pose, layout)) {
            const Vec3 share = shares_of(smooth_normal<Types>(pose, meshes, surface));
            right = slide(right, ray, surface.normal);
            down = slide(down, ray, surface.normal);
            Vec3 sum { 0.0f, 0.0f, 0.0f };
            for (int axis = 0; axis < 3; ++axis) {
                Mapping mapping;
                map_along(axis, layout, surface.local, mapping);
                const Footprint at = footprint_of(mapping, right, down);
                sum = sum + component(share, axis) * sample_at(look, textures, at);
            }
            return sum;
        }
    }
    return sample_at(look, textures, footprint_2d<Types>(pose, layout, meshes, surface, ray, right, down));
}

// Shaded colour of a surface.
struct ShadedPixel {
    Vec3 normal;
    Vec3 albedo, linear, display;
};

// `shadow`: of physically based scenes a Visibility, else bits of lights that do not reach it.
template <class Types, int LENS, int IMAGES, int FLAGS, class Appearances, class List, class Scene_, class Shadow>
WARPCAM_DEVICE void resolve_surface(const Appearances& look, const List& lights, const Scene_& scene,
                                    const Camera& camera, float x, float y, const Hit& found, Shadow shadow,
                                    ShadedPixel& shown)
{
    using Wants = ShadingNeeds<IMAGES, FLAGS>;
    const float depth = found.depth;
    SurfaceInteraction surface;
    Vec3 place, ray;  // in the camera's frame; in the shape's
    if constexpr (Wants::SURFACE) {
        const ShapeFromCamera& pose = look.pose;
        const Vec3 local = locate_hit<LENS>(pose, x, y, depth, place, ray);
        surface = surface_at<Types>(pose, scene.meshes, scene.fields, found.face, local, ray);
    }
    if constexpr (Wants::WORLD_NORMALS) {
        if constexpr (Types::has(LIT_NORMALS))
            shown.normal = look.turn.world(smooth_normal<Types>(look.pose, scene.meshes, surface));
        else
            shown.normal = look.turn.world(surface.normal);
        if (dot(surface.normal, ray) > 0.0f)
            shown.normal = -shown.normal;
    }
    Vec3 texture { 1.0f, 1.0f, 1.0f };
    if constexpr (Wants::TEXTURED)
        texture = texture_color<Types, LENS>(look, scene.meshes, scene.textures, camera, x, y, surface, ray, depth);
    if constexpr (Wants::PBR)
        texture = srgb_to_linear(texture);
    if constexpr ((IMAGES & ALBEDO) != 0) {
        shown.albedo = mul(clip(as_vec3(look.material.color)), texture);
        if constexpr (Wants::PBR)
            shown.albedo = linear_to_srgb(shown.albedo);
    }
    if constexpr (Wants::LIT && Wants::PBR) {
        shown.linear = shade_physically<Types, LENS, FLAGS>(look, lights, scene, camera, x, y, surface, place, ray,
                                                            depth, texture, shadow);
        shown.display = display_color<FLAGS>(shown.linear);
    } else if constexpr (Wants::LIT) {
        constexpr bool SHADOWS = FLAGS & HAS_SHADOWS;
        // else draw_floor() did, or left this pixel out
        constexpr bool BY_CORNERS =
            lit_by_corners<List>(SHADOWS) && (!(FLAGS & SEPARATE_PLANE_PATH) || (IMAGES & (NORMALS | ALBEDO)));
        if constexpr (SHADOWS && (Types::GEOMETRY & SHADES_ITSELF))
            if (lights.dims && (SHADES_ITSELF >> look.pose.type() & 1))
                shadow |= own_shadow(lights, camera, place, look.pose.seen(surface.normal));
        GridInterpolation on;
        on.inside = false;
        if constexpr (BY_CORNERS) {
            on.inside = found.shape == lights.grid.shape;
            if (warp_any(on.inside))
                on = on_corners(lights.grid, surface.local, on.inside);
        }
        LitColor lit;
        if (warp_any(!on.inside)) {
            GouraudTriangle gouraud;
            gouraud_at<Types>(look, scene.meshes, surface, place, gouraud, !on.inside);
            const bool three = Types::has_any(PLANE, HEIGHT_FIELD, BOX, MESH) && warp_any(gouraud.three);
            const auto lit_from = [&](auto... eye) {
                return three ? light_vertices<3, SHADOWS>(lights, gouraud, look.material, shadow, eye...)
                             : light_vertices<1, SHADOWS>(lights, gouraud, look.material, shadow, eye...);
            };
            if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
                lit = lit_from(CameraRay<LENS> { x, y }.offset_ray().start);
            else
                lit = lit_from();
        }
        if constexpr (BY_CORNERS)
            if (warp_any(on.inside)) {
                const Vec3 light = light_from_corners(lights.grid, on, shadow);
                Vec3& own = IMAGES & HDR ? lit.linear : lit.display;  // corners keep either
                own = on.inside ? light : own;
            }
        shown.linear = mul(lit.linear, texture);
        shown.display = mul(lit.display, texture);
    }
}

}  // namespace warpcam
