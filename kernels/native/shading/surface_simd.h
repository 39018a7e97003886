// The surface at eight hits of one shape, on a CPU: geometry/surface_interaction.h and shading/gouraud.h, whose
// comments hold here.
#pragma once
#include "core/simd8.h"
#include "shading/gouraud.h"

namespace warpcam {

struct Triangles {
    Vec3x8 origin, edge1, edge2;
};

struct SurfaceInteraction8 {
    Vec3x8 local, normal;
    Int8 part;
    Int8 corner, flat;
    Triangles triangle;
    Float8 weight1, weight2;

    SurfaceInteraction one(int k) const
    {
        return { get_lane(local, k), get_lane(normal, k), part[k], corner[k], flat[k] != 0,
                 { get_lane(triangle.origin, k), get_lane(triangle.edge1, k), get_lane(triangle.edge2, k) },
                 weight1[k], weight2[k] };
    }
};

inline Vec3x8 local_of(const ShapeFromCamera& pose, Vec3x8 v)
{
    const Float3Int x = pose.axis_x, y = pose.axis_y, z = pose.axis_z;
    return { x.x * v.x + x.y * v.y + x.z * v.z, y.x * v.x + y.y * v.y + y.z * v.z, z.x * v.x + z.y * v.y + z.z * v.z };
}

inline Vec3x8 seen_of(const ShapeFromCamera& pose, Vec3x8 v)
{
    const Float3Int x = pose.axis_x, y = pose.axis_y, z = pose.axis_z;
    return { x.x * v.x + y.x * v.y + z.x * v.z, x.y * v.x + y.y * v.y + z.y * v.z, x.z * v.x + y.z * v.y + z.z * v.z };
}

inline void box_surfaces(Vec3 half, Vec3x8 ray, SurfaceInteraction8& surface)
{
    const Float8 x = abs(half.x + sign(ray.x) * surface.local.x);
    const Float8 y = abs(half.y + sign(ray.y) * surface.local.y);
    const Float8 z = abs(half.z + sign(ray.z) * surface.local.z);
    const Int8 axis = y < x ? (z < y ? (Int8)2 : (Int8)1) : (z < x ? (Int8)2 : (Int8)0);
    const Float8 turn = -sign(component(ray, axis)), none = 0.0f;
    surface.part = axis;
    surface.normal = { axis == 0 ? turn : none, axis == 1 ? turn : none, axis == 2 ? turn : none };
}

inline void cylinder_surfaces(float radius, float half_length, Vec3x8 ray, SurfaceInteraction8& surface)
{
    const Vec3x8 p = surface.local;
    const Float8 none = 0.0f, axial = sqrt(p.x * p.x + p.y * p.y);
    const Int8 on_cap = abs(half_length + sign(ray.z) * p.z) < abs(radius - axial);
    surface.part = on_cap ? (ray.z < 0.0f ? (Int8)TOP : (Int8)BOTTOM) : (Int8)SIDE;
    surface.normal = select(on_cap, { none, none, -sign(ray.z) }, normalized({ p.x, p.y, none }));
}

inline void capsule_surfaces(float half_length, SurfaceInteraction8& surface)
{
    const Vec3x8 p = surface.local;
    const Float8 high = half_length;
    surface.part = p.z > high ? (Int8)TOP : p.z < -high ? (Int8)BOTTOM : (Int8)SIDE;
    surface.normal = normalized({ p.x, p.y, p.z - clamp(p.z, -high, high) });
}

template <class HeightFields> WARPCAM_NOINLINE_CPU inline void height_field_surfaces(const HeightFields& fields, int field,
                                                                              const int* faces, SurfaceInteraction8& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    const Vec3x8 p = surface.local;
    const Float8 gap_x = abs(size[0] - abs(p.x)), gap_y = abs(size[1] - abs(p.y));
    const Float8 gap_z = abs(p.z + size[3]), none = 0.0f;
    const Vec3x8 beside = select(gap_x < gap_y, { sign(p.x), none, none }, { none, sign(p.y), none });
    const Vec3x8 outside = select((gap_z < gap_x) & (gap_z < gap_y), { none, none, (Float8)-1.0f }, beside);

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
    const float rate_x = float(columns - 1) * rcp(2.0f * size[0]), step_x = rcp(rate_x);
    const float rate_y = float(rows - 1) * rcp(2.0f * size[1]), step_y = rcp(rate_y);
    const Vec3x8 origin { to_floats(column) * step_x - size[0], to_floats(row) * step_y - size[1], height };
    const Float8 a = (p.x - origin.x) * rate_x, b = (p.y - origin.y) * rate_y;
    surface.part = top & int(TOP);
    surface.triangle = { origin, { high ? none : (Float8)step_x, high ? (Float8)step_y : none, side },
                         { (Float8)step_x, (Float8)step_y, diagonal } };
    surface.weight1 = high ? b - a : a - b;
    surface.weight2 = high ? a : b;
    const Float8 rise_x = high ? diagonal - side : side, rise_y = high ? side : diagonal - side;
    surface.normal = select(top, normalized({ -rise_x * rate_x, -rise_y * rate_y, (Float8)1.0f }), outside);
}

template <int TYPES, class Meshes>
inline void mesh_surfaces(const Meshes& meshes, const ShapeFromCamera& pose, const int* faces, Vec3x8 ray, SurfaceInteraction8& surface)
{
    constexpr bool STRETCHED = TYPES >> PER_SHAPE_SCALE & 1;
    const int start = STRETCHED ? wp::index(meshes.face_start, pose.asset()) : as_int(pose.size.x);
    const int corners = STRETCHED ? wp::index(meshes.corner_start, pose.asset()) : as_int(pose.size.y);
    Triangles triangle;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        int given;
        bool flat;
        const Triangle one = load_triangle<TYPES>(meshes, start + 3 * faces[k], get_lane(ray, k), given, flat);
        surface.corner[k] = 3 * (corners + given);
        surface.flat[k] = flat ? -1 : 0;
        set_lane(triangle.origin, k, one.origin);
        set_lane(triangle.edge1, k, one.edge1);
        set_lane(triangle.edge2, k, one.edge2);
    }
    const Vec3x8 normal = cross(triangle.edge1, triangle.edge2), place = surface.local - triangle.origin;
    const Float8 rate = rcp(max(dot(normal, normal), (Float8)MIN_NORMAL)), none = 0.0f, one = 1.0f;
    surface.triangle = triangle;
    surface.normal = normalized(normal);
    surface.weight1 = clamp(dot(cross(place, triangle.edge2), normal) * rate, none, one);
    surface.weight2 = clamp(dot(cross(triangle.edge1, place), normal) * rate, none, one - surface.weight1);
}

