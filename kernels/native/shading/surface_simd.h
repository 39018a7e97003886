// The surface at eight hits of one shape, on a CPU: geometry/surface_interaction.h and shading/gouraud.h, whose
// comments hold here.
#pragma once
#include "core/simd8.h"
#include "shading/gouraud.h"

namespace warpcam {

using SurfaceInteraction8 = SurfaceInteractionOf<Vec3x8>;

inline SurfaceInteraction get_lane(const SurfaceInteraction8& surface, int k)
{
    const TriangleOf<Vec3x8>& triangle = surface.triangle;
    return { get_lane(surface.local, k),
             get_lane(surface.normal, k),
             surface.part[k],
             surface.corner[k],
             surface.flat[k] != 0,
             { get_lane(triangle.origin, k), get_lane(triangle.edge1, k), get_lane(triangle.edge2, k) },
             surface.weight1[k],
             surface.weight2[k] };
}

template <class HeightFields> WARPCAM_NOINLINE_CPU inline void height_field_surface(const HeightFields& fields,
                                                                                    int field, const int* faces,
                                                                                    SurfaceInteraction8& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    const Vec3x8 outside = height_field_side(size, surface.local);
    const float* const heights = fields.heights.data + wp::index(fields.height_start, field);
    Int8 column, row, high, top;
    Float8 height, diagonal, side;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const bool on_top = faces[k] >= 0 && faces[k] < 2 * (rows - 1) * (columns - 1);
        const unsigned face = on_top ? unsigned(faces[k]) : 0u, cell = face >> 1, at = cell / unsigned(columns - 1);
        const unsigned beyond = cell - at * unsigned(columns - 1);
        const float* const corner = heights + at * unsigned(columns) + beyond;
        top[k] = on_top ? -1 : 0;
        row[k] = int(at);
        column[k] = int(beyond);
        high[k] = face & 1 ? -1 : 0;
        height[k] = corner[0];
        diagonal[k] = corner[columns + 1] - corner[0];
        side[k] = corner[face & 1 ? columns : 1] - corner[0];
    }
    surface.part = top & int(TOP);
    height_field_top(size, rows, columns, to_floats(row), to_floats(column), high, height, diagonal, side, surface);
    surface.normal = select(top, surface.normal, outside);
}

template <class Types, class Meshes> inline void mesh_surface(const Meshes& meshes, const ShapeFromCamera& pose,
                                                              const int* faces, Vec3x8 ray,
                                                              SurfaceInteraction8& surface)
{
    const MeshStart start = mesh_start<Types>(meshes, pose);
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        int given;
        bool flat;
        const Triangle one = load_triangle<Types>(meshes, start.faces + 3 * faces[k], get_lane(ray, k), given, flat);
        surface.corner[k] = 3 * (start.corners + given);
        surface.flat[k] = flat ? -1 : 0;
        set_lane(surface.triangle.origin, k, one.origin);
        set_lane(surface.triangle.edge1, k, one.edge1);
        set_lane(surface.triangle.edge2, k, one.edge2);
    }
    triangle_surface(surface);
}

// The normals at corner `i` of the triangles; those of flat ones are their own.
template <class Meshes> inline Vec3x8 vertex_normal(const Meshes& meshes, const SurfaceInteraction8& surface, int i)
{
    Vec3x8 normal;
    for (int k = 0; k < SIMD_WIDTH; ++k)
        set_lane(normal, k,
                 surface.flat[k] ? get_lane(surface.normal, k)
                                 : as_vec3(wp::index(meshes.normals, surface.corner[k] + i)));
    return normal;
}

// True if the shape is lit at the corners of triangles, false if at each pixel.
template <class Types, class Appearances> inline bool lit_at_corners(const Appearances& look)
{
    const int type = look.pose.type();
    if constexpr (Types::has(PLANE))
        if (type == PLANE)
            return look.cells.u.step != 0.0f;
    return (Types::has(MESH) && type == MESH) || (Types::has(HEIGHT_FIELD) && type == HEIGHT_FIELD)
           || (Types::has(BOX) && type == BOX);
}

using GouraudTriangle8 = GouraudTriangleOf<Vec3x8>;

template <class Types, class Appearances, class Meshes>
inline void gouraud_at(const Appearances& look, const Meshes& meshes, const SurfaceInteraction8& surface, Vec3x8 place,
                       GouraudTriangle8& gouraud)
{
    const ShapeFromCamera& pose = look.pose;
    const int type = pose.type();
    gouraud.place[0] = gouraud.place[1] = gouraud.place[2] = place;
    gouraud.weight1 = gouraud.weight2 = 0.0f;
    gouraud.normal[0] = gouraud.normal[1] = gouraud.normal[2] = pose.seen(surface.normal);
    if constexpr (Types::has_any(MESH, HEIGHT_FIELD)) {
        if (type == MESH || type == HEIGHT_FIELD) {
            const TriangleOf<Vec3x8>& triangle = surface.triangle;
            const Int8 on = type == MESH ? (Int8)-1 : surface.part == int(TOP);
            const Vec3x8 first = pose.seen(triangle.origin - broadcast(pose.eye()));
            gouraud.weight1 = on ? surface.weight1 : (Float8)0.0f;
            gouraud.weight2 = on ? surface.weight2 : (Float8)0.0f;
            gouraud.place[0] = select(on, first, place);
            gouraud.place[1] = select(on, first + pose.seen(triangle.edge1), place);
            gouraud.place[2] = select(on, first + pose.seen(triangle.edge2), place);
        }
    }
    if constexpr (Types::has(MESH)) {
        if (type == MESH) {
            for (int i = 0; i < 3; ++i) {
                Vec3x8 normal = vertex_normal(meshes, surface, i);
                if (Types::has(PER_SHAPE_SCALE))
                    normal = select(surface.flat, normal, normalized(div(normal, broadcast(as_vec3(pose.size)))));
                gouraud.normal[i] = pose.seen(normal);
            }
        }
    }
    if constexpr (Types::has(PLANE))
        if (type == PLANE && look.cells.u.step != 0.0f)
            in_quad(place, broadcast(as_vec3(pose.axis_x)), broadcast(as_vec3(pose.axis_y)), surface.local.x,
                    surface.local.y, cell_around(look.cells.u, surface.local.x),
                    cell_around(look.cells.v, surface.local.y), (Int8)0, gouraud);
    if (Types::has(BOX) && type == BOX) {
        const Int8 axis = surface.part, u_axis = axis == 0 ? (Int8)1 : (Int8)0, v_axis = axis == 2 ? (Int8)1 : (Int8)2;
        const Vec3x8 x = broadcast(as_vec3(pose.axis_x)), y = broadcast(as_vec3(pose.axis_y)),
                     z = broadcast(as_vec3(pose.axis_z));
        const Vec3x8 half = broadcast(as_vec3(pose.size));
        const Float8 a = component(surface.local, u_axis), b = component(surface.local, v_axis);
        const Int8 mirrored = (axis == 1) == (component(surface.normal, axis) > 0.0f);
        in_quad(place, select(u_axis == 0, x, y), select(v_axis == 1, y, z), a, b, box_cell(a, component(half, u_axis)),
                box_cell(b, component(half, v_axis)), mirrored, gouraud);
    }
}

}  // namespace warpcam
