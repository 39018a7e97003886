// Entries of eight rays into an analytic shape, on a CPU: geometry/intersect.h, whose comments hold here.
#pragma once
#include "core/simd8.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

inline Float8 enter_spheres(Vec3x8 o, Vec3x8 d)
{
    const Float8 inverse = rcp(dot(d, d)), middle = -dot(o, d) * inverse, none = 0.0f;
    const Vec3x8 f { o.x + middle * d.x, o.y + middle * d.y, o.z + middle * d.z };
    const Float8 gap = 1.0f - dot(f, f), t = middle - sqrt(max(gap, none) * inverse);
    return gap >= none ? t : (Float8)MISS;
}

inline Float8 enter_planes(Vec3x8 o, Vec3x8 d, float half_x, float half_y)
{
    const Float8 t = -o.z * rcp(avoid_zero(d.z));
    const Float8 limit_x = half_x <= 0.0f ? MISS : half_x, limit_y = half_y <= 0.0f ? MISS : half_y;
    const Int8 inside = (abs(o.x + t * d.x) <= limit_x) & (abs(o.y + t * d.y) <= limit_y);
    return (d.z < 0.0f) & inside ? t : (Float8)MISS;
}

inline Float8 enter_boxes(Vec3x8 o, Vec3x8 d)
{
    const Float8 ix = rcp(avoid_zero(d.x)), iy = rcp(avoid_zero(d.y)), iz = rcp(avoid_zero(d.z));
    const Float8 mx = -o.x * ix, my = -o.y * iy, mz = -o.z * iz;
    const Float8 wx = abs(ix), wy = abs(iy), wz = abs(iz);
    const Float8 enter = max(max(mx - wx, my - wy), mz - wz), leave = min(min(mx + wx, my + wy), mz + wz);
    return enter <= leave ? enter : (Float8)MISS;
}

struct WithinSides {
    Float8 middle, reach;
    Int8 hit;
};

inline WithinSides within_sides(Vec3x8 o, Vec3x8 d)
{
    const Float8 none = 0.0f, inverse = rcp(max(d.x * d.x + d.y * d.y, (Float8)1.0e-30f));
    const Float8 middle = -(o.x * d.x + o.y * d.y) * inverse;
    const Float8 fx = o.x + middle * d.x, fy = o.y + middle * d.y, gap = 1.0f - (fx * fx + fy * fy);
    return { middle, sqrt(max(gap, none) * inverse), gap >= none };
}

inline Float8 enter_cylinders(Vec3x8 o, Vec3x8 d)
{
    const WithinSides side = within_sides(o, d);
    const Float8 rate = rcp(avoid_zero(d.z)), cap = (-sign(rate) - o.z) * rate;
    const Float8 enter = max(side.middle - side.reach, cap);
    const Float8 leave = min(side.middle + side.reach, cap + 2.0f * abs(rate));
    return (side.hit & (enter <= leave)) ? enter : (Float8)MISS;
}

inline Float8 enter_capsules(Vec3x8 o, Vec3x8 d, float half)
{
    const WithinSides side = within_sides(o, d);
    const Float8 t = side.middle - side.reach, z = o.z + t * d.z, top = half;
    const Float8 end = enter_spheres({ o.x, o.y, o.z - (z > 0.0f ? top : -top) }, d);
    return side.hit ? (abs(z) <= top ? t : end) : (Float8)MISS;
}

template <int TYPE> inline Float8 enter_eight(const ShapeRecord& record, Vec3x8 o, Vec3x8 d)
{
    if constexpr (TYPE == PLANE)
        return enter_planes(o, d, record.size.x, record.size.y);
    else if constexpr (TYPE == SPHERE || TYPE == ELLIPSOID)
        return enter_spheres(o, d);
    else if constexpr (TYPE == CAPSULE)
        return enter_capsules(o, d, record.size.x);
    else if constexpr (TYPE == CYLINDER)
        return enter_cylinders(o, d);
    else if constexpr (TYPE == BOX)
        return enter_boxes(o, d);
    Float8 t;
    for (int k = 0; k < SIMD_WIDTH; ++k)
        t[k] = enter<TYPE>(record, { get_lane(o, k), get_lane(d, k) });
    return t;
}

}  // namespace warpcam