// Shapes that are seldom seen, one hit at a time.
template <int TYPES, class Meshes, class HeightFields>
static WARPCAM_NOINLINE void other_surfaces(const ShapeFromCamera& pose, const Meshes& meshes, const HeightFields& fields, Vec3x8 ray,
                                        SurfaceInteraction8& surface)
{
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const SurfaceInteraction one = surface_at<TYPES>(pose, meshes, fields, 0, get_lane(surface.local, k), get_lane(ray, k));
        set_lane(surface.normal, k, one.normal);
        surface.part[k] = one.part;
    }
}

template <int TYPES, class Meshes, class HeightFields>
inline void surfaces_at(const ShapeFromCamera& pose, const Meshes& meshes, const HeightFields& fields, const int* faces,
                        Vec3x8 local, Vec3x8 ray, SurfaceInteraction8& surface)
{
    constexpr int OTHERS = TYPES & (1 << CONE | 1 << BARREL);
    const int type = pose.type();
    const Vec3 size = as_vec3(pose.size);
    surface.local = local;
    surface.normal = broadcast({ 0.0f, 0.0f, 1.0f });
    surface.part = 0;
    if ((TYPES >> SPHERE & 1) && type == SPHERE)
        surface.normal = normalized(local);
    if ((TYPES >> CAPSULE & 1) && type == CAPSULE)
        capsule_surfaces(size.y, surface);
    if ((TYPES >> ELLIPSOID & 1) && type == ELLIPSOID) {
        const Vec3 rate { rcp(size.x), rcp(size.y), rcp(size.z) };
        surface.normal = normalized(mul(local, broadcast(mul(rate, rate))));
    }
    if ((TYPES >> CYLINDER & 1) && type == CYLINDER)
        cylinder_surfaces(size.x, size.y, ray, surface);
    if ((TYPES >> BOX & 1) && type == BOX)
        box_surfaces(size, ray, surface);
    if constexpr (OTHERS != 0)
        if (type == CONE || type == BARREL)
            other_surfaces<OTHERS>(pose, meshes, fields, ray, surface);
    const bool stretched = (TYPES >> PER_SHAPE_SCALE & 1) && (type == MESH || type == HEIGHT_FIELD);
    const Vec3x8 sizes = broadcast(size);
    if (stretched)
        surface.local = div(local, sizes);
    if constexpr ((TYPES >> HEIGHT_FIELD & 1) != 0)
        if (type == HEIGHT_FIELD)
            height_field_surfaces(fields, pose.asset(), faces, surface);
    if constexpr ((TYPES >> MESH & 1) != 0)
        if (type == MESH)
            mesh_surfaces<TYPES>(meshes, pose, faces, stretched ? div(ray, sizes) : ray, surface);
    if (stretched) {
        Triangles& triangle = surface.triangle;
        surface.local = local;
        surface.normal = normalized(div(surface.normal, sizes));
        triangle = { mul(triangle.origin, sizes), mul(triangle.edge1, sizes), mul(triangle.edge2, sizes) };
    }
}

