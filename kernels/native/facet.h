// The triangles that light is computed at.
//
// MuJoCo's renderer lights the corners of triangles and interpolates. Where the triangles are large that shows: a floor
// of one quad has no highlight and knows no spot light but at its corners. So meshes and height fields are lit at the
// corners of their faces, planes and boxes at those of the triangles MuJoCo cuts them into, and all else, which is
// finely cut there, at each pixel.
#pragma once
#include "look.h"

namespace warpcam {

constexpr int BOX_CELLS = 4;  // along a side of a box

// How the surface around a hit is cut: finely, into cells of two triangles, into the faces of a mesh or height field.
// UNSEEN: there is no hit, and what comes out does not matter.
enum Cut { FINE, CELL, FACE, UNSEEN };

// A triangle, and a hit on it. A cell's has two sides along the cell's, u and v, and starts where they meet.
struct Facet {
    int cut;
    float weight1, weight2;  // of the second and third corner
    // Of a cell:
    int side;         // the axis it is normal to; + 4 where it faces the other way
    int column, row;  // borders along u and v that the cell begins at
    int start;        // bit 0: the triangle starts at the cell's end along u, bit 1: along v
};

// A corner, or any place of a surface, in the camera's frame.
struct Vertex {
    Vec place;   // [m]
    Vec normal;  // unit
};

// In the shape's frame.
template <int TYPES, class Meshes> WARPCAM_FN Vec corner_normal(const Meshes& meshes, const Pose& pose, int corner)
{
    const Vec normal = to_vec(wp::index(meshes.normals, corner));
    return TYPES >> SCALED & 1 ? normalized(divided(normal, to_vec(pose.size))) : normal;
}

// The cells along both sides of a plane or of a side of a box.
template <int TYPES, class Looks> WARPCAM_FN PlaneCells cells_of(const Looks& look, int axis)
{
    if constexpr (TYPES >> BOX & 1) {
        if (!(TYPES >> PLANE & 1) || look.pose.type() == BOX) {
            const Vec size = to_vec(look.pose.size);
            const float u = axis == 0 ? size.y : size.x, v = axis == 2 ? size.y : size.z;
            constexpr float PART = 2.0f / BOX_CELLS;
            return { { -u, PART * u, 1.0f / PART * reciprocal(upper(u, 1.0e-20f)), 0.0f },
                     { -v, PART * v, 1.0f / PART * reciprocal(upper(v, 1.0e-20f)), 0.0f } };
        }
    }
    if constexpr (TYPES >> PLANE & 1)
        return look.cells;
    return {};
}

// Cells are cut from the second to the fourth of their corners; mirrored, from the first to the third.
WARPCAM_FN void in_cell(Cell u, Cell v, bool mirrored, Facet& facet)
{
    float weight1 = u.on, weight2 = mirrored ? 1.0f - v.on : v.on;
    const bool beyond = weight1 + weight2 > 1.0f;
    facet.cut = CELL;
    facet.column = u.at;
    facet.row = v.at;
    facet.start = (beyond ? 3 : 0) ^ (mirrored ? 2 : 0);
    facet.weight1 = beyond ? 1.0f - weight1 : weight1;
    facet.weight2 = beyond ? 1.0f - weight2 : weight2;
}

template <int TYPES, class Looks> WARPCAM_FN Facet facet_at(const Looks& look, const Surface& surface)
{
    constexpr bool HAS_PLANE = TYPES >> PLANE & 1, HAS_BOX = TYPES >> BOX & 1;
    const int type = look.pose.type();
    Facet facet { FINE, 0.0f, 0.0f, 2, 0, 0, 0 };
    if ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) && (type == MESH || (type == HEIGHT_FIELD && surface.part == TOP))) {
        facet.cut = FACE;
        facet.weight1 = surface.weight1;
        facet.weight2 = surface.weight2;
    }
    if constexpr (HAS_PLANE || HAS_BOX) {
        const bool box = HAS_BOX && type == BOX, plane = HAS_PLANE && type == PLANE;
        if (box || plane) {
            const int axis = box ? surface.part : 2;
            const bool away = box && component(surface.normal, axis) < 0.0f;
            const PlaneCells cells = cells_of<TYPES>(look, axis);
            facet.side = axis + (away ? 4 : 0);
            const float u = axis == 0 ? surface.local.y : surface.local.x;
            const float v = axis == 2 ? surface.local.y : surface.local.z;
            if (cells.u.step != 0.0f)
                in_cell(cell_around(cells.u, u), cell_around(cells.v, v), box && (axis == 1) != away, facet);
        }
    }
    return facet;
}

// Where two borders meet on a plane or on a side of a box.
template <int TYPES, class Looks> WARPCAM_FN Vertex cell_vertex(const Looks& look, int side, int column, int row)
{
    const Pose& pose = look.pose;
    const int axis = side & 3;
    const PlaneCells cells = cells_of<TYPES>(look, axis);
    const float u = border(cells.u, column), v = border(cells.v, row), sign = side & 4 ? -1.0f : 1.0f;
    if (!(TYPES >> BOX & 1))
        return { pose.seen(Vec { u, v, 0.0f } - pose.eye()), to_vec(pose.axis_z) };
    const bool box = !(TYPES >> PLANE & 1) || pose.type() == BOX;
    const float w = box ? sign * component(to_vec(pose.size), axis) : 0.0f;
    const Vec local { axis == 0 ? w : u, axis == 0 ? u : axis == 1 ? w : v, axis == 2 ? w : v };
    return { pose.seen(local - pose.eye()),
             sign * to_vec(axis == 0 ? pose.axis_x : axis == 1 ? pose.axis_y : pose.axis_z) };
}

// A corner, 0 to 2, of a facet.
template <int TYPES, class Looks, class Meshes>
WARPCAM_FN Vertex vertex_of(const Looks& look, const Meshes& meshes, const Surface& surface, const Facet& facet, int k)
{
    const Pose& pose = look.pose;
    if ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) && facet.cut == FACE) {
        const Triangle& triangle = surface.triangle;
        const Vec edge = k == 1 ? triangle.edge1 : triangle.edge2;
        Vec normal = surface.normal;
        if ((TYPES >> MESH & 1) && pose.type() == MESH)
            normal = corner_normal<TYPES>(meshes, pose, surface.corner + k);
        return { pose.seen(triangle.origin + (k > 0 ? 1.0f : 0.0f) * edge - pose.eye()), pose.seen(normal) };
    }
    if constexpr ((TYPES & (1 << PLANE | 1 << BOX)) != 0) {
        const int start = facet.start ^ (k == 1 ? 1 : k == 2 ? 2 : 0);
        return cell_vertex<TYPES>(look, facet.side, facet.column + (start & 1), facet.row + (start >> 1));
    }
    return {};
}

}  // namespace warpcam
