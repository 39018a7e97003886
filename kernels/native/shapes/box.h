// A box of three half widths. The unit frame's is the cube of half width 1.
#pragma once
#include "shapes/shape_types.h"

namespace warpcam {

struct BoxTraits : ConvexTraits {
    static constexpr ShapeType TYPE = BOX;
    static constexpr bool HAS_FACES = true;

    static WARPCAM_DEVICE Vec3 axes(Vec3 size) { return size; }
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size) { return size; }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number y, Number z)
    {
        return sqrt(x * x + y * y + z * z);
    }

    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int&, Vector o, Vector d)
    {
        using Number = NumberOf<Vector>;
        const Number ix = rcp(avoid_zero(d.x)), iy = rcp(avoid_zero(d.y)), iz = rcp(avoid_zero(d.z));
        const Number mx = -o.x * ix, my = -o.y * iy, mz = -o.z * iz;
        const Number wx = abs(ix), wy = abs(iy), wz = abs(iz);
        const Number enter = max(max(mx - wx, my - wy), mz - wz);
        const Number t_far = min(min(mx + wx, my + wy), mz + wz);
        return enter <= t_far ? enter : MISS;
    }

    static WARPCAM_DEVICE int face_at(Vec3 at)  // the axis that the side is normal to
    {
        const float x = at.x * at.x, y = at.y * at.y, z = at.z * at.z;
        return x > y && x > z ? 0 : y > z ? 1 : 2;
    }

    // On each axis a ray can enter by one side only; the hit is on the nearest of the three.
    static WARPCAM_DEVICE Vec3 gradient(const Float3Int&, Vec3 at, Vec3 ray)
    {
        const float x = ray.x < 0.0f ? -at.x : at.x;  // -1 on the side of entry
        const float y = ray.y < 0.0f ? -at.y : at.y;
        const float z = ray.z < 0.0f ? -at.z : at.z;
        const int axis = y < x ? (z < y ? 2 : 1) : (z < x ? 2 : 0);
        return axis_vector(axis, -sign(component(ray, axis)));
    }
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 half, Vector ray, Vector local)
    {
        using Int = IntOf<Vector>;
        const auto x = abs(half.x + sign(ray.x) * local.x);
        const auto y = abs(half.y + sign(ray.y) * local.y);
        const auto z = abs(half.z + sign(ray.z) * local.z);
        const Int axis = y < x ? (z < y ? (Int)2 : (Int)1) : (z < x ? (Int)2 : (Int)0);
        return { axis_vector(axis, -sign(component(ray, axis))), axis };
    }

    static WARPCAM_DEVICE TextureProjection projection(Vec3 local, Vec3 half, int part)
    {
        return flat_projection(local, half, part == 0 ? 1 : 0, part == 2 ? 1 : 2, false);
    }
};

}  // namespace warpcam
