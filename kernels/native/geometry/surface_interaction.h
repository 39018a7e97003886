// The surface at a hit, in the shape's own frame.
#pragma once
#include "camera/shape_setup.h"
#include "core/vec3.h"

namespace warpcam {

// The rows take camera coordinates to the shape's own.
struct Pose {
    Row axis_x, axis_y, axis_z;  // w: bits of the centre of projection, x, y, z, in the shape's frame [m]
    // As in types.py; of a mesh that is not SCALED bits of Meshes.face_start and Meshes.corner_start.
    // w: shape type + 16 * (asset + 1).
    Row size;

    WARPCAM_FN int type() const { return size.w & 15; }
    WARPCAM_FN int asset() const { return (size.w >> 4) - 1; }
    WARPCAM_FN Vec eye() const { return { as_float(axis_x.w), as_float(axis_y.w), as_float(axis_z.w) }; }
    WARPCAM_FN Vec local(Vec v) const  // of a direction in the camera's frame
    {
        return { axis_x.x * v.x + axis_x.y * v.y + axis_x.z * v.z, axis_y.x * v.x + axis_y.y * v.y + axis_y.z * v.z,
                 axis_z.x * v.x + axis_z.y * v.y + axis_z.z * v.z };
    }
    WARPCAM_FN Vec seen(Vec v) const  // a direction of the shape's in the camera's frame
    {
        return { axis_x.x * v.x + axis_y.x * v.y + axis_z.x * v.z, axis_x.y * v.x + axis_y.y * v.y + axis_z.y * v.z,
                 axis_x.z * v.x + axis_y.z * v.y + axis_z.z * v.z };
    }
};

// Parts of a shape that are normal to, or mapped, in their own ways. A box has its three axes instead, 0 to 2; the TOP
// of a height field is its triangles.
enum SurfacePart { SIDE, TOP, BOTTOM };

// A face of a mesh or a height field: its first corner, and from there to the others.
struct Triangle {
    Vec origin, edge1, edge2;
};

struct Surface {
    Vec local;               // the hit [m]
    Vec normal;              // unit, outwards, of the geometry itself: a mesh's flat face
    int part;                // SIDE, TOP, BOTTOM; of a box the axis
    int corner;              // mesh: first corner of the face in Meshes.normals and Meshes.uvs
    bool flat;               // mesh: `normal` is that of its corners, too, and Meshes.normals is not to be read
    Triangle triangle;       // mesh, height field
    float weight1, weight2;  // barycentric weights of the triangle's second and third corner
};

// On each axis a ray can enter by one side only; the hit is on the nearest of the three.
WARPCAM_FN void box_surface(Vec half, Vec ray, Surface& surface)
{
    const float x = magnitude(half.x + sign(ray.x) * surface.local.x);
    const float y = magnitude(half.y + sign(ray.y) * surface.local.y);
    const float z = magnitude(half.z + sign(ray.z) * surface.local.z);
    const int axis = y < x ? (z < y ? 2 : 1) : (z < x ? 2 : 0);
    surface.part = axis;
    surface.normal = axis_vector(axis, -sign(component(ray, axis)));
}

// The side, or the cap by which the ray can enter, whichever is nearer to the hit.
WARPCAM_FN void cylinder_surface(float radius, float half_length, Vec ray, Surface& surface)
{
    const Vec p = surface.local;
    const float axial = root(p.x * p.x + p.y * p.y);
    surface.part = SIDE;
    surface.normal = normalized({ p.x, p.y, 0.0f });
    if (magnitude(half_length + sign(ray.z) * p.z) < magnitude(radius - axial)) {
        surface.part = ray.z < 0.0f ? TOP : BOTTOM;
        surface.normal = { 0.0f, 0.0f, -sign(ray.z) };
    }
}

// The normal points away from the nearest point of the axis.
WARPCAM_FN void capsule_surface(float half_length, Surface& surface)
{
    const Vec p = surface.local;
    surface.part = p.z > half_length ? TOP : p.z < -half_length ? BOTTOM : SIDE;
    surface.normal = normalized({ p.x, p.y, p.z - between(p.z, -half_length, half_length) });
}

// The normal is the gradient of the sum of (x / half)^2.
WARPCAM_FN void ellipsoid_surface(Vec half, Surface& surface)
{
    const Vec rate { reciprocal(half.x), reciprocal(half.y), reciprocal(half.z) };
    surface.normal = normalized(times(times(surface.local, rate), rate));
}

WARPCAM_FN void cone_surface(float radius, float half_length, Vec ray, Surface& surface)
{
    const Vec p = surface.local;
    const float axial = root(p.x * p.x + p.y * p.y), length = 2.0f * half_length, rate = reciprocal(upper(axial, TINY));
    surface.part = SIDE;
    surface.normal = normalized({ length * rate * p.x, length * rate * p.y, radius });
    // how far the hit is from the base, and from the side along the radius
    const float gap = magnitude(radius * (half_length - p.z) - length * axial) * reciprocal(length);
    if (ray.z > 0.0f && magnitude(p.z + half_length) < gap) {
        surface.part = BOTTOM;
        surface.normal = { 0.0f, 0.0f, -1.0f };
    }
}

// As a cylinder, but for the normals of its side, which point away from the middle of the arc.
WARPCAM_FN void barrel_surface(Vec size, Vec ray, Surface& surface)
{
    const Vec p = surface.local;
    const float axial = root(p.x * p.x + p.y * p.y), arc = size.z > 0.0f ? upper(size.z, size.y) : STRAIGHT;
    const float end = root(upper(arc * arc - size.y * size.y, 0.0f)), past = axial - size.x;
    const float rate = (past + end) * reciprocal(upper(axial, TINY));
    surface.part = SIDE;
    surface.normal = normalized({ rate * p.x, rate * p.y, p.z });
    const float gap = (past * (past + 2.0f * end) + p.z * p.z - size.y * size.y) * reciprocal(2.0f * arc);
    if (magnitude(size.y + sign(ray.z) * p.z) < magnitude(gap)) {
        surface.part = ray.z < 0.0f ? TOP : BOTTOM;
        surface.normal = { 0.0f, 0.0f, -sign(ray.z) };
    }
}

// One cell of a height field has two triangles: 0 lies below its diagonal from (row, column) to (row + 1, column + 1),
// 1 above.
template <class HeightFields>
WARPCAM_FN void height_field_surface(const HeightFields& fields, int field, int face, Surface& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    const Vec p = surface.local;
    if (face < 0 || face >= 2 * (rows - 1) * (columns - 1)) {
        const float gap_x = magnitude(size[0] - magnitude(p.x)), gap_y = magnitude(size[1] - magnitude(p.y));
        const float gap_z = magnitude(p.z + size[3]);
        surface.normal = gap_x < gap_y ? Vec { sign(p.x), 0.0f, 0.0f } : Vec { 0.0f, sign(p.y), 0.0f };
        if (gap_z < gap_x && gap_z < gap_y)
            surface.normal = { 0.0f, 0.0f, -1.0f };
        return;
    }
    const unsigned cell = unsigned(face) >> 1, row = cell / unsigned(columns - 1), column = cell - row * (columns - 1);
    const bool high = face & 1;
    const float rate_x = float(columns - 1) * reciprocal(2.0f * size[0]), step_x = reciprocal(rate_x);
    const float rate_y = float(rows - 1) * reciprocal(2.0f * size[1]), step_y = reciprocal(rate_y);
    const int first = wp::index(fields.height_start, field) + int(row) * columns + int(column);
    const float* heights = fields.heights.data + first;
    const float height = heights[0], diagonal = heights[columns + 1] - height;
    const float side = heights[high ? columns : 1] - height;
    const Vec origin { float(int(column)) * step_x - size[0], float(int(row)) * step_y - size[1], height };
    const float a = (p.x - origin.x) * rate_x, b = (p.y - origin.y) * rate_y;
    surface.part = TOP;
    surface.triangle = { origin, { high ? 0.0f : step_x, high ? step_y : 0.0f, side }, { step_x, step_y, diagonal } };
    surface.weight1 = high ? b - a : a - b;
    surface.weight2 = high ? a : b;
    const float rise_x = high ? diagonal - side : side, rise_y = high ? side : diagonal - side;
    surface.normal = normalized({ -rise_x * rate_x, -rise_y * rate_y, 1.0f });
}

template <class Meshes> WARPCAM_FN Row face_row(const Meshes& meshes, int row)
{
#if defined(__CUDA_ARCH__)
    const float4 r = __ldg(reinterpret_cast<const float4*>(meshes.faces.data) + row);
    return { r.x, r.y, r.z, __float_as_int(r.w) };
#else
    const auto& r = meshes.faces.data[row];
    return { r[0], r[1], r[2], as_int(r[3]) };
#endif
}

// The face that stands in a row, as the mesh's or, seen from behind, as its back, whose corners go the other way round.
template <int TYPES, class Meshes>
WARPCAM_FN Triangle load_triangle(const Meshes& meshes, int row, Vec ray, int& given, bool& flat)
{
    const Row first = face_row(meshes, row), second = face_row(meshes, row + 1), third = face_row(meshes, row + 2);
    const Vec origin = to_vec(first), edge1 = to_vec(second) - origin, edge2 = to_vec(third) - origin;
    given = first.w;
    flat = is_flat<TYPES>(second.w, third.w);
    if (has_back<TYPES>(second.w) && dot(cross(edge1, edge2), ray) > 0.0f) {
        given = second.w;
        return { origin, edge2, edge1 };
    }
    return { origin, edge1, edge2 };
}

// `face` counts the mesh's faces in leaf order; `ray` is in the mesh's own coordinates.
template <int TYPES, class Meshes>
WARPCAM_FN void mesh_surface(const Meshes& meshes, const Pose& pose, int face, Vec ray, Surface& surface)
{
    constexpr bool STRETCHED = TYPES >> SCALED & 1;
    const int faces = STRETCHED ? wp::index(meshes.face_start, pose.asset()) : as_int(pose.size.x);
    const int corners = STRETCHED ? wp::index(meshes.corner_start, pose.asset()) : as_int(pose.size.y);
    int given;
    const Triangle triangle = load_triangle<TYPES>(meshes, faces + 3 * face, ray, given, surface.flat);
    const Vec normal = cross(triangle.edge1, triangle.edge2), place = surface.local - triangle.origin;
    const float rate = reciprocal(upper(dot(normal, normal), TINY));
    surface.corner = 3 * (corners + given);
    surface.triangle = triangle;
    surface.normal = normalized(normal);
    surface.weight1 = between(dot(cross(place, triangle.edge2), normal) * rate, 0.0f, 1.0f);
    surface.weight2 = between(dot(cross(triangle.edge1, place), normal) * rate, 0.0f, 1.0f - surface.weight1);
}

WARPCAM_FN Vec divided(Vec a, Vec b) { return { a.x / b.x, a.y / b.y, a.z / b.z }; }

// `local` is the hit and `ray` the direction it was seen along, of any length, in the shape's frame; `face` is what the
// trace found there.
template <int TYPES, class Meshes, class HeightFields>
WARPCAM_FN Surface surface_at(const Pose& pose, const Meshes& meshes, const HeightFields& fields, int face, Vec local,
                              Vec ray)
{
    const int type = pose.type();
    const Vec size = to_vec(pose.size);
    Surface surface {};
    surface.local = local;
    surface.normal = { 0.0f, 0.0f, 1.0f };
    if ((TYPES >> SPHERE & 1) && type == SPHERE)
        surface.normal = normalized(local);
    if ((TYPES >> CAPSULE & 1) && type == CAPSULE)
        capsule_surface(size.y, surface);
    if ((TYPES >> ELLIPSOID & 1) && type == ELLIPSOID)
        ellipsoid_surface(size, surface);
    if ((TYPES >> CYLINDER & 1) && type == CYLINDER)
        cylinder_surface(size.x, size.y, ray, surface);
    if ((TYPES >> BOX & 1) && type == BOX)
        box_surface(size, ray, surface);
    if ((TYPES >> CONE & 1) && type == CONE)
        cone_surface(size.x, size.y, ray, surface);
    if ((TYPES >> BARREL & 1) && type == BARREL)
        barrel_surface(size, ray, surface);
    const bool stretched = (TYPES >> SCALED & 1) && (type == MESH || type == HEIGHT_FIELD);
    if (stretched)
        surface.local = divided(local, size);
    if ((TYPES >> HEIGHT_FIELD & 1) && type == HEIGHT_FIELD)
        height_field_surface(fields, pose.asset(), face, surface);
    if ((TYPES >> MESH & 1) && type == MESH)
        mesh_surface<TYPES>(meshes, pose, face, stretched ? divided(ray, size) : ray, surface);
    if (stretched) {
        Triangle& triangle = surface.triangle;
        surface.local = local;
        surface.normal = normalized(divided(surface.normal, size));
        triangle = { times(triangle.origin, size), times(triangle.edge1, size), times(triangle.edge2, size) };
    }
    return surface;
}

// The unit normal of a smooth surface, in the shape's frame. LIT_NORMALS: scaled after it is interpolated, as Newton's
// camera does.
template <int TYPES, class Meshes>
WARPCAM_FN Vec smooth_normal(const Pose& pose, const Meshes& meshes, const Surface& surface)
{
    if ((TYPES >> MESH & 1) && pose.type() == MESH && !surface.flat) {
        const float weights[3] = { 1.0f - surface.weight1 - surface.weight2, surface.weight1, surface.weight2 };
        Vec sum { 0.0f, 0.0f, 0.0f };
        for (int k = 0; k < 3; ++k) {
            Vec normal = to_vec(wp::index(meshes.normals, surface.corner + k));
            if ((TYPES >> SCALED & 1) && !(TYPES >> LIT_NORMALS & 1))
                normal = normalized(divided(normal, to_vec(pose.size)));
            sum = sum + weights[k] * normal;
        }
        if ((TYPES >> SCALED & 1) && (TYPES >> LIT_NORMALS & 1))
            sum = divided(sum, to_vec(pose.size));
        return dot(sum, sum) > 1.0e-12f ? normalized(sum) : surface.normal;
    }
    return surface.normal;
}

}  // namespace warpcam
