// The triangles that light is computed at.
//
// MuJoCo's renderer lights the corners of triangles and interpolates. Where the triangles are large that shows: a floor
// of one quad has no highlight and knows no spot light but at its corners. So meshes and height fields are lit at the
// corners of their faces, planes and boxes at those of the triangles MuJoCo cuts them into, and all else, which is
// finely cut there, at each pixel.
#pragma once
#include "shading/appearance.h"

namespace warpcam {

constexpr int BOX_CELLS = 4;  // along a side of a box

// A triangle in the camera's frame, and a place on it.
template <class Vector> struct GouraudTriangleOf {
    Vector place[3], normal[3];  // of its corners [m]
    NumberOf<Vector> weight1, weight2;  // of the second and third corner, for the place
    bool three;  // else only the first corner counts, which is the place itself
};

using GouraudTriangle = GouraudTriangleOf<Vec3>;

// The half of an axis-aligned quad that a hit lies in. The quad is cut from its second to its fourth corner; mirrored,
// from its first to its third. `place` is the hit in the camera's frame, `along` and `across` are the quad's axes
// there, `a` and `b` the hit's coordinates on them.
template <class Vector, class Number = NumberOf<Vector>>
WARPCAM_DEVICE void in_quad(Vector place, Vector along, Vector across, Number a, Number b, CellSpan<Number> u,
                            CellSpan<Number> v, MaskOf<Vector> mirrored, GouraudTriangleOf<Vector>& gouraud)
{
    const Number none = 0.0f, one = 1.0f;
    const Number weight1 = clamp((a - u.start) * rcp(max(u.length, 1.0e-20f)), none, one);
    Number weight2 = clamp((b - v.start) * rcp(max(v.length, 1.0e-20f)), none, one);
    v = { mirrored ? v.start + v.length : v.start, mirrored ? -v.length : v.length };
    weight2 = mirrored ? one - weight2 : weight2;
    const auto other = weight1 + weight2 > one;
    u = { other ? u.start + u.length : u.start, other ? -u.length : u.length };
    v = { other ? v.start + v.length : v.start, other ? -v.length : v.length };
    gouraud.weight1 = other ? one - weight1 : weight1;
    gouraud.weight2 = other ? one - weight2 : weight2;
    gouraud.place[0] = place + (u.start - a) * along + (v.start - b) * across;
    gouraud.place[1] = gouraud.place[0] + u.length * along;
    gouraud.place[2] = gouraud.place[0] + v.length * across;
    gouraud.three = true;
}

// One of the equal cells of a box's side.
template <class Number> WARPCAM_DEVICE CellSpan<Number> box_cell(Number x, Number half)
{
    const Number length = 2.0f / BOX_CELLS * half, none = 0.0f, last = float(BOX_CELLS - 1);
    const Number i = clamp(round_down((x + half) * rcp(length)), none, last);
    return { i * length - half, length };
}

template <class Types, class Meshes>
WARPCAM_DEVICE Vec3 corner_normal(const Meshes& meshes, const ShapeFromCamera& pose, int corner)
{
    const Vec3 normal = as_vec3(wp::index(meshes.normals, corner));
    if (Types::has(PER_SHAPE_SCALE))
        return pose.seen(normalized(div(normal, as_vec3(pose.size))));
    return pose.seen(normal);
}

// `place` is the hit in the camera's frame. What is on a plane without `cells` is lit at its place.
template <class Types, class Appearances, class Meshes>
WARPCAM_DEVICE void gouraud_at(const Appearances& look, const Meshes& meshes, const SurfaceInteraction& surface,
                               Vec3 place, GouraudTriangle& gouraud, bool cells = true)
{
    constexpr bool HAS_PLANE = Types::has(PLANE), HAS_BOX = Types::has(BOX);
    const ShapeFromCamera& pose = look.pose;
    const int type = pose.type();
    gouraud.place[0] = gouraud.place[1] = gouraud.place[2] = place;
    gouraud.weight1 = gouraud.weight2 = 0.0f;
    gouraud.three = false;
    if (Types::has_any(MESH, HEIGHT_FIELD) && (type == MESH || (type == HEIGHT_FIELD && surface.part == TOP))) {
        const Triangle& triangle = surface.triangle;
        gouraud.weight1 = surface.weight1;
        gouraud.weight2 = surface.weight2;
        gouraud.place[0] = pose.seen(triangle.origin - pose.eye());
        gouraud.place[1] = gouraud.place[0] + pose.seen(triangle.edge1);
        gouraud.place[2] = gouraud.place[0] + pose.seen(triangle.edge2);
        gouraud.three = true;
    }
    if (Types::has(MESH) && type == MESH && !surface.flat) {
        for (int k = 0; k < 3; ++k)
            gouraud.normal[k] = corner_normal<Types>(meshes, pose, surface.corner + k);
        return;
    }
    gouraud.normal[0] = gouraud.normal[1] = gouraud.normal[2] = pose.seen(surface.normal);
    bool quad = false, mirrored = false;
    int u_axis = 0, v_axis = 1;
    CellSpan<float> u, v;
    float a, b;
    if constexpr (HAS_PLANE) {
        if (type == PLANE && look.cells.u.step != 0.0f && cells) {
            quad = true;
            a = surface.local.x;
            b = surface.local.y;
            u = cell_around(look.cells.u, a);
            v = cell_around(look.cells.v, b);
        }
    }
    if (HAS_BOX && type == BOX) {
        quad = true;
        u_axis = surface.part == 0 ? 1 : 0;
        v_axis = surface.part == 2 ? 1 : 2;
        a = component(surface.local, u_axis);
        b = component(surface.local, v_axis);
        u = box_cell(a, component(as_vec3(pose.size), u_axis));
        v = box_cell(b, component(as_vec3(pose.size), v_axis));
        mirrored = (surface.part == 1) == (component(surface.normal, surface.part) > 0.0f);
    }
    if ((HAS_PLANE || HAS_BOX) && quad) {
        const Vec3 along = as_vec3(u_axis == 0 ? pose.axis_x : pose.axis_y);
        const Vec3 across = as_vec3(v_axis == 1 ? pose.axis_y : pose.axis_z);
        in_quad(place, along, across, a, b, u, v, mirrored, gouraud);
    }
}

}  // namespace warpcam