template <int TYPES, class Meshes>
inline Vec3x8 smooth_normals(const ShapeFromCamera& pose, const Meshes& meshes, const SurfaceInteraction8& surface)
{
    if constexpr ((TYPES >> MESH & 1) != 0) {
        if (pose.type() == MESH) {
            constexpr bool STRETCHED = TYPES >> PER_SHAPE_SCALE & 1, LATE = TYPES >> LIT_NORMALS & 1;
            const Vec3x8 size = broadcast(as_vec3(pose.size));
            const Float8 weights[3] = { 1.0f - surface.weight1 - surface.weight2, surface.weight1, surface.weight2 },
                         none = 0.0f;
            Vec3x8 sum { none, none, none };
            for (int i = 0; i < 3; ++i) {
                Vec3x8 normal;
                for (int k = 0; k < SIMD_WIDTH; ++k)
                    set_lane(normal, k,
                            surface.flat[k] ? get_lane(surface.normal, k)
                                            : as_vec3(wp::index(meshes.normals, surface.corner[k] + i)));
                sum = sum + weights[i] * (STRETCHED && !LATE ? normalized(div(normal, size)) : normal);
            }
            if (STRETCHED && LATE)
                sum = div(sum, size);
            return select(surface.flat | ~(dot(sum, sum) > 1.0e-12f), surface.normal, normalized(sum));
        }
    }
    return surface.normal;
}

struct Facets {
    Vec3x8 place[3], normal[3];
    Float8 weight1, weight2;
};

struct Spans {
    Float8 start, length;
};

// Whether the shape's light is computed at the corners of triangles, else at each pixel.
template <int TYPES, class Appearances> inline bool lit_at_corners(const Appearances& look)
{
    const int type = look.pose.type();
    if constexpr ((TYPES >> PLANE & 1) != 0)
        if (type == PLANE)
            return look.cells.u.step != 0.0f;
    return ((TYPES >> MESH & 1) && type == MESH) || ((TYPES >> HEIGHT_FIELD & 1) && type == HEIGHT_FIELD)
        || ((TYPES >> BOX & 1) && type == BOX);
}

inline void in_quads(Vec3x8 place, Vec3x8 along, Vec3x8 across, Float8 a, Float8 b, Spans u, Spans v, Int8 mirrored,
                     Facets& facet)
{
    const Float8 none = 0.0f, one = 1.0f, least = 1.0e-20f;
    Float8 weight1 = clamp((a - u.start) * rcp(max(u.length, least)), none, one);
    Float8 weight2 = clamp((b - v.start) * rcp(max(v.length, least)), none, one);
    v = { mirrored ? v.start + v.length : v.start, mirrored ? -v.length : v.length };
    weight2 = mirrored ? one - weight2 : weight2;
    const Int8 other = weight1 + weight2 > one;
    u = { other ? u.start + u.length : u.start, other ? -u.length : u.length };
    v = { other ? v.start + v.length : v.start, other ? -v.length : v.length };
    facet.weight1 = other ? one - weight1 : weight1;
    facet.weight2 = other ? one - weight2 : weight2;
    facet.place[0] = place + (u.start - a) * along + (v.start - b) * across;
    facet.place[1] = facet.place[0] + u.length * along;
    facet.place[2] = facet.place[0] + v.length * across;
}

