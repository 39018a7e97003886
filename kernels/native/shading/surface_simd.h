// The surface at eight hits of one shape, on a CPU: geometry/surface_interaction.h and shading/gouraud.h, whose
// comments hold here.
#pragma once
#include "core/simd8.h"
#include "shading/gouraud.h"

namespace warpcam {

using Surfaces = SurfaceInteractionOf<Vecs>;

inline Surface one_of(const Surfaces& surface, int k)
{
    const TriangleOf<Vecs>& triangle = surface.triangle;
    return {
        one_of(surface.local, k), one_of(surface.normal, k),
        surface.part[k],          surface.corner[k],
        surface.flat[k] != 0,     { one_of(triangle.origin, k), one_of(triangle.edge1, k), one_of(triangle.edge2, k) },
        surface.weight1[k],       surface.weight2[k]
    };
}

inline void ellipsoid_surface(Vec half, Surfaces& surface)
{
    const Vec rate { reciprocal(half.x), reciprocal(half.y), reciprocal(half.z) };
    surface.normal = normalized(times(surface.local, eight_of(times(rate, rate))));
}

// Shapes that are seldom seen, one hit at a time.
template <class Find> inline void each_surface(const Vecs& ray, Surfaces& surface, const Find& find)
{
    for (int k = 0; k < PACKET; ++k) {
        Surface one {};
        one.local = one_of(surface.local, k);
        find(one_of(ray, k), one);
        put_one(surface.normal, k, one.normal);
        surface.part[k] = one.part;
    }
}
static WARPCAM_COLD void cone_surface(Vec size, const Vecs& ray, Surfaces& surface)
{
    each_surface(ray, surface, [&](Vec ray, Surface& one) { cone_surface(size, ray, one); });
}
static WARPCAM_COLD void barrel_surface(Vec size, const Vecs& ray, Surfaces& surface)
{
    each_surface(ray, surface, [&](Vec ray, Surface& one) { barrel_surface(size, ray, one); });
}

template <class HeightFields> WARPCAM_APART inline void height_field_surface(const HeightFields& fields, int field,
                                                                             const int* faces, Surfaces& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    const Vecs outside = height_field_side(size, surface.local);
    const float* const heights = fields.heights.data + wp::index(fields.height_start, field);
    Ints column, row, high, top;
    Floats height, diagonal, side;
    for (int k = 0; k < PACKET; ++k) {
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
    surface.normal = chosen(top, surface.normal, outside);
}

template <int TYPES, class Meshes>
inline void mesh_surface(const Meshes& meshes, const Pose& pose, const int* faces, Vecs ray, Surfaces& surface)
{
    const MeshStart start = mesh_start<TYPES>(meshes, pose);
    for (int k = 0; k < PACKET; ++k) {
        int given;
        bool flat;
        const Triangle one = load_triangle<TYPES>(meshes, start.faces + 3 * faces[k], one_of(ray, k), given, flat);
        surface.corner[k] = 3 * (start.corners + given);
        surface.flat[k] = flat ? -1 : 0;
        put_one(surface.triangle.origin, k, one.origin);
        put_one(surface.triangle.edge1, k, one.edge1);
        put_one(surface.triangle.edge2, k, one.edge2);
    }
    triangle_surface(surface);
}

template <int TYPES, class Meshes>
inline Vecs smooth_normal(const Pose& pose, const Meshes& meshes, const Surfaces& surface)
{
    if constexpr ((TYPES >> MESH & 1) != 0) {
        if (pose.type() == MESH) {
            constexpr bool STRETCHED = TYPES >> SCALED & 1, LATE = TYPES >> LIT_NORMALS & 1;
            const Vecs size = eight_of(to_vec(pose.size));
            const Floats weights[3] = { 1.0f - surface.weight1 - surface.weight2, surface.weight1, surface.weight2 },
                         none = 0.0f;
            Vecs sum { none, none, none };
            for (int i = 0; i < 3; ++i) {
                Vecs normal;
                for (int k = 0; k < PACKET; ++k)
                    put_one(normal, k,
                            surface.flat[k] ? one_of(surface.normal, k)
                                            : to_vec(wp::index(meshes.normals, surface.corner[k] + i)));
                sum = sum + weights[i] * (STRETCHED && !LATE ? normalized(divided(normal, size)) : normal);
            }
            if (STRETCHED && LATE)
                sum = divided(sum, size);
            return chosen(surface.flat | ~(dot(sum, sum) > 1.0e-12f), surface.normal, normalized(sum));
        }
    }
    return surface.normal;
}

// Whether the shape's light is computed at the corners of triangles, else at each pixel.
template <int TYPES, class Looks> inline bool lit_at_corners(const Looks& look)
{
    const int type = look.pose.type();
    if constexpr ((TYPES >> PLANE & 1) != 0)
        if (type == PLANE)
            return look.cells.u.step != 0.0f;
    return ((TYPES >> MESH & 1) && type == MESH) || ((TYPES >> HEIGHT_FIELD & 1) && type == HEIGHT_FIELD)
        || ((TYPES >> BOX & 1) && type == BOX);
}

using Facets = GouraudTriangleOf<Vecs>;

template <int TYPES, class Looks, class Meshes>
inline void facet_at(const Looks& look, const Meshes& meshes, const Surfaces& surface, Vecs place, Facets& facet)
{
    const Pose& pose = look.pose;
    const int type = pose.type();
    facet.place[0] = facet.place[1] = facet.place[2] = place;
    facet.weight1 = facet.weight2 = 0.0f;
    facet.normal[0] = facet.normal[1] = facet.normal[2] = pose.seen(surface.normal);
    if constexpr ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0) {
        if (type == MESH || type == HEIGHT_FIELD) {
            const TriangleOf<Vecs>& triangle = surface.triangle;
            const Ints on = type == MESH ? (Ints)-1 : surface.part == int(TOP);
            const Vecs first = pose.seen(triangle.origin - eight_of(pose.eye()));
            facet.weight1 = on ? surface.weight1 : (Floats)0.0f;
            facet.weight2 = on ? surface.weight2 : (Floats)0.0f;
            facet.place[0] = chosen(on, first, place);
            facet.place[1] = chosen(on, first + pose.seen(triangle.edge1), place);
            facet.place[2] = chosen(on, first + pose.seen(triangle.edge2), place);
        }
    }
    if constexpr ((TYPES >> MESH & 1) != 0) {
        if (type == MESH) {
            Vecs normal[3];
            for (int k = 0; k < PACKET; ++k)
                for (int i = 0; i < 3; ++i)
                    put_one(normal[i], k,
                            surface.flat[k] ? one_of(surface.normal, k)
                                            : to_vec(wp::index(meshes.normals, surface.corner[k] + i)));
            for (int i = 0; i < 3; ++i) {
                if ((TYPES >> SCALED & 1) != 0)
                    normal[i] = chosen(surface.flat, normal[i],
                                       normalized(divided(normal[i], eight_of(to_vec(pose.size)))));
                facet.normal[i] = pose.seen(normal[i]);
            }
        }
    }
    if constexpr ((TYPES >> PLANE & 1) != 0)
        if (type == PLANE && look.cells.u.step != 0.0f)
            in_quad(place, eight_of(to_vec(pose.axis_x)), eight_of(to_vec(pose.axis_y)), surface.local.x,
                     surface.local.y, cell_around(look.cells.u, surface.local.x),
                     cell_around(look.cells.v, surface.local.y), (Ints)0, facet);
    if ((TYPES >> BOX & 1) && type == BOX) {
        const Ints axis = surface.part, u_axis = axis == 0 ? (Ints)1 : (Ints)0, v_axis = axis == 2 ? (Ints)1 : (Ints)2;
        const Vecs x = eight_of(to_vec(pose.axis_x)), y = eight_of(to_vec(pose.axis_y)),
                   z = eight_of(to_vec(pose.axis_z));
        const Vecs half = eight_of(to_vec(pose.size));
        const Floats a = component(surface.local, u_axis), b = component(surface.local, v_axis);
        const Ints mirrored = (axis == 1) == (component(surface.normal, axis) > 0.0f);
        in_quad(place, chosen(u_axis == 0, x, y), chosen(v_axis == 1, y, z), a, b,
                 box_cell(a, component(half, u_axis)), box_cell(b, component(half, v_axis)), mirrored, facet);
    }
}

}  // namespace warpcam
