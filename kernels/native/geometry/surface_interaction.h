// The surface at a hit, in the shape's own frame.
#pragma once
#include "core/scalar_or_simd.h"
#include "camera/shape_setup.h"

namespace warpcam {

// The rows take camera coordinates to the shape's own.
struct ShapeFromCamera {
    Float3Int axis_x, axis_y, axis_z;  // w: bits of the centre of projection, x, y, z, in the shape's frame [m]
    // Size as in types.py; for a mesh without PER_SHAPE_SCALE, bits of Meshes.face_start and Meshes.corner_start. w:
    // shape type + 16 * (asset + 1).
    Float3Int size;

    WARPCAM_DEVICE int type() const { return size.w & 15; }
    WARPCAM_DEVICE int asset() const { return (size.w >> 4) - 1; }
    WARPCAM_DEVICE Vec3 eye() const { return { as_float(axis_x.w), as_float(axis_y.w), as_float(axis_z.w) }; }
    template <class Vector = Vec3> WARPCAM_DEVICE Vector local(Vector v) const  // of a direction in the camera's frame
    {
        return { axis_x.x * v.x + axis_x.y * v.y + axis_x.z * v.z, axis_y.x * v.x + axis_y.y * v.y + axis_y.z * v.z,
                 axis_z.x * v.x + axis_z.y * v.y + axis_z.z * v.z };
    }
    template <class Vector = Vec3>
    WARPCAM_DEVICE Vector seen(Vector v) const  // a direction of the shape's in the camera's frame
    {
        return { axis_x.x * v.x + axis_y.x * v.y + axis_z.x * v.z, axis_x.y * v.x + axis_y.y * v.y + axis_z.y * v.z,
                 axis_x.z * v.x + axis_y.z * v.y + axis_z.z * v.z };
    }
};

// Parts of a shape that are normal to, or mapped, in their own ways. A box has its three axes instead, 0 to 2; the TOP
// of a height field is its triangles.
enum SurfacePart { SIDE, TOP, BOTTOM };

// A face of a mesh or a height field: its first corner, and from there to the others.
template <class Vector> struct TriangleOf {
    Vector origin, edge1, edge2;
};

template <class Vector> struct SurfaceInteractionOf {
    Vector local;  // the hit [m]
    Vector normal;  // unit, outwards, of the geometry itself: a mesh's flat face
    IntOf<Vector> part;  // SIDE, TOP, BOTTOM; of a box the axis
    IntOf<Vector> corner;  // mesh: first corner of the face in Meshes.normals and Meshes.uvs
    MaskOf<Vector> flat;  // mesh: `normal` is that of its corners, too, and Meshes.normals is not to be read
    TriangleOf<Vector> triangle;  // mesh, height field
    NumberOf<Vector> weight1, weight2;  // barycentric weights of the triangle's second and third corner
};

using Triangle = TriangleOf<Vec3>;
using SurfaceInteraction = SurfaceInteractionOf<Vec3>;

// On each axis a ray can enter by one side only; the hit is on the nearest of the three.
template <class Vector> WARPCAM_DEVICE void box_surface(Vec3 half, Vector ray, SurfaceInteractionOf<Vector>& surface)
{
    using Int = IntOf<Vector>;
    const auto x = abs(half.x + sign(ray.x) * surface.local.x);
    const auto y = abs(half.y + sign(ray.y) * surface.local.y);
    const auto z = abs(half.z + sign(ray.z) * surface.local.z);
    const Int axis = y < x ? (z < y ? (Int)2 : (Int)1) : (z < x ? (Int)2 : (Int)0);
    surface.part = axis;
    surface.normal = axis_vector(axis, -sign(component(ray, axis)));
}

// The side, or the cap by which the ray can enter, whichever is nearer to the hit.
template <class Vector>
WARPCAM_DEVICE void cylinder_surface(float radius, float half_length, Vector ray, SurfaceInteractionOf<Vector>& surface)
{
    using Number = NumberOf<Vector>;
    using Int = IntOf<Vector>;
    const Vector p = surface.local;
    const Number none = 0.0f, axial = sqrt(p.x * p.x + p.y * p.y);
    const auto on_cap = abs(half_length + sign(ray.z) * p.z) < abs(radius - axial);
    surface.part = on_cap ? (ray.z < 0.0f ? (Int)TOP : (Int)BOTTOM) : (Int)SIDE;
    surface.normal = select(on_cap, Vector { none, none, -sign(ray.z) }, normalized(Vector { p.x, p.y, none }));
}

// The normal points away from the nearest point of the axis.
template <class Vector>
WARPCAM_DEVICE void capsule_surface(NumberOf<Vector> half_length, SurfaceInteractionOf<Vector>& surface)
{
    using Int = IntOf<Vector>;
    const Vector p = surface.local;
    surface.part = p.z > half_length ? (Int)TOP : p.z < -half_length ? (Int)BOTTOM : (Int)SIDE;
    surface.normal = normalized(Vector { p.x, p.y, p.z - clamp(p.z, -half_length, half_length) });
}

// The normal is the gradient of the sum of (x / half)^2.
WARPCAM_DEVICE void ellipsoid_surface(Vec3 half, SurfaceInteraction& surface)
{
    const Vec3 rate { rcp(half.x), rcp(half.y), rcp(half.z) };
    surface.normal = normalized(mul(mul(surface.local, rate), rate));
}

WARPCAM_DEVICE void cone_surface(Vec3 size, Vec3 ray, SurfaceInteraction& surface)
{
    const float radius = size.x, half_length = size.y;
    const Vec3 p = surface.local;
    const float axial = sqrt(p.x * p.x + p.y * p.y), length = 2.0f * half_length, rate = rcp(max(axial, MIN_NORMAL));
    surface.part = SIDE;
    surface.normal = normalized(Vec3 { length * rate * p.x, length * rate * p.y, radius });
    // how far the hit is from the base, and from the side along the radius
    const float gap = abs(radius * (half_length - p.z) - length * axial) * rcp(length);
    if (ray.z > 0.0f && abs(p.z + half_length) < gap) {
        surface.part = BOTTOM;
        surface.normal = { 0.0f, 0.0f, -1.0f };
    }
}

// Surface of a barrel: a cylinder's, except that normals of the side point away from the middle of the arc.
WARPCAM_DEVICE void barrel_surface(Vec3 size, Vec3 ray, SurfaceInteraction& surface)
{
    const Vec3 p = surface.local;
    const float axial = sqrt(p.x * p.x + p.y * p.y), arc = size.z > 0.0f ? max(size.z, size.y) : STRAIGHT;
    const float end = sqrt(max(arc * arc - size.y * size.y, 0.0f)), past = axial - size.x;
    const float rate = (past + end) * rcp(max(axial, MIN_NORMAL));
    surface.part = SIDE;
    surface.normal = normalized(Vec3 { rate * p.x, rate * p.y, p.z });
    const float gap = (past * (past + 2.0f * end) + p.z * p.z - size.y * size.y) * rcp(2.0f * arc);
    if (abs(size.y + sign(ray.z) * p.z) < abs(gap)) {
        surface.part = ray.z < 0.0f ? TOP : BOTTOM;
        surface.normal = { 0.0f, 0.0f, -sign(ray.z) };
    }
}

// The normal of a height field's sides and base. `size` is HeightFields.size.
template <class Size, class Vector> WARPCAM_DEVICE Vector height_field_side(const Size& size, Vector p)
{
    using Number = NumberOf<Vector>;
    const Number gap_x = abs(size[0] - abs(p.x)), gap_y = abs(size[1] - abs(p.y));
    const Number gap_z = abs(p.z + size[3]), none = 0.0f, down = -1.0f;
    const Vector beside = select(gap_x < gap_y, Vector { sign(p.x), none, none }, Vector { none, sign(p.y), none });
    return select((gap_z < gap_x) & (gap_z < gap_y), Vector { none, none, down }, beside);
}

// One cell of a height field has two triangles: 0 lies below its diagonal from (row, column) to (row + 1, column + 1),
// 1 above. `height` is that of the first corner, `diagonal` and `side` are how far the opposite and the third lie above
// it.
template <class Size, class Vector>
WARPCAM_DEVICE void height_field_top(const Size& size, int rows, int columns, NumberOf<Vector> row,
                                     NumberOf<Vector> column, MaskOf<Vector> high, NumberOf<Vector> height,
                                     NumberOf<Vector> diagonal, NumberOf<Vector> side,
                                     SurfaceInteractionOf<Vector>& surface)
{
    using Number = NumberOf<Vector>;
    const Number none = 0.0f, one = 1.0f;
    const float rate_x = float(columns - 1) * rcp(2.0f * size[0]), rate_y = float(rows - 1) * rcp(2.0f * size[1]);
    const Number step_x = rcp(rate_x), step_y = rcp(rate_y);
    const Vector origin { column * step_x - size[0], row * step_y - size[1], height };
    const Number a = (surface.local.x - origin.x) * rate_x, b = (surface.local.y - origin.y) * rate_y;
    surface.triangle = { origin, { high ? none : step_x, high ? step_y : none, side }, { step_x, step_y, diagonal } };
    surface.weight1 = high ? b - a : a - b;
    surface.weight2 = high ? a : b;
    const Number rise_x = high ? diagonal - side : side, rise_y = high ? side : diagonal - side;
    surface.normal = normalized(Vector { -rise_x * rate_x, -rise_y * rate_y, one });
}

template <class HeightFields>
WARPCAM_DEVICE void height_field_surface(const HeightFields& fields, int field, int face, SurfaceInteraction& surface)
{
    const int rows = wp::index(fields.rows, field), columns = wp::index(fields.columns, field);
    const auto size = wp::index(fields.size, field);
    if (face < 0 || face >= 2 * (rows - 1) * (columns - 1)) {
        surface.normal = height_field_side(size, surface.local);
        return;
    }
    const unsigned cell = unsigned(face) >> 1, row = cell / unsigned(columns - 1), column = cell - row * (columns - 1);
    const bool high = face & 1;
    const int first = wp::index(fields.height_start, field) + int(row) * columns + int(column);
    const float* heights = fields.heights.data + first;
    const float height = heights[0], diagonal = heights[columns + 1] - height;
    const float side = heights[high ? columns : 1] - height;
    surface.part = TOP;
    height_field_top(size, rows, columns, float(int(row)), float(int(column)), high, height, diagonal, side, surface);
}

template <class Meshes> WARPCAM_DEVICE Float3Int face_row(const Meshes& meshes, int row)
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
template <class Types, class Meshes>
WARPCAM_DEVICE Triangle load_triangle(const Meshes& meshes, int row, Vec3 ray, int& given, bool& flat)
{
    const Float3Int first = face_row(meshes, row), second = face_row(meshes, row + 1),
                    third = face_row(meshes, row + 2);
    const Vec3 origin = as_vec3(first), edge1 = as_vec3(second) - origin, edge2 = as_vec3(third) - origin;
    given = first.w;
    flat = is_flat<Types>(second.w, third.w);
    if (has_back<Types>(second.w) && dot(cross(edge1, edge2), ray) > 0.0f) {
        given = second.w;
        return { origin, edge2, edge1 };
    }
    return { origin, edge1, edge2 };
}

// The flat normal and the barycentric weights of a hit on its triangle.
template <class Vector> WARPCAM_DEVICE void triangle_surface(SurfaceInteractionOf<Vector>& surface)
{
    using Number = NumberOf<Vector>;
    const TriangleOf<Vector>& triangle = surface.triangle;
    const Vector normal = cross(triangle.edge1, triangle.edge2), place = surface.local - triangle.origin;
    const Number rate = rcp(max(dot(normal, normal), MIN_NORMAL)), none = 0.0f, one = 1.0f;
    surface.normal = normalized(normal);
    surface.weight1 = clamp(dot(cross(place, triangle.edge2), normal) * rate, none, one);
    surface.weight2 = clamp(dot(cross(triangle.edge1, place), normal) * rate, none, one - surface.weight1);
}

// Rows of Meshes.faces and corners that a mesh begins at.
struct MeshStart {
    int faces, corners;
};

template <class Types, class Meshes>
WARPCAM_DEVICE MeshStart mesh_start(const Meshes& meshes, const ShapeFromCamera& pose)
{
    if constexpr (Types::has(PER_SHAPE_SCALE))
        return { wp::index(meshes.face_start, pose.asset()), wp::index(meshes.corner_start, pose.asset()) };
    return { as_int(pose.size.x), as_int(pose.size.y) };
}

// `face` counts the mesh's faces in leaf order; `ray` is in the mesh's own coordinates.
template <class Types, class Meshes> WARPCAM_DEVICE void mesh_surface(const Meshes& meshes, const ShapeFromCamera& pose,
                                                                      int face, Vec3 ray, SurfaceInteraction& surface)
{
    const MeshStart start = mesh_start<Types>(meshes, pose);
    int given;
    surface.triangle = load_triangle<Types>(meshes, start.faces + 3 * face, ray, given, surface.flat);
    surface.corner = 3 * (start.corners + given);
    triangle_surface(surface);
}

// `surface` comes in with the hit as its `local`; `ray` is the direction that it was seen along, of any length, in the
// shape's frame; `face` is what the trace found there.
template <class Types, class Meshes, class HeightFields, class Face, class Vector>
WARPCAM_DEVICE void find_surface(const ShapeFromCamera& pose, const Meshes& meshes, const HeightFields& fields,
                                 const Face& face, Vector ray, SurfaceInteractionOf<Vector>& surface)
{
    const int type = pose.type();
    const Vec3 size = as_vec3(pose.size);
    const Vector local = surface.local, sizes = broadcast<Vector>(size);
    surface.normal = broadcast<Vector>({ 0.0f, 0.0f, 1.0f });
    if constexpr (Types::has(PLANES_FROM_BEHIND))
        surface.normal.z = -sign(ray.z);  // of a plane; of all else it is written below
    surface.part = 0;
    if (Types::has(SPHERE) && type == SPHERE)
        surface.normal = normalized(local);
    if (Types::has(CAPSULE) && type == CAPSULE)
        capsule_surface<Vector>(size.y, surface);
    if (Types::has(ELLIPSOID) && type == ELLIPSOID)
        ellipsoid_surface(size, surface);
    if (Types::has(CYLINDER) && type == CYLINDER)
        cylinder_surface(size.x, size.y, ray, surface);
    if (Types::has(BOX) && type == BOX)
        box_surface(size, ray, surface);
    if constexpr (Types::has(CONE))
        if (type == CONE)
            cone_surface(size, ray, surface);
    if constexpr (Types::has(BARREL))
        if (type == BARREL)
            barrel_surface(size, ray, surface);
    const bool stretched = Types::has(PER_SHAPE_SCALE) && (type == MESH || type == HEIGHT_FIELD);
    if (stretched)
        surface.local = div(local, sizes);
    if constexpr (Types::has(HEIGHT_FIELD))
        if (type == HEIGHT_FIELD)
            height_field_surface(fields, pose.asset(), face, surface);
    if constexpr (Types::has(MESH))
        if (type == MESH)
            mesh_surface<Types>(meshes, pose, face, stretched ? div(ray, sizes) : ray, surface);
    if (stretched) {
        TriangleOf<Vector>& triangle = surface.triangle;
        surface.local = local;
        surface.normal = normalized(div(surface.normal, sizes));
        triangle = { mul(triangle.origin, sizes), mul(triangle.edge1, sizes), mul(triangle.edge2, sizes) };
    }
}

template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE SurfaceInteraction surface_at(const ShapeFromCamera& pose, const Meshes& meshes,
                                             const HeightFields& fields, int face, Vec3 local, Vec3 ray)
{
    SurfaceInteraction surface {};
    surface.local = local;
    find_surface<Types>(pose, meshes, fields, face, ray, surface);
    return surface;
}

// The normal at corner `i` of the triangle.
template <class Meshes>
WARPCAM_DEVICE Vec3 vertex_normal(const Meshes& meshes, const SurfaceInteraction& surface, int i)
{
    return as_vec3(wp::index(meshes.normals, surface.corner + i));
}

// The unit normal of a smooth surface, in the shape's frame. LIT_NORMALS: scaled after it is interpolated, as Newton's
// camera does.
template <class Types, class Meshes, class Vector>
WARPCAM_DEVICE Vector smooth_normal(const ShapeFromCamera& pose, const Meshes& meshes,
                                    const SurfaceInteractionOf<Vector>& surface)
{
    if constexpr (Types::has(MESH)) {
        if (pose.type() == MESH && any(!surface.flat)) {
            using Number = NumberOf<Vector>;
            constexpr bool STRETCHED = Types::has(PER_SHAPE_SCALE), LATE = Types::has(LIT_NORMALS);
            const Vector size = broadcast<Vector>(as_vec3(pose.size));
            const Number weights[3] = { 1.0f - surface.weight1 - surface.weight2, surface.weight1, surface.weight2 };
            Vector sum = broadcast<Vector>({ 0.0f, 0.0f, 0.0f });
            for (int i = 0; i < 3; ++i) {
                const Vector normal = vertex_normal(meshes, surface, i);
                sum = sum + weights[i] * (STRETCHED && !LATE ? normalized(div(normal, size)) : normal);
            }
            if (STRETCHED && LATE)
                sum = div(sum, size);
            return select(surface.flat | !(dot(sum, sum) > 1.0e-12f), surface.normal, normalized(sum));
        }
    }
    return surface.normal;
}

}  // namespace warpcam
