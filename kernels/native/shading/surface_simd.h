// The surface at eight hits of one shape, on a CPU: geometry/surface_interaction.h and shading/gouraud.h, whose
// comments hold here.
#pragma once
#include "core/simd8.h"
#include "shading/gouraud.h"

namespace warpcam {

struct Triangles {
    Vecs origin, edge1, edge2;
};

struct Surfaces {
    Vecs local, normal;
    Ints part;
    Ints corner, flat;
    Triangles triangle;
    Floats weight1, weight2;

    Surface one(int k) const
    {
        return { one_of(local, k), one_of(normal, k), part[k], corner[k], flat[k] != 0,
                 { one_of(triangle.origin, k), one_of(triangle.edge1, k), one_of(triangle.edge2, k) },
                 weight1[k], weight2[k] };
    }
};

inline Vecs local_of(const Pose& pose, Vecs v)
{
    const Row x = pose.axis_x, y = pose.axis_y, z = pose.axis_z;
    return { x.x * v.x + x.y * v.y + x.z * v.z, y.x * v.x + y.y * v.y + y.z * v.z, z.x * v.x + z.y * v.y + z.z * v.z };
}

inline Vecs seen_of(const Pose& pose, Vecs v)
{
    const Row x = pose.axis_x, y = pose.axis_y, z = pose.axis_z;
    return { x.x * v.x + y.x * v.y + z.x * v.z, x.y * v.x + y.y * v.y + z.y * v.z, x.z * v.x + y.z * v.y + z.z * v.z };
}

inline void box_surfaces(Vec half, Vecs ray, Surfaces& surface)
{
    const Floats x = magnitude(half.x + sign(ray.x) * surface.local.x);
    const Floats y = magnitude(half.y + sign(ray.y) * surface.local.y);
    const Floats z = magnitude(half.z + sign(ray.z) * surface.local.z);
    const Ints axis = y < x ? (z < y ? (Ints)2 : (Ints)1) : (z < x ? (Ints)2 : (Ints)0);
    const Floats turn = -sign(component(ray, axis)), none = 0.0f;
    surface.part = axis;
    surface.normal = { axis == 0 ? turn : none, axis == 1 ? turn : none, axis == 2 ? turn : none };
}

inline void cylinder_surfaces(float radius, float half_length, Vecs ray, Surfaces& surface)
{
    const Vecs p = surface.local;
    const Floats none = 0.0f, axial = root(p.x * p.x + p.y * p.y);
    const Ints on_cap = magnitude(half_length + sign(ray.z) * p.z) < magnitude(radius - axial);
    surface.part = on_cap ? (ray.z < 0.0f ? (Ints)TOP : (Ints)BOTTOM) : (Ints)SIDE;
    surface.normal = chosen(on_cap, { none, none, -sign(ray.z) }, normalized({ p.x, p.y, none }));
}

inline void capsule_surfaces(float half_length, Surfaces& surface)
{
    const Vecs p = surface.local;
    const Floats high = half_length;
    surface.part = p.z > high ? (Ints)TOP : p.z < -high ? (Ints)BOTTOM : (Ints)SIDE;
    surface.normal = normalized({ p.x, p.y, p.z - between(p.z, -high, high) });
}

template <class HeightFields> WARPCAM_APART inline void height_field_surfaces(const HeightFields& fields, int field,
                                                                              const int* faces, Surfaces& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    const Vecs p = surface.local;
    const Floats gap_x = magnitude(size[0] - magnitude(p.x)), gap_y = magnitude(size[1] - magnitude(p.y));
    const Floats gap_z = magnitude(p.z + size[3]), none = 0.0f;
    const Vecs beside = chosen(gap_x < gap_y, { sign(p.x), none, none }, { none, sign(p.y), none });
    const Vecs outside = chosen((gap_z < gap_x) & (gap_z < gap_y), { none, none, (Floats)-1.0f }, beside);

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
    const float rate_x = float(columns - 1) * reciprocal(2.0f * size[0]), step_x = reciprocal(rate_x);
    const float rate_y = float(rows - 1) * reciprocal(2.0f * size[1]), step_y = reciprocal(rate_y);
    const Vecs origin { to_floats(column) * step_x - size[0], to_floats(row) * step_y - size[1], height };
    const Floats a = (p.x - origin.x) * rate_x, b = (p.y - origin.y) * rate_y;
    surface.part = top & int(TOP);
    surface.triangle = { origin, { high ? none : (Floats)step_x, high ? (Floats)step_y : none, side },
                         { (Floats)step_x, (Floats)step_y, diagonal } };
    surface.weight1 = high ? b - a : a - b;
    surface.weight2 = high ? a : b;
    const Floats rise_x = high ? diagonal - side : side, rise_y = high ? side : diagonal - side;
    surface.normal = chosen(top, normalized({ -rise_x * rate_x, -rise_y * rate_y, (Floats)1.0f }), outside);
}

template <int TYPES, class Meshes>
inline void mesh_surfaces(const Meshes& meshes, const Pose& pose, const int* faces, Vecs ray, Surfaces& surface)
{
    constexpr bool STRETCHED = TYPES >> SCALED & 1;
    const int start = STRETCHED ? wp::index(meshes.face_start, pose.asset()) : as_int(pose.size.x);
    const int corners = STRETCHED ? wp::index(meshes.corner_start, pose.asset()) : as_int(pose.size.y);
    Triangles triangle;
    for (int k = 0; k < PACKET; ++k) {
        int given;
        bool flat;
        const Triangle one = load_triangle<TYPES>(meshes, start + 3 * faces[k], one_of(ray, k), given, flat);
        surface.corner[k] = 3 * (corners + given);
        surface.flat[k] = flat ? -1 : 0;
        put_one(triangle.origin, k, one.origin);
        put_one(triangle.edge1, k, one.edge1);
        put_one(triangle.edge2, k, one.edge2);
    }
    const Vecs normal = cross(triangle.edge1, triangle.edge2), place = surface.local - triangle.origin;
    const Floats rate = reciprocal(upper(dot(normal, normal), (Floats)TINY)), none = 0.0f, one = 1.0f;
    surface.triangle = triangle;
    surface.normal = normalized(normal);
    surface.weight1 = between(dot(cross(place, triangle.edge2), normal) * rate, none, one);
    surface.weight2 = between(dot(cross(triangle.edge1, place), normal) * rate, none, one - surface.weight1);
}

// Shapes that are seldom seen, one hit at a time.
template <int TYPES, class Meshes, class HeightFields>
static WARPCAM_COLD void other_surfaces(const Pose& pose, const Meshes& meshes, const HeightFields& fields, Vecs ray,
                                        Surfaces& surface)
{
    for (int k = 0; k < PACKET; ++k) {
        const Surface one = surface_at<TYPES>(pose, meshes, fields, 0, one_of(surface.local, k), one_of(ray, k));
        put_one(surface.normal, k, one.normal);
        surface.part[k] = one.part;
    }
}

template <int TYPES, class Meshes, class HeightFields>
inline void surfaces_at(const Pose& pose, const Meshes& meshes, const HeightFields& fields, const int* faces,
                        Vecs local, Vecs ray, Surfaces& surface)
{
    constexpr int OTHERS = TYPES & (1 << CONE | 1 << BARREL);
    const int type = pose.type();
    const Vec size = to_vec(pose.size);
    surface.local = local;
    surface.normal = eight_of({ 0.0f, 0.0f, 1.0f });
    surface.part = 0;
    if ((TYPES >> SPHERE & 1) && type == SPHERE)
        surface.normal = normalized(local);
    if ((TYPES >> CAPSULE & 1) && type == CAPSULE)
        capsule_surfaces(size.y, surface);
    if ((TYPES >> ELLIPSOID & 1) && type == ELLIPSOID) {
        const Vec rate { reciprocal(size.x), reciprocal(size.y), reciprocal(size.z) };
        surface.normal = normalized(times(local, eight_of(times(rate, rate))));
    }
    if ((TYPES >> CYLINDER & 1) && type == CYLINDER)
        cylinder_surfaces(size.x, size.y, ray, surface);
    if ((TYPES >> BOX & 1) && type == BOX)
        box_surfaces(size, ray, surface);
    if constexpr (OTHERS != 0)
        if (type == CONE || type == BARREL)
            other_surfaces<OTHERS>(pose, meshes, fields, ray, surface);
    const bool stretched = (TYPES >> SCALED & 1) && (type == MESH || type == HEIGHT_FIELD);
    const Vecs sizes = eight_of(size);
    if (stretched)
        surface.local = divided(local, sizes);
    if constexpr ((TYPES >> HEIGHT_FIELD & 1) != 0)
        if (type == HEIGHT_FIELD)
            height_field_surfaces(fields, pose.asset(), faces, surface);
    if constexpr ((TYPES >> MESH & 1) != 0)
        if (type == MESH)
            mesh_surfaces<TYPES>(meshes, pose, faces, stretched ? divided(ray, sizes) : ray, surface);
    if (stretched) {
        Triangles& triangle = surface.triangle;
        surface.local = local;
        surface.normal = normalized(divided(surface.normal, sizes));
        triangle = { times(triangle.origin, sizes), times(triangle.edge1, sizes), times(triangle.edge2, sizes) };
    }
}

template <int TYPES, class Meshes>
inline Vecs smooth_normals(const Pose& pose, const Meshes& meshes, const Surfaces& surface)
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

struct Facets {
    Vecs place[3], normal[3];
    Floats weight1, weight2;
};

struct Spans {
    Floats start, length;
};

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

inline void in_quads(Vecs place, Vecs along, Vecs across, Floats a, Floats b, Spans u, Spans v, Ints mirrored,
                     Facets& facet)
{
    const Floats none = 0.0f, one = 1.0f, least = 1.0e-20f;
    Floats weight1 = between((a - u.start) * reciprocal(upper(u.length, least)), none, one);
    Floats weight2 = between((b - v.start) * reciprocal(upper(v.length, least)), none, one);
    v = { mirrored ? v.start + v.length : v.start, mirrored ? -v.length : v.length };
    weight2 = mirrored ? one - weight2 : weight2;
    const Ints other = weight1 + weight2 > one;
    u = { other ? u.start + u.length : u.start, other ? -u.length : u.length };
    v = { other ? v.start + v.length : v.start, other ? -v.length : v.length };
    facet.weight1 = other ? one - weight1 : weight1;
    facet.weight2 = other ? one - weight2 : weight2;
    facet.place[0] = place + (u.start - a) * along + (v.start - b) * across;
    facet.place[1] = facet.place[0] + u.length * along;
    facet.place[2] = facet.place[0] + v.length * across;
}

inline Spans box_cells(Floats x, Floats half)
{
    const Floats length = 2.0f / BOX_CELLS * half;
    const Floats i = between(round_down((x + half) * reciprocal(length)), (Floats)0.0f, (Floats)float(BOX_CELLS - 1));
    return { i * length - half, length };
}

inline Spans cells_around(const Cells& cells, Floats x)
{
    const Floats start = cells.start + cells.step * round_down((x - cells.start) * cells.inverse);
    if (cells.rest < 0.0f)
        return { start, (Floats)cells.step };
    const Ints beyond = x > -cells.start, within = (x > cells.start) & ~beyond;
    return { within ? start : beyond ? (Floats)-cells.start : (Floats)(cells.start - cells.rest),
             within ? (Floats)cells.step : (Floats)cells.rest };
}

template <int TYPES, class Looks, class Meshes>
inline void facets_at(const Looks& look, const Meshes& meshes, const Surfaces& surface, Vecs place, Facets& facet)
{
    const Pose& pose = look.pose;
    const int type = pose.type();
    facet.place[0] = facet.place[1] = facet.place[2] = place;
    facet.weight1 = facet.weight2 = 0.0f;
    facet.normal[0] = facet.normal[1] = facet.normal[2] = seen_of(pose, surface.normal);
    if constexpr ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0) {
        if (type == MESH || type == HEIGHT_FIELD) {
            const Triangles& triangle = surface.triangle;
            const Ints on = type == MESH ? (Ints)-1 : surface.part == int(TOP);
            const Vecs first = seen_of(pose, triangle.origin - eight_of(pose.eye()));
            facet.weight1 = on ? surface.weight1 : (Floats)0.0f;
            facet.weight2 = on ? surface.weight2 : (Floats)0.0f;
            facet.place[0] = chosen(on, first, place);
            facet.place[1] = chosen(on, first + seen_of(pose, triangle.edge1), place);
            facet.place[2] = chosen(on, first + seen_of(pose, triangle.edge2), place);
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
                facet.normal[i] = seen_of(pose, normal[i]);
            }
        }
    }
    if constexpr ((TYPES >> PLANE & 1) != 0)
        if (type == PLANE && look.cells.u.step != 0.0f)
            in_quads(place, eight_of(to_vec(pose.axis_x)), eight_of(to_vec(pose.axis_y)), surface.local.x,
                     surface.local.y, cells_around(look.cells.u, surface.local.x),
                     cells_around(look.cells.v, surface.local.y), (Ints)0, facet);
    if ((TYPES >> BOX & 1) && type == BOX) {
        const Ints axis = surface.part, u_axis = axis == 0 ? (Ints)1 : (Ints)0, v_axis = axis == 2 ? (Ints)1 : (Ints)2;
        const Vecs x = eight_of(to_vec(pose.axis_x)), y = eight_of(to_vec(pose.axis_y)),
                   z = eight_of(to_vec(pose.axis_z));
        const Vecs half = eight_of(to_vec(pose.size));
        const Floats a = component(surface.local, u_axis), b = component(surface.local, v_axis);
        const Ints mirrored = (axis == 1) == (component(surface.normal, axis) > 0.0f);
        in_quads(place, chosen(u_axis == 0, x, y), chosen(v_axis == 1, y, z), a, b,
                 box_cells(a, component(half, u_axis)), box_cells(b, component(half, v_axis)), mirrored, facet);
    }
}

}  // namespace warpcam
