// Where a point of a surface lies on its texture, as MuJoCo maps it; where PROJECTED as Newton's camera does.
//
// A mapping gives the place and its gradient over the shape's frame; the gradient turns the step to the next pixel into
// a step on the texture. Measured against `mujoco.Renderer` 3.17 with a texture that shows its own coordinates. Up to
// 3.11 it lays a 2-D texture on all shapes from above, but for meshes with coordinates of their own, where it does not
// repeat: FROM_ABOVE.
#pragma once
#include "shading/appearance.h"

namespace warpcam {

constexpr float TURN = 6.283185307179586f;

// A place on a 2-D texture, in images: (0, 0) is the top left corner, (1, 1) the bottom right.
struct Mapping {
    float u, v;
    Vec du, dv;  // gradients over the shape's frame [1/m]
};

// A direction into a cube texture.
struct CubeMapping {
    Vec direction;
    Vec scale;  // change of `direction` with the place in the shape's frame, axis by axis [1/m]
};

// Maps u once around the z axis from +x and v to `top` - elevation * `scale`, on an ellipsoid of half axes `half`; with
// a scale of 0 v runs along the axis, from `half.z` to its mirror image.
WARPCAM_FN void map_round(Vec q, Vec half, float top, float scale, Mapping& mapping)
{
    const Vec rate { reciprocal(half.x), reciprocal(half.y), reciprocal(half.z) }, unit = times(q, rate);
    const float square = unit.x * unit.x + unit.y * unit.y;
    const float turn = wp::atan2(unit.y, unit.x) * (1.0f / TURN);
    mapping.u = turn < 0.0f ? turn + 1.0f : turn;
    const float rate_u = reciprocal(upper(square, 1.0e-12f) * TURN);
    mapping.du = { -unit.y * rate_u * rate.x, unit.x * rate_u * rate.y, 0.0f };
    mapping.v = top - 0.5f * unit.z;
    mapping.dv = { 0.0f, 0.0f, -0.5f * rate.z };
    if (scale > 0.0f) {
        const float flat = upper(root(square), 1.0e-6f), slope = -unit.z * reciprocal(flat);
        mapping.v = top - wp::atan2(unit.z, flat) * scale;
        mapping.dv = -scale * reciprocal(dot(unit, unit)) * times(rate, { slope * unit.x, slope * unit.y, flat });
    }
}

// Maps u and v over a rectangle.
WARPCAM_FN void map_flat(Vec local, Vec half, int u_axis, int v_axis, Mapping& mapping)
{
    const float rate_u = 0.5f * reciprocal(component(half, u_axis)),
                rate_v = 0.5f * reciprocal(component(half, v_axis));
    mapping.u = 0.5f + component(local, u_axis) * rate_u;
    mapping.v = 0.5f - component(local, v_axis) * rate_v;
    mapping.du = axis_vector(u_axis, rate_u);
    mapping.dv = axis_vector(v_axis, -rate_v);
}

// The image laid on from above, for shapes without texture coordinates of their own.
WARPCAM_FN void map_from_above(Vec local, Vec half, Mapping& mapping)
{
    mapping.du = { 0.5f * reciprocal(upper(half.x, 1.0e-12f)), 0.0f, 0.0f };
    mapping.dv = { 0.0f, -0.5f * reciprocal(upper(half.y, 1.0e-12f)), 0.0f };
    mapping.u = mapping.du.x * local.x;
    mapping.v = mapping.dv.y * local.y;
}

// One image a metre along an axis, v upwards.
WARPCAM_FN void map_along(int axis, const Layout& layout, Vec local, Mapping& mapping)
{
    const int u_axis = axis == 0 ? 1 : 0, v_axis = axis == 2 ? 1 : 2;
    mapping.u = component(local, u_axis) * layout.repeat[0];
    mapping.v = 1.0f - component(local, v_axis) * layout.repeat[1];
    mapping.du = axis_vector(u_axis, layout.repeat[0]);
    mapping.dv = axis_vector(v_axis, -layout.repeat[1]);
}

// The axis that a surface faces most.
WARPCAM_FN int faced_axis(Vec normal)
{
    const float x = magnitude(normal.x), y = magnitude(normal.y), z = magnitude(normal.z);
    return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

// A mesh's own texture coordinates.
template <class Meshes>
WARPCAM_FN void map_by_corners(const Meshes& meshes, const Surface& surface, Mapping& mapping)
{
    const auto start = wp::index(meshes.uvs, surface.corner);
    const auto second = wp::index(meshes.uvs, surface.corner + 1), third = wp::index(meshes.uvs, surface.corner + 2);
    const float u1 = second[0] - start[0], v1 = second[1] - start[1];
    const float u2 = third[0] - start[0], v2 = third[1] - start[1];
    mapping.u = start[0] + surface.weight1 * u1 + surface.weight2 * u2;
    mapping.v = 1.0f - (start[1] + surface.weight1 * v1 + surface.weight2 * v2);
    const Triangle& triangle = surface.triangle;
    const Vec normal = cross(triangle.edge1, triangle.edge2);
    const float rate = reciprocal(upper(dot(normal, normal), TINY));
    // Gradients of the barycentric weights.
    const Vec weight1 = rate * cross(triangle.edge2, normal), weight2 = rate * cross(normal, triangle.edge1);
    mapping.du = u1 * weight1 + u2 * weight2;
    mapping.dv = -(v1 * weight1 + v2 * weight2);
}

WARPCAM_FN void repeat(const Layout& layout, float offset, Mapping& mapping)
{
    mapping.u = mapping.u * layout.repeat[0] + offset;
    mapping.v = mapping.v * layout.repeat[1] + offset;
    mapping.du = layout.repeat[0] * mapping.du;
    mapping.dv = layout.repeat[1] * mapping.dv;
}

// Not of planes.
template <int TYPES, class Meshes>
WARPCAM_FN Mapping map_2d(const Pose& pose, const Layout& layout, const Meshes& meshes, const Surface& surface)
{
    const int type = pose.type(), part = surface.part;
    const Vec half = to_vec(layout.extent), local = surface.local;
    Mapping mapping { 0.0f, 0.0f, { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    float offset = 0.0f;
    const bool own = (TYPES >> MESH & 1) && type == MESH && layout.own;
    if constexpr ((TYPES >> FROM_ABOVE & 1) != 0) {
        if (own) {
            map_by_corners(meshes, surface, mapping);
        } else {
            map_from_above(local, half, mapping);
            repeat(layout, -0.5f, mapping);
        }
        return mapping;
    }
    if constexpr ((TYPES >> PROJECTED & 1) != 0) {
        if (own) {
            map_by_corners(meshes, surface, mapping);
            repeat(layout, 0.0f, mapping);
        } else {
            map_along(faced_axis(smooth_normal<TYPES>(pose, meshes, surface)), layout, local, mapping);
        }
        return mapping;
    }
    if ((TYPES >> BOX & 1) && type == BOX)
        map_flat(local, half, part == 0 ? 1 : 0, part == 2 ? 1 : 2, mapping);
    const bool round = (TYPES & (1 << CYLINDER | 1 << CONE | 1 << BARREL))
        && (type == CYLINDER || ((TYPES & (1 << CONE | 1 << BARREL)) && (type == CONE || type == BARREL)));
    if (round && part != SIDE) {
        map_flat(local, half, 0, 1, mapping);
        mapping.v = 1.0f - mapping.v;
        mapping.dv = -mapping.dv;
    } else if ((TYPES & (1 << SPHERE | 1 << ELLIPSOID | 1 << CAPSULE | 1 << CYLINDER | 1 << CONE | 1 << BARREL))
               && ((type >= SPHERE && type <= CYLINDER) || round)) {
        Vec ball = local, radii = half;
        float top = 0.5f, scale = 2.0f / TURN;
        if (type == CAPSULE || round) {
            scale = 0.0f;
            if (part != SIDE) {  // each cap has the image's top or bottom half to itself
                ball.z -= part == TOP ? half.z : -half.z;
                radii.z = half.x;
                top = part == TOP ? 1.0f : 0.0f;
                scale = 4.0f / TURN;
            }
        }
        map_round(ball, radii, top, scale, mapping);
    }
    if (own)
        map_by_corners(meshes, surface, mapping);
    if ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) && (type == HEIGHT_FIELD || (type == MESH && !own))) {
        map_from_above(local, half, mapping);
        offset = -0.5f;
    }
    repeat(layout, offset, mapping);
    return mapping;
}

// A place on a 2-D texture, and the steps from there to the next pixel on the right and to the next below.
struct Footprint {
    float u, v;
    Pair right, down;
};

// `step` carried along `ray` into the plane of `normal`: how far the hit moves from pixel to pixel.
WARPCAM_FN Vec slide(Vec step, Vec ray, Vec normal)
{
    const float slope = dot(normal, ray);
    if (slope * slope < 1.0e-24f * dot(ray, ray))
        return 1.0e6f * step;
    return step - dot(normal, step) * reciprocal(slope) * ray;
}

// `right` and `down` are steps of the hit, in the shape's frame.
WARPCAM_FN Footprint footprint_of(const Mapping& mapping, Vec right, Vec down)
{
    return { mapping.u, mapping.v, { dot(mapping.du, right), dot(mapping.dv, right) },
             { dot(mapping.du, down), dot(mapping.dv, down) } };
}

// `right` and `down` are the changes of the ray at the depth of the hit, from pixel to pixel; all in the shape's frame.
template <int TYPES, class Meshes>
WARPCAM_FN Footprint footprint_2d(const Pose& pose, const Layout& layout, const Meshes& meshes, const Surface& surface,
                                  Vec ray, Vec right, Vec down)
{
    if ((TYPES >> PLANE & 1) && pose.type() == PLANE) {  // floors fill images
        const float rate_u = layout.repeat[0], rate_v = layout.repeat[1], slope = reciprocal(ray.z);
        const float rise_right = right.z * slope, rise_down = down.z * slope;
        return { surface.local.x * rate_u + layout.start[0],
                 surface.local.y * rate_v + layout.start[1],
                 { rate_u * (right.x - rise_right * ray.x), rate_v * (right.y - rise_right * ray.y) },
                 { rate_u * (down.x - rise_down * ray.x), rate_v * (down.y - rise_down * ray.y) } };
    }
    return footprint_of(map_2d<TYPES>(pose, layout, meshes, surface), slide(right, ray, surface.normal),
                        slide(down, ray, surface.normal));
}

// How much of each of three images, laid along the three axes, a surface shows where TRIPLANAR.
WARPCAM_FN Vec shares_of(Vec normal)
{
    const Vec share { magnitude(normal.x), magnitude(normal.y), magnitude(normal.z) };
    return reciprocal(upper(share.x + share.y + share.z, TINY)) * share;
}

template <int TYPES> WARPCAM_FN bool is_blended(const Pose& pose, const Layout& layout)
{
    return (TYPES >> TRIPLANAR & 1) && pose.type() != PLANE && !layout.own;
}

template <int TYPES>
WARPCAM_FN CubeMapping map_cube(const Pose& pose, const Layout& layout, const Surface& surface)
{
    const int type = pose.type();
    const Vec half = to_vec(layout.extent);
    Vec place = surface.local, scale { 1.0f, 1.0f, 1.0f };  // planes, height fields and meshes: metres
    if (type != PLANE && type != HEIGHT_FIELD && type != MESH)
        scale = { reciprocal(half.x), reciprocal(half.y), reciprocal(half.z) };
    if ((TYPES >> CAPSULE & 1) && type == CAPSULE && surface.part != SIDE) {
        // Each cap is a unit sphere whose middle is one above or below the origin.
        scale = { scale.x, scale.x, scale.x };
        place.z += (surface.part == BOTTOM ? -1.0f : 1.0f) * (half.x - half.z);
    }
    if (layout.extent.w)
        scale = times(scale, half);
    return { times(place, scale), scale };
}

}  // namespace warpcam
