// Texture coordinates of a surface point, as MuJoCo maps textures; if PROJECTED, as the camera of Newton does.
//
// A mapping gives the place and its gradient over the shape's frame; the gradient turns the step to the next pixel into
// a step on the texture. Measured against `mujoco.Renderer` 3.17 with a texture that shows its own coordinates. Up to
// 3.11 it lays a 2-D texture on all shapes from above, but for meshes with coordinates of their own, where it does not
// repeat: TEXTURE_FROM_ABOVE.
#pragma once
#include "shading/appearance.h"

namespace warpcam {

constexpr float TWO_PI = 6.283185307179586f;

// A place on a 2-D texture, in images: (0, 0) is the top left corner, (1, 1) the bottom right.
struct Mapping {
    float u, v;
    Vec3 du, dv;  // gradients over the shape's frame [1/m]
};

// A direction into a cube texture.
struct CubeMapping {
    Vec3 direction;
    Vec3 scale;  // change of `direction` with the place in the shape's frame, axis by axis [1/m]
};

// Maps u once around the z axis from +x and v to `top` - elevation * `scale`, on an ellipsoid of half axes `half`; with
// a scale of 0 v runs along the axis, from `half.z` to its mirror image.
WARPCAM_DEVICE void map_round(const TextureProjection& projection, Mapping& mapping)
{
    const Vec3 half = projection.half;
    const float top = projection.top, scale = projection.scale;
    const Vec3 rate { rcp(half.x), rcp(half.y), rcp(half.z) }, unit = mul(projection.place, rate);
    const float square = unit.x * unit.x + unit.y * unit.y;
    const float turn = wp::atan2(unit.y, unit.x) * (1.0f / TWO_PI);
    mapping.u = turn < 0.0f ? turn + 1.0f : turn;
    const float rate_u = rcp(max(square, 1.0e-12f) * TWO_PI);
    mapping.du = { -unit.y * rate_u * rate.x, unit.x * rate_u * rate.y, 0.0f };
    mapping.v = top - 0.5f * unit.z;
    mapping.dv = { 0.0f, 0.0f, -0.5f * rate.z };
    if (scale > 0.0f) {
        const float flat = max(sqrt(square), 1.0e-6f), slope = -unit.z * rcp(flat);
        mapping.v = top - wp::atan2(unit.z, flat) * scale;
        mapping.dv = -scale * rcp(dot(unit, unit)) * mul(rate, { slope * unit.x, slope * unit.y, flat });
    }
}

// Maps u and v over a rectangle.
WARPCAM_DEVICE void map_flat(const TextureProjection& projection, Mapping& mapping)
{
    const Vec3 local = projection.place, half = projection.half;
    const int u_axis = projection.u_axis, v_axis = projection.v_axis;
    const float rate_u = 0.5f * rcp(component(half, u_axis)), rate_v = 0.5f * rcp(component(half, v_axis));
    mapping.u = 0.5f + component(local, u_axis) * rate_u;
    mapping.v = 0.5f - component(local, v_axis) * rate_v;
    mapping.du = axis_vector(u_axis, rate_u);
    mapping.dv = axis_vector(v_axis, -rate_v);
    if (projection.mirrored) {
        mapping.v = 1.0f - mapping.v;
        mapping.dv = -mapping.dv;
    }
}

// The image laid on from above, for shapes without texture coordinates of their own.
WARPCAM_DEVICE void map_from_above(Vec3 local, Vec3 half, Mapping& mapping)
{
    mapping.du = { 0.5f * rcp(max(half.x, 1.0e-12f)), 0.0f, 0.0f };
    mapping.dv = { 0.0f, -0.5f * rcp(max(half.y, 1.0e-12f)), 0.0f };
    mapping.u = mapping.du.x * local.x;
    mapping.v = mapping.dv.y * local.y;
}

// One image a metre along an axis, v upwards.
WARPCAM_DEVICE void map_along(int axis, const TextureLayout& layout, Vec3 local, Mapping& mapping)
{
    const int u_axis = axis == 0 ? 1 : 0, v_axis = axis == 2 ? 1 : 2;
    mapping.u = component(local, u_axis) * layout.repeat[0];
    mapping.v = 1.0f - component(local, v_axis) * layout.repeat[1];
    mapping.du = axis_vector(u_axis, layout.repeat[0]);
    mapping.dv = axis_vector(v_axis, -layout.repeat[1]);
}

// The axis that a surface faces most.
WARPCAM_DEVICE int faced_axis(Vec3 normal)
{
    const float x = abs(normal.x), y = abs(normal.y), z = abs(normal.z);
    return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

// A mesh's own texture coordinates.
template <class Meshes>
WARPCAM_DEVICE void map_by_corners(const Meshes& meshes, const SurfaceInteraction& surface, Mapping& mapping)
{
    const auto start = wp::index(meshes.uvs, surface.corner);
    const auto second = wp::index(meshes.uvs, surface.corner + 1), third = wp::index(meshes.uvs, surface.corner + 2);
    const float u1 = second[0] - start[0], v1 = second[1] - start[1];
    const float u2 = third[0] - start[0], v2 = third[1] - start[1];
    mapping.u = start[0] + surface.weight1 * u1 + surface.weight2 * u2;
    mapping.v = 1.0f - (start[1] + surface.weight1 * v1 + surface.weight2 * v2);
    const Triangle& triangle = surface.triangle;
    const Vec3 normal = cross(triangle.edge1, triangle.edge2);
    const float rate = rcp(max(dot(normal, normal), MIN_NORMAL));
    // Gradients of the barycentric weights.
    const Vec3 weight1 = rate * cross(triangle.edge2, normal), weight2 = rate * cross(normal, triangle.edge1);
    mapping.du = u1 * weight1 + u2 * weight2;
    mapping.dv = -(v1 * weight1 + v2 * weight2);
}

WARPCAM_DEVICE void repeat(const TextureLayout& layout, float offset, Mapping& mapping)
{
    mapping.u = mapping.u * layout.repeat[0] + offset;
    mapping.v = mapping.v * layout.repeat[1] + offset;
    mapping.du = layout.repeat[0] * mapping.du;
    mapping.dv = layout.repeat[1] * mapping.dv;
}

// Not of planes.
template <class Types, class Meshes> WARPCAM_DEVICE Mapping map_2d(const ShapeFromCamera& pose,
                                                                   const TextureLayout& layout, const Meshes& meshes,
                                                                   const SurfaceInteraction& surface)
{
    const int type = pose.type(), part = surface.part;
    const Vec3 half = as_vec3(layout.extent), local = surface.local;
    Mapping mapping { 0.0f, 0.0f, { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    float offset = 0.0f;
    const bool own = Types::has(MESH) && type == MESH && layout.own;
    if constexpr (Types::has(TEXTURE_FROM_ABOVE)) {
        if (own) {
            map_by_corners(meshes, surface, mapping);
        } else {
            map_from_above(local, half, mapping);
            repeat(layout, -0.5f, mapping);
        }
        return mapping;
    }
    if constexpr (Types::has(PROJECTED)) {
        if (own) {
            map_by_corners(meshes, surface, mapping);
            repeat(layout, 0.0f, mapping);
        } else {
            map_along(faced_axis(smooth_normal<Types>(pose, meshes, surface)), layout, local, mapping);
        }
        return mapping;
    }
    if constexpr ((Types::ANALYTIC & ~(1 << PLANE)) != 0) {
        if (type != HEIGHT_FIELD && type != MESH) {
            TextureProjection projection {};
            visit_shape<Types::ANALYTIC & ~(1 << PLANE)>(
                type, [&](auto shape) { projection = shape.projection(local, half, part); });
            if (projection.flat)
                map_flat(projection, mapping);
            else
                map_round(projection, mapping);
        }
    }
    if (own)
        map_by_corners(meshes, surface, mapping);
    if (Types::has_any(MESH, HEIGHT_FIELD) && (type == HEIGHT_FIELD || (type == MESH && !own))) {
        map_from_above(local, half, mapping);
        offset = -0.5f;
    }
    repeat(layout, offset, mapping);
    return mapping;
}

// A place on a 2-D texture, and the steps from there to the next pixel on the right and to the next below.
struct Footprint {
    float u, v;
    Float2 right, down;
};

// `step` carried along `ray` into the plane of `normal`: how far the hit moves from pixel to pixel.
WARPCAM_DEVICE Vec3 slide(Vec3 step, Vec3 ray, Vec3 normal)
{
    const float slope = dot(normal, ray);
    if (slope * slope < 1.0e-24f * dot(ray, ray))
        return 1.0e6f * step;
    return step - dot(normal, step) * rcp(slope) * ray;
}

// `right` and `down` are steps of the hit, in the shape's frame.
WARPCAM_DEVICE Footprint footprint_of(const Mapping& mapping, Vec3 right, Vec3 down)
{
    return { mapping.u,
             mapping.v,
             { dot(mapping.du, right), dot(mapping.dv, right) },
             { dot(mapping.du, down), dot(mapping.dv, down) } };
}

// `right` and `down` are the changes of the ray at the depth of the hit, from pixel to pixel; all in the shape's frame.
template <class Types, class Meshes>
WARPCAM_DEVICE Footprint footprint_2d(const ShapeFromCamera& pose, const TextureLayout& layout, const Meshes& meshes,
                                      const SurfaceInteraction& surface, Vec3 ray, Vec3 right, Vec3 down)
{
    if (Types::has(PLANE) && pose.type() == PLANE) {  // floors fill images
        const float rate_u = layout.repeat[0], rate_v = layout.repeat[1], slope = rcp(ray.z);
        const float rise_right = right.z * slope, rise_down = down.z * slope;
        return { surface.local.x * rate_u + layout.start[0],
                 surface.local.y * rate_v + layout.start[1],
                 { rate_u * (right.x - rise_right * ray.x), rate_v * (right.y - rise_right * ray.y) },
                 { rate_u * (down.x - rise_down * ray.x), rate_v * (down.y - rise_down * ray.y) } };
    }
    return footprint_of(map_2d<Types>(pose, layout, meshes, surface), slide(right, ray, surface.normal),
                        slide(down, ray, surface.normal));
}

// Weights of three images, projected along the three axes, if TRIPLANAR.
WARPCAM_DEVICE Vec3 shares_of(Vec3 normal)
{
    const Vec3 share { abs(normal.x), abs(normal.y), abs(normal.z) };
    return rcp(max(share.x + share.y + share.z, MIN_NORMAL)) * share;
}

template <class Types> WARPCAM_DEVICE bool is_blended(const ShapeFromCamera& pose, const TextureLayout& layout)
{
    return (Types::has(TRIPLANAR)) && pose.type() != PLANE && !layout.own;
}

template <class Types> WARPCAM_DEVICE CubeMapping map_cube(const ShapeFromCamera& pose, const TextureLayout& layout,
                                                           const SurfaceInteraction& surface)
{
    const int type = pose.type();
    const Vec3 half = as_vec3(layout.extent);
    Vec3 place = surface.local, scale { 1.0f, 1.0f, 1.0f };  // planes, height fields and meshes: metres
    if (type != PLANE && type != HEIGHT_FIELD && type != MESH)
        scale = { rcp(half.x), rcp(half.y), rcp(half.z) };
    visit_shape<Types::GEOMETRY>(type, [&](auto shape) { shape.fit_cube(half, surface.part, place, scale); });
    if (layout.extent.w)
        scale = mul(scale, half);
    return { mul(place, scale), scale };
}

}  // namespace warpcam
