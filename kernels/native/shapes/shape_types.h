// Types of shapes, and what the traits of an analytic type have in common.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

// Values of types.py and, as bits, of GeometryFlag in flags.py.
enum ShapeType { PLANE, HEIGHT_FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH, CONE, BARREL, SPLATS };

// Parts of a shape that are normal to, or mapped, in their own ways. A box has its three axes instead, 0 to 2; the TOP
// of a height field is its triangles.
enum SurfacePart { SIDE, TOP, BOTTOM };

// Normal and part of a surface point.
template <class Vector> struct SurfacePoint {
    Vector normal;  // unit, outwards
    IntOf<Vector> part;  // SIDE, TOP, BOTTOM; of a box the axis
};

// Projection of a 2-D image onto a surface point, as MuJoCo lays it.
struct TextureProjection {
    bool flat;  // over a rectangle, along two axes; else around the z axis
    int u_axis, v_axis;  // flat
    bool mirrored;  // flat: v runs downwards
    Vec3 place, half;  // of the point [m], and the half extents that the image covers
    float top, scale;  // around the axis: v is `top` - elevation * `scale`; a scale of 0: v runs along the axis
};

WARPCAM_DEVICE TextureProjection flat_projection(Vec3 local, Vec3 half, int u_axis, int v_axis, bool mirrored)
{
    return { true, u_axis, v_axis, mirrored, local, half, 0.0f, 0.0f };
}

WARPCAM_DEVICE TextureProjection round_projection(Vec3 local, Vec3 half, float top, float scale)
{
    return { false, 0, 0, false, local, half, top, scale };
}

// Traits of a convex shape that fills its box: what most types have. Sizes are a user's, as in types.py, [m]; the unit
// frame is that of ShapeRecord's rows. The header of a type has besides:
//   TYPE                             its ShapeType
//   axes(size)                       half extents along the shape's axes as MuJoCo gives them to its renderer [m]
//   half_extents(size)               half extents of its box [m]; below 0 without bounds
//   bounding_radius(x, y, z)         radius of a ball around its centre that holds it [m]; MISS without bounds
//   intersect(size, o, d)            distance along a ray, in the unit frame, to where it enters; MISS where it does not.
//                                    Exit faces do not count: a camera inside a shape sees out. Branch-free, so that
//                                    rays of a CPU loop become vector code. `size`: ShapeRecord.size
//   gradient(size, at, ray)          direction of the normal at a hit in the unit frame, outwards, of any length
//   surface(size, ray, local)        normal and part at a hit, in the shape's frame [m]
//   projection(local, half, part)    projection of a 2-D texture onto a shape with these axes()
// and, if IS_ROUND, end_extent(half), the half axis along z of the ellipsoids at its ends [m]; if HAS_FACES,
// face_at(at), the number of the smooth part that a place in the unit frame is on. What kernels do by themselves for
// planes (gradient, normal, projection) is not in the plane's.
struct ConvexTraits {
    static constexpr bool IS_ROUND = false;  // lies between two equal ellipsoids: see camera/projected_extent.h
    static constexpr bool HAS_FACES = false;  // its smooth parts meet in edges that antialiasing looks for
    static constexpr bool HAS_EXIT = true;  // light inside of it is followed to where it leaves
    static constexpr bool SHADES_ITSELF = true;

    static WARPCAM_DEVICE bool is_valid(Vec3, Vec3 half) { return half.x > 0.0f && half.y > 0.0f && half.z > 0.0f; }

    // Scale from metres to the unit frame [1/m], of a shape whose half_extents() are `half`.
    static WARPCAM_DEVICE Vec3 unit_scale(Vec3, Vec3 half) { return { 1.0f / half.x, 1.0f / half.y, 1.0f / half.z }; }

    // ShapeRecord.size of a shape with this unit_scale().
    static WARPCAM_DEVICE Vec3 unit_size(Vec3, Vec3) { return { 0.0f, 0.0f, 0.0f }; }

    // Distance from the centre to the tangent plane whose unit normal is `n` [m].
    static WARPCAM_DEVICE float support(Vec3 half, Vec3 n)
    {
        return abs(n.x) * half.x + abs(n.y) * half.y + abs(n.z) * half.z;
    }

    // Fits a surface point and the scale that make the direction into a cube texture to a part of the shape.
    template <class Vector> static WARPCAM_DEVICE void fit_cube(Vec3, IntOf<Vector>, Vector&, Vector&) {}
};

// Traits of a shape around the z axis, whose size is a radius and a half length.
struct AxialTraits : ConvexTraits {
    static WARPCAM_DEVICE Vec3 axes(Vec3 size) { return { size.x, size.x, size.y }; }
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size) { return axes(size); }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number y, Number)
    {
        return sqrt(x * x + y * y);
    }
    static WARPCAM_DEVICE TextureProjection projection(Vec3 local, Vec3 half, int part)
    {
        return part == SIDE ? round_projection(local, half, 0.5f, 0.0f) : flat_projection(local, half, 0, 1, true);
    }
};

}  // namespace warpcam