inline Spans box_cells(Float8 x, Float8 half)
{
    const Float8 length = 2.0f / BOX_CELLS * half;
    const Float8 i = clamp(round_down((x + half) * rcp(length)), (Float8)0.0f, (Float8)float(BOX_CELLS - 1));
    return { i * length - half, length };
}

inline Spans cells_around(const GridAxis& cells, Float8 x)
{
    const Float8 start = cells.start + cells.step * round_down((x - cells.start) * cells.inverse);
    if (cells.rest < 0.0f)
        return { start, (Float8)cells.step };
    const Int8 beyond = x > -cells.start, within = (x > cells.start) & ~beyond;
    return { within ? start : beyond ? (Float8)-cells.start : (Float8)(cells.start - cells.rest),
             within ? (Float8)cells.step : (Float8)cells.rest };
}

template <int TYPES, class Appearances, class Meshes>
inline void facets_at(const Appearances& look, const Meshes& meshes, const SurfaceInteraction8& surface, Vec3x8 place, Facets& facet)
{
    const ShapeFromCamera& pose = look.pose;
    const int type = pose.type();
    facet.place[0] = facet.place[1] = facet.place[2] = place;
    facet.weight1 = facet.weight2 = 0.0f;
    facet.normal[0] = facet.normal[1] = facet.normal[2] = seen_of(pose, surface.normal);
    if constexpr ((TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0) {
        if (type == MESH || type == HEIGHT_FIELD) {
            const Triangles& triangle = surface.triangle;
            const Int8 on = type == MESH ? (Int8)-1 : surface.part == int(TOP);
            const Vec3x8 first = seen_of(pose, triangle.origin - broadcast(pose.eye()));
            facet.weight1 = on ? surface.weight1 : (Float8)0.0f;
            facet.weight2 = on ? surface.weight2 : (Float8)0.0f;
            facet.place[0] = select(on, first, place);
            facet.place[1] = select(on, first + seen_of(pose, triangle.edge1), place);
            facet.place[2] = select(on, first + seen_of(pose, triangle.edge2), place);
        }
    }
    if constexpr ((TYPES >> MESH & 1) != 0) {
        if (type == MESH) {
            Vec3x8 normal[3];
            for (int k = 0; k < SIMD_WIDTH; ++k)
                for (int i = 0; i < 3; ++i)
                    set_lane(normal[i], k,
                            surface.flat[k] ? get_lane(surface.normal, k)
                                            : as_vec3(wp::index(meshes.normals, surface.corner[k] + i)));
            for (int i = 0; i < 3; ++i) {
                if ((TYPES >> PER_SHAPE_SCALE & 1) != 0)
                    normal[i] = select(surface.flat, normal[i],
                                       normalized(div(normal[i], broadcast(as_vec3(pose.size)))));
                facet.normal[i] = seen_of(pose, normal[i]);
            }
        }
    }
    if constexpr ((TYPES >> PLANE & 1) != 0)
        if (type == PLANE && look.cells.u.step != 0.0f)
            in_quads(place, broadcast(as_vec3(pose.axis_x)), broadcast(as_vec3(pose.axis_y)), surface.local.x,
                     surface.local.y, cells_around(look.cells.u, surface.local.x),
                     cells_around(look.cells.v, surface.local.y), (Int8)0, facet);
    if ((TYPES >> BOX & 1) && type == BOX) {
        const Int8 axis = surface.part, u_axis = axis == 0 ? (Int8)1 : (Int8)0, v_axis = axis == 2 ? (Int8)1 : (Int8)2;
        const Vec3x8 x = broadcast(as_vec3(pose.axis_x)), y = broadcast(as_vec3(pose.axis_y)),
                   z = broadcast(as_vec3(pose.axis_z));
        const Vec3x8 half = broadcast(as_vec3(pose.size));
        const Float8 a = component(surface.local, u_axis), b = component(surface.local, v_axis);
        const Int8 mirrored = (axis == 1) == (component(surface.normal, axis) > 0.0f);
        in_quads(place, select(u_axis == 0, x, y), select(v_axis == 1, y, z), a, b,
                 box_cells(a, component(half, u_axis)), box_cells(b, component(half, v_axis)), mirrored, facet);
    }
}

}  // namespace warpcam
