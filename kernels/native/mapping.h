// Where a point of a surface lies on its texture, as MuJoCo maps it.
//
// A mapping gives the place and its gradient over the shape's frame; the gradient turns the step to the next pixel into
// a step on the texture. Measured against `mujoco.Renderer` 3.17 with a texture that shows its own coordinates.
#pragma once
#include "look.h"

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

// Maps u once around the z axis from +x, for a cross section of the given half axes.
WARPCAM_FN void map_around(float x, float y, float radius_x, float radius_y, Mapping& mapping)
{
    const float rate_x = inverse(radius_x), rate_y = inverse(radius_y), a = x * rate_x, b = y * rate_y;
    const float turn = wp::atan2(b, a) * (1.0f / TURN);
    mapping.u = turn < 0.0f ? turn + 1.0f : turn;
    const float rate = inverse(upper(a * a + b * b, 1.0e-12f) * TURN);
    mapping.du = { -b * rate * rate_x, a * rate * rate_y, 0.0f };
}

// Maps u around the z axis and v to `top` - elevation * `scale`, on an ellipsoid of half axes `half`.
WARPCAM_FN void map_globe(Vec q, Vec half, float top, float scale, Mapping& mapping)
{
    map_around(q.x, q.y, half.x, half.y, mapping);
    const Vec rate { inverse(half.x), inverse(half.y), inverse(half.z) }, unit = times(q, rate);
    const float flat = upper(root(unit.x * unit.x + unit.y * unit.y), 1.0e-6f);
    mapping.v = top - wp::atan2(unit.z, flat) * scale;
    const float slope = -unit.z * inverse(flat);
    mapping.dv = -scale * inverse(dot(unit, unit)) * times(rate, { slope * unit.x, slope * unit.y, flat });
}

// Maps u and v over a rectangle; an axis of size 0 is endless, two metres an image.
WARPCAM_FN void map_flat(Vec local, Vec half, int u_axis, int v_axis, Mapping& mapping)
{
    const float half_u = component(half, u_axis), half_v = component(half, v_axis);
    const float rate_u = half_u > 0.0f ? 0.5f * inverse(half_u) : 0.5f;
    const float rate_v = half_v > 0.0f ? 0.5f * inverse(half_v) : 0.5f;
    mapping.u = (half_u > 0.0f ? 0.5f : 0.0f) + component(local, u_axis) * rate_u;
    mapping.v = (half_v > 0.0f ? 0.5f : 0.0f) - component(local, v_axis) * rate_v;
    mapping.du = axis_vector(u_axis, rate_u);
    mapping.dv = axis_vector(v_axis, -rate_v);
}

// The image laid on from above, for shapes without texture coordinates of their own.
WARPCAM_FN void map_from_above(Vec local, Vec half, Mapping& mapping)
{
    mapping.du = { 0.5f * inverse(upper(half.x, 1.0e-12f)), 0.0f, 0.0f };
    mapping.dv = { 0.0f, -0.5f * inverse(upper(half.y, 1.0e-12f)), 0.0f };
    mapping.u = mapping.du.x * local.x;
    mapping.v = mapping.dv.y * local.y;
}

// A mesh's own texture coordinates.
template <class Meshes>
WARPCAM_FN void map_by_corners(const Meshes& meshes, const Surface& surface, const Triangle& triangle, Mapping& mapping)
{
    const auto start = wp::index(meshes.uvs, surface.corner);
    const auto second = wp::index(meshes.uvs, surface.corner + 1), third = wp::index(meshes.uvs, surface.corner + 2);
    const float u1 = second[0] - start[0], v1 = second[1] - start[1];
    const float u2 = third[0] - start[0], v2 = third[1] - start[1];
    mapping.u = start[0] + surface.weight1 * u1 + surface.weight2 * u2;
    mapping.v = 1.0f - (start[1] + surface.weight1 * v1 + surface.weight2 * v2);
    const Vec normal = cross(triangle.edge1, triangle.edge2);
    const float rate = inverse(upper(dot(normal, normal), TINY));
    // Gradients of the barycentric weights.
    const Vec weight1 = rate * cross(triangle.edge2, normal), weight2 = rate * cross(normal, triangle.edge1);
    mapping.du = u1 * weight1 + u2 * weight2;
    mapping.dv = -(v1 * weight1 + v2 * weight2);
}

template <int TYPES, class Meshes>
WARPCAM_FN Mapping map_2d(const Pose& pose, const Layout& layout, const Meshes& meshes, const Surface& surface,
                          const Triangle& triangle)
{
    const int type = pose.type(), part = surface.part;
    const Vec half = to_vec(layout.extent), local = surface.local;
    Mapping mapping { 0.0f, 0.0f, { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    float offset = 0.0f;
    if ((TYPES >> PLANE & 1) && type == PLANE) {
        map_flat(local, half, 0, 1, mapping);
        offset = half.x <= 0.0f || half.y <= 0.0f ? -0.5f : 0.0f;
    }
    if ((TYPES >> BOX & 1) && type == BOX)
        map_flat(local, half, part == 0 ? 1 : 0, part == 2 ? 1 : 2, mapping);
    if ((TYPES & (1 << SPHERE | 1 << ELLIPSOID)) && (type == SPHERE || type == ELLIPSOID))
        map_globe(local, half, 0.5f, 2.0f / TURN, mapping);
    if ((TYPES & (1 << CAPSULE | 1 << CYLINDER)) && (type == CAPSULE || type == CYLINDER)) {
        if (part == SIDE) {
            map_around(local.x, local.y, half.x, half.x, mapping);
            const float rate = 0.5f * inverse(half.z);  // from the top to the bottom
            mapping.v = 0.5f - local.z * rate;
            mapping.dv = { 0.0f, 0.0f, -rate };
        } else if (type == CAPSULE) {
            const float middle = part == TOP ? half.z : -half.z;
            map_globe({ local.x, local.y, local.z - middle }, { half.x, half.x, half.x }, part == TOP ? 1.0f : 0.0f,
                      4.0f / TURN, mapping);
        } else {
            map_flat(local, half, 0, 1, mapping);
            mapping.v = 1.0f - mapping.v;
            mapping.dv = -mapping.dv;
        }
    }
    const bool own = (TYPES >> MESH & 1) && type == MESH && layout.own;
    if (own)
        map_by_corners(meshes, surface, triangle, mapping);
    if ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) && (type == HEIGHT_FIELD || (type == MESH && !own))) {
        map_from_above(local, half, mapping);
        offset = -0.5f;
    }
    mapping.u = mapping.u * layout.repeat[0] + offset;
    mapping.v = mapping.v * layout.repeat[1] + offset;
    mapping.du = layout.repeat[0] * mapping.du;
    mapping.dv = layout.repeat[1] * mapping.dv;
    return mapping;
}

template <int TYPES>
WARPCAM_FN CubeMapping map_cube(const Pose& pose, const Layout& layout, const Surface& surface)
{
    const int type = pose.type();
    const Vec half = to_vec(layout.extent);
    Vec place = surface.local, scale { 1.0f, 1.0f, 1.0f };  // planes, height fields and meshes: metres
    if (type != PLANE && type != HEIGHT_FIELD && type != MESH)
        scale = { inverse(half.x), inverse(half.y), inverse(half.z) };
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
