// The surface at a hit, in the shape's own frame.
#pragma once
#include "prepare.h"
#include "vectors.h"

namespace warpcam {

// The rows take camera coordinates to the shape's own.
struct Pose {
    Row axis_x, axis_y, axis_z;  // w: bits of the centre of projection, x, y, z, in the shape's frame [m]
    Row size;                    // as in types.py; w: shape type + 8 * (asset + 1)

    WARPCAM_FN int type() const { return size.w & 7; }
    WARPCAM_FN int asset() const { return (size.w >> 3) - 1; }
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

struct Surface {
    Vec local;     // the hit [m]
    Vec normal;    // unit, outwards, of the geometry itself: a mesh's flat face
    int part;      // SIDE, TOP, BOTTOM; of a box the axis
    int row;       // mesh: first row of the face in Meshes.faces
    int corner;    // mesh: first corner of the face in Meshes.normals and Meshes.uvs
    float weight1, weight2;  // mesh: barycentric weights of the face's second and third corner
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
    const Vec rate { inverse(half.x), inverse(half.y), inverse(half.z) };
    surface.normal = normalized(times(times(surface.local, rate), rate));
}

// One cell of a height field and which of its triangles: 0 lies below its diagonal from (row, column) to
// (row + 1, column + 1), 1 above.
struct Cell {
    int row, column, half;
    float step_x, step_y;                // sides [m]
    float height, along, across, corner;  // of (row, column), one column on, one row on, and both on [m]
};

template <class HeightFields> WARPCAM_FN Cell load_cell(const HeightFields& fields, int field, int face)
{
    const int columns = wp::index(fields.columns, field), rows = wp::index(fields.rows, field);
    const auto size = wp::index(fields.size, field);
    Cell cell;
    cell.half = face & 1;
    cell.row = (face >> 1) / (columns - 1);
    cell.column = (face >> 1) - cell.row * (columns - 1);
    cell.step_x = 2.0f * size[0] * inverse(float(columns - 1));
    cell.step_y = 2.0f * size[1] * inverse(float(rows - 1));
    const int first = wp::index(fields.height_start, field) + cell.row * columns + cell.column;
    cell.height = wp::index(fields.heights, first);
    cell.along = wp::index(fields.heights, first + 1);
    cell.across = wp::index(fields.heights, first + columns);
    cell.corner = wp::index(fields.heights, first + columns + 1);
    return cell;
}

template <class HeightFields>
WARPCAM_FN void height_field_surface(const HeightFields& fields, int field, int face, Surface& surface)
{
    const int cells = 2 * (wp::index(fields.rows, field) - 1) * (wp::index(fields.columns, field) - 1);
    if (face >= 0 && face < cells) {
        const Cell cell = load_cell(fields, field, face);
        const float rise_x = cell.half ? cell.corner - cell.across : cell.along - cell.height;
        const float rise_y = cell.half ? cell.across - cell.height : cell.corner - cell.along;
        surface.part = TOP;
        surface.normal = normalized({ -rise_x * inverse(cell.step_x), -rise_y * inverse(cell.step_y), 1.0f });
        return;
    }
    const auto size = wp::index(fields.size, field);
    const Vec p = surface.local;
    const float gap_x = magnitude(size[0] - magnitude(p.x)), gap_y = magnitude(size[1] - magnitude(p.y));
    const float gap_z = magnitude(p.z + size[3]);
    surface.part = SIDE;
    if (gap_z < gap_x && gap_z < gap_y)
        surface.normal = { 0.0f, 0.0f, -1.0f };
    else if (gap_x < gap_y)
        surface.normal = { sign(p.x), 0.0f, 0.0f };
    else
        surface.normal = { 0.0f, sign(p.y), 0.0f };
}

// A face of a mesh: its first corner, and from there to the others.
struct Triangle {
    Vec origin, edge1, edge2;
};

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

template <class Meshes> WARPCAM_FN Triangle load_triangle(const Meshes& meshes, int row, int& given)
{
    const Row first = face_row(meshes, row);
    given = first.w;
    const Vec origin = to_vec(first);
    return { origin, to_vec(face_row(meshes, row + 1)) - origin, to_vec(face_row(meshes, row + 2)) - origin };
}

// `face` counts the mesh's faces in leaf order.
template <class Meshes>
WARPCAM_FN void mesh_surface(const Meshes& meshes, int mesh, int face, Surface& surface, Triangle& triangle)
{
    int given;
    surface.row = wp::index(meshes.face_start, mesh) + 3 * face;
    triangle = load_triangle(meshes, surface.row, given);
    surface.corner = 3 * (wp::index(meshes.corner_start, mesh) + given);
    const Vec normal = cross(triangle.edge1, triangle.edge2), place = surface.local - triangle.origin;
    const float square = inverse(upper(dot(normal, normal), TINY));
    surface.part = SIDE;
    surface.normal = normalized(normal);
    surface.weight1 = between(dot(cross(place, triangle.edge2), normal) * square, 0.0f, 1.0f);
    surface.weight2 = between(dot(cross(triangle.edge1, place), normal) * square, 0.0f, 1.0f - surface.weight1);
}

// `local` is the hit and `ray` the direction it was seen along, of any length, in the shape's frame; `face` is what the
// trace found there. `triangle` is that of a mesh.
template <int TYPES, class Meshes, class HeightFields>
WARPCAM_FN Surface surface_at(const Pose& pose, const Meshes& meshes, const HeightFields& fields, int face, Vec local,
                              Vec ray, Triangle& triangle)
{
    const int type = pose.type();
    const Vec size = to_vec(pose.size);
    Surface surface { local, { 0.0f, 0.0f, 1.0f }, SIDE, 0, 0, 0.0f, 0.0f };
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
    if ((TYPES >> HEIGHT_FIELD & 1) && type == HEIGHT_FIELD)
        height_field_surface(fields, pose.asset(), face, surface);
    if ((TYPES >> MESH & 1) && type == MESH)
        mesh_surface(meshes, pose.asset(), face, surface, triangle);
    return surface;
}

}  // namespace warpcam
