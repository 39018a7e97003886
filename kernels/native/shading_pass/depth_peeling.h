// Transparent surfaces of physically based scenes: each covers what lies behind it as far as it is opaque there, in
// linear light, the nearest first, whichever shape it is part of.
#pragma once
#include "shading/texture_mapping.h"
#include "texture/sample_alpha.h"
#include "shading_pass/mujoco_transparency.h"

namespace warpcam {

constexpr int MAX_PEELS = 16;              // surfaces that one ray can be seen through
constexpr float MIN_TRANSMITTANCE = 1.0f / 1024.0f;  // of what lies behind: too little to look for more
constexpr float NEXT = 1.00001f;            // depth of the next surface of a mesh, at the least, by that of the last

// Accumulated light of the layers so far, and the transmittance to what lies behind.
struct Composite {
    Vec3 light;
    float left;
};

// Adds the surfaces between `near` and `limit`, which is negative where a pixel takes no part. `column` and `row` are
// the tile's in the list's region. shade(met, hit, light) returns a surface's opacity and says what it sends; the whole
// warp comes there together, and those who have met nothing do not look at what they get.
template <class Types, class TransparentShapes_, class RayOf, class Scene_, class Shade>
WARPCAM_DEVICE void peel(const TransparentShapes_& transparent_shapes, const Scene_& scene, const RayOf& ray,
                         float near, float limit, int column, int row, const Shade& shade, Composite& peeled)
{
    float from = near;
#pragma unroll 1
    for (int layer = 0; layer < MAX_PEELS; ++layer) {
        Hit hit { limit, -1, -1 };
#if defined(__CUDA_ARCH__)
        for (int begin = 0; begin < transparent_shapes.count; begin += WARP_SIZE) {
            const int mine = begin + threadIdx.x % WARP_SIZE;
            const bool touched =
                mine < transparent_shapes.count && touches(transparent_shapes.touched[mine], column, row);
            for (unsigned mask = __ballot_sync(FULL_WARP, touched); mask; mask &= mask - 1)
                intersect_transparent<Types>(transparent_shapes.records[begin + ctz(mask)], ray, from, scene.meshes,
                                             scene.fields, hit);
        }
#else
        for (int slot = 0; slot < transparent_shapes.count; ++slot)
            if (touches(transparent_shapes.touched[slot], column, row))
                intersect_transparent<Types>(transparent_shapes.records[slot], ray, from, scene.meshes, scene.fields,
                                             hit);
#endif
        const bool met = hit.shape >= 0;
        if (!warp_any(met))
            break;
        Vec3 light { 0.0f, 0.0f, 0.0f };
        const float opacity = shade(met, hit, light);
        if (met) {
            peeled.light = peeled.light + (peeled.left * opacity) * light;
            peeled.left *= 1.0f - opacity;
        }
        from = hit.depth;
        if constexpr (Types::has_any(MESH, HEIGHT_FIELD)) {
            const int type = met ? wp::index(scene.shapes.types, hit.shape) : -1;
            if (type == MESH || type == HEIGHT_FIELD)  // not once more on the other side of an edge
                from *= NEXT;
        }
        limit = met && peeled.left > MIN_TRANSMITTANCE ? limit : -1.0f;
    }
}

// Texture coordinates of a hit on its shape's 2-D textures.
template <class Types, int LENS, class Appearances, class Scene_>
WARPCAM_DEVICE Footprint footprint_at(const Appearances& look, const Scene_& scene, const Camera& camera, float x,
                                      float y, const Hit& hit)
{
    const ShapeFromCamera& pose = look.pose;
    const Vec3 ray = pose.local(CameraRay<LENS> { x, y }.direction());
    Vec3 local = pose.eye() + (LENS == ORTHOGRAPHIC ? pose.local({ x, y, -hit.depth }) : hit.depth * ray);
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        local = local + pose.local(CameraRay<LENS> { x, y }.offset_ray().start);
    const SurfaceInteraction surface = surface_at<Types>(pose, scene.meshes, scene.fields, hit.face, local, ray);
    const Vec3 right = pose.local(step_right<LENS>(camera, x, y, hit.depth));
    const Vec3 down = pose.local(step_down<LENS>(camera, x, y, hit.depth));
    Footprint at = footprint_2d<Types>(pose, look.layout, scene.meshes, surface, ray, right, down);
    shift(look, at.u, at.v);
    return at;
}

// Opacity from a mesh's opacity map at a hit; 1 without a map.
template <class Types, int LENS, class Appearances, class Scene_>
WARPCAM_DEVICE float mapped_opacity(const Appearances& look, const Scene_& scene, const Camera& camera, int world,
                                    float x, float y, const Hit& hit)
{
    const int material = material_of(scene.shapes, scene.materials, world, hit.shape);
    const int texture = material < 0 ? -1 : texture_of(scene.materials, world, material, ROLE_OPACITY);
    if (!is_texture(scene.textures, texture) || !look.layout.own)
        return 1.0f;
    const Footprint at = footprint_at<Types, LENS>(look, scene, camera, x, y, hit);
    const Image image = load_image(scene.textures, texture);
    return sample_2d(scene.textures.texels.data, image, at.u, at.v, at.right, at.down).x;
}

// The alpha of its texture there; 1 where there is none.
template <class Types, int LENS, class Appearances, class Scene_>
WARPCAM_DEVICE float texture_alpha(const Appearances& look, const Scene_& scene, const Camera& camera, float x, float y,
                                   const Hit& hit)
{
    if (look.layout.image.levels <= 0 || look.layout.cube)
        return 1.0f;
    const Footprint at = footprint_at<Types, LENS>(look, scene, camera, x, y, hit);
    return sample_alpha(scene.textures.texels.data, look.layout.image, at.u, at.v, at.right, at.down);
}

}  // namespace warpcam
