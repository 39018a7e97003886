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
        return transform_rows(*this, v);
    }
    template <class Vector = Vec3>
    WARPCAM_DEVICE Vector seen(Vector v) const  // a direction of the shape's in the camera's frame
    {
        return transform_rows_transposed(*this, v);
    }
};

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
    visit_shape<Types::GEOMETRY & ~(1 << PLANE)>(type, [&](auto shape) {
        const SurfacePoint<Vector> point = shape.surface(size, ray, local);
        surface.normal = point.normal;
        surface.part = point.part;
    });
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
