// Nearest entry of a ray into the analytic shapes. Exit faces do not count: a camera inside a shape sees out.
// Branch-free, so that 32 rays of a CPU loop become vector code.
#pragma once
#include "core/scalar_or_simd.h"
#include "camera/shape_record.h"

namespace warpcam {

constexpr int BARREL_STEPS = 7;

template <class Vector> struct RootHit {
    NumberOf<Vector> t;
    MaskOf<Vector> hit;
};

// Unit sphere. The discriminant is taken from the ray's nearest point to the centre, which keeps its digits when
// the sphere is far away and small (Haines et al., Ray Tracing Gems, chapter 7).
template <class Vector> WARPCAM_DEVICE RootHit<Vector> enter_ball(Vector o, Vector d)
{
    using Number = NumberOf<Vector>;
    const Number inverse = rcp(dot(d, d));
    const Number middle = -dot(o, d) * inverse;
    const Vector f { o.x + middle * d.x, o.y + middle * d.y, o.z + middle * d.z };
    const Number gap = 1.0f - dot(f, f);
    return { middle - sqrt(max(gap, 0.0f) * inverse), gap >= 0.0f };
}

template <class Vector> WARPCAM_DEVICE NumberOf<Vector> enter_sphere(Vector o, Vector d)
{
    const RootHit<Vector> side = enter_ball(o, d);
    return side.hit ? side.t : MISS;
}

// The xy-plane seen from above, cut to half widths where they are positive.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> enter_plane(Vector o, Vector d, float half_x, float half_y)
{
    const auto t = -o.z * rcp(avoid_zero(d.z));
    const float limit_x = half_x <= 0.0f ? MISS : half_x, limit_y = half_y <= 0.0f ? MISS : half_y;
    const MaskOf<Vector> inside = (abs(o.x + t * d.x) <= limit_x) & (abs(o.y + t * d.y) <= limit_y);
    return ((d.z < 0.0f) & inside) ? t : MISS;
}

// The cube of half width 1.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> intersect_box(Vector o, Vector d)
{
    using Number = NumberOf<Vector>;
    const Number ix = rcp(avoid_zero(d.x)), iy = rcp(avoid_zero(d.y)), iz = rcp(avoid_zero(d.z));
    const Number mx = -o.x * ix, my = -o.y * iy, mz = -o.z * iz;
    const Number wx = abs(ix), wy = abs(iy), wz = abs(iz);
    const Number enter = max(max(mx - wx, my - wy), mz - wz);
    const Number t_far = min(min(mx + wx, my + wy), mz + wz);
    return enter <= t_far ? enter : MISS;
}

// Interval of a ray inside the infinite cylinder of radius 1 about z: `middle` minus and plus `reach`.
template <class Vector> struct Interval {
    NumberOf<Vector> middle, reach;
    MaskOf<Vector> hit;
};

template <class Vector> WARPCAM_DEVICE Interval<Vector> within_side(Vector o, Vector d)
{
    using Number = NumberOf<Vector>;
    const Number inverse = rcp(max(d.x * d.x + d.y * d.y, 1.0e-30f));
    const Number middle = -(o.x * d.x + o.y * d.y) * inverse;
    const Number fx = o.x + middle * d.x, fy = o.y + middle * d.y;
    const Number gap = 1.0f - (fx * fx + fy * fy);
    return { middle, sqrt(max(gap, 0.0f) * inverse), gap >= 0.0f };
}

template <class Vector> WARPCAM_DEVICE RootHit<Vector> enter_side(Vector o, Vector d)
{
    const Interval<Vector> side = within_side(o, d);
    return { side.middle - side.reach, side.hit };
}

// Radius 1, half length 1. Where the cap and the side meet no ray is lost between them, as it would be if each had to
// be met within its own edge.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> enter_cylinder(Vector o, Vector d)
{
    using Number = NumberOf<Vector>;
    const Interval<Vector> side = within_side(o, d);
    const Number rate = rcp(avoid_zero(d.z));
    const Number cap = (-sign(rate) - o.z) * rate;  // the one that faces the ray
    const Number enter = max(side.middle - side.reach, cap);
    const Number t_far = min(side.middle + side.reach, cap + 2.0f * abs(rate));
    return (side.hit & (enter <= t_far)) ? enter : MISS;
}

// Radius 1, half length `half`.
template <class Vector>
WARPCAM_DEVICE NumberOf<Vector> enter_capsule(Vector o, Vector d, const RootHit<Vector>& side, float half)
{
    using Number = NumberOf<Vector>;
    const Number z = o.z + side.t * d.z, top = half;
    const RootHit<Vector> end = enter_ball(Vector { o.x, o.y, o.z - (z > 0.0f ? top : -top) }, d);
    const Number found = abs(z) <= half ? side.t : end.t;
    return (side.hit & (end.hit | (abs(z) <= half))) ? found : MISS;
}

// Tip at z = 1, base of radius 1 at z = -1. The side is where |xy| = w / 2 for w = 1 - z from 0 to 2; of the two roots
// the one by which a ray comes into it is the same for both halves of the double cone.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> enter_cone(Vector o, Vector d)
{
    using Number = NumberOf<Vector>;
    constexpr float ROUNDING = 1.0e-6f;
    const Number middle = -dot(o, d) * rcp(dot(d, d));  // from the point nearest to the centre numbers are small
    const Number x = o.x + middle * d.x, y = o.y + middle * d.y, z = o.z + middle * d.z;
    const Number w = 0.5f * (1.0f - z), dw = -0.5f * d.z;
    const Number a = d.x * d.x + d.y * d.y - dw * dw, b = x * d.x + y * d.y - w * dw, c = x * x + y * y - w * w;
    // b * b - a * c, of what is small where a ray passes near to the tip
    const Number ex = x * dw - d.x * w, ey = y * dw - d.y * w, past = x * d.y - y * d.x;
    const Number square = ex * ex + ey * ey - past * past, r = sqrt(max(square, 0.0f));
    const Number near = b > 0.0f ? -(b + r) * rcp(avoid_zero(a)) : c * rcp(avoid_zero(r - b));
    const Number at = w + near * dw;
    const MaskOf<Vector> on_side = (square >= 0.0f) & (at >= -ROUNDING) & (at <= 1.0f + ROUNDING);
    const Number cap = (-1.0f - z) * rcp(avoid_zero(d.z));  // where the side ends it is rounded alike
    const Number cx = x + cap * d.x, cy = y + cap * d.y;
    const MaskOf<Vector> on_cap = (d.z > 0.0f) & (cx * cx + cy * cy <= 1.0f);
    // a ray through the base and the tip comes in by the base
    return (on_cap | on_side) ? middle + (on_cap ? cap : near) : MISS;
}

// End radius 1, half length `half`; the side is the arc of a circle of radius `arc`, turned about the axis. How far a
// point is outside of the side, by the squares of distances, is convex along a ray: Newton's steps from before the
// entry never pass it, or the rate turns positive, and there is none.
template <class Vector>
WARPCAM_DEVICE NumberOf<Vector> enter_barrel(Vector o, Vector d, NumberOf<Vector> half, NumberOf<Vector> arc)
{
    using Number = NumberOf<Vector>;
    const Number end = sqrt(max(arc * arc - half * half, 0.0f)), belly = 1.0f + half * half * rcp(arc + end);
    const Number inverse = rcp(max(d.x * d.x + d.y * d.y, 1.0e-30f));
    const Number middle = -(o.x * d.x + o.y * d.y) * inverse;
    const Number fx = o.x + middle * d.x, fy = o.y + middle * d.y;
    const Number gap = belly * belly - (fx * fx + fy * fy), reach = sqrt(max(gap, 0.0f) * inverse);
    const Number rate = rcp(avoid_zero(d.z)), level = -o.z * rate, wide = half * abs(rate);
    const Number t_far = min(middle + reach, level + wide), size = rcp(end + 1.0f);
    Number t = max(middle - reach, level - wide);
    MaskOf<Vector> meets = (gap >= 0.0f) & (t <= t_far);
#pragma unroll 1
    for (int step = 0; step < BARREL_STEPS; ++step) {
        const Number x = o.x + t * d.x, y = o.y + t * d.y, z = o.z + t * d.z;
        const Number around = sqrt(max(x * x + y * y, 1.0e-30f)), past = max(around - 1.0f, -end);
        const Number left = size * (past * (past + 2.0f * end) + (z - half) * (z + half));
        const Number speed = size * ((past + end) * (x * d.x + y * d.y) * rcp(around) + z * d.z);
        meets &= (left <= 1.0e-6f) | (speed < 0.0f);
        t = left > 0.0f ? t - 0.5f * left * rcp(min(speed, -1.0e-20f)) : t;
    }
    meets &= t <= t_far + 1.0e-6f * (abs(t_far) + 1.0f);
    return meets ? t : MISS;
}

// Entry of a ray, given in the shape's frame, into a shape of one type; MISS where it misses.
template <int TYPE, class Vector> WARPCAM_DEVICE NumberOf<Vector> enter(const ShapeRecord& record, Vector o, Vector d)
{
    switch (TYPE) {
    case PLANE:
        return enter_plane(o, d, record.size.x, record.size.y);
    case SPHERE:
    case ELLIPSOID:
        return enter_sphere(o, d);
    case CAPSULE:
        return enter_capsule(o, d, enter_side(o, d), record.size.x);
    case CYLINDER:
        return enter_cylinder(o, d);
    case CONE:
        return enter_cone(o, d);
    case BARREL:
        return enter_barrel(o, d, record.size.x, record.size.y);
    default:
        return intersect_box(o, d);
    }
}
template <int TYPE> WARPCAM_DEVICE float enter(const ShapeRecord& record, Ray ray)
{
    return enter<TYPE>(record, ray.origin, ray.direction);
}

// Intersects several rays.
template <int TYPE, int COUNT>
WARPCAM_DEVICE void enter_all(const ShapeRecord& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    if constexpr (TYPE == CAPSULE) {
        RootHit<Vec3> sides[COUNT];
        bool any = false;
        for (int k = 0; k < COUNT; ++k) {
            sides[k] = enter_side(rays[k].origin, rays[k].direction);
            any |= sides[k].hit;
            t[k] = MISS;
        }
        if (any)
            for (int k = 0; k < COUNT; ++k)
                t[k] = enter_capsule(rays[k].origin, rays[k].direction, sides[k], record.size.x);
    } else {
        for (int k = 0; k < COUNT; ++k)
            t[k] = enter<TYPE>(record, rays[k]);
    }
}

// Intersects a shape whose type is known at run time only, out of a set known at compile time.
template <int GEOMETRY> WARPCAM_DEVICE float intersect_any(const ShapeRecord& record, Ray ray)
{
    const int type = record.axis_x.w;
#define WARPCAM_TRY(TYPE)                                                                                              \
    if ((GEOMETRY >> TYPE & 1) && type == TYPE)                                                                        \
        return enter<TYPE>(record, ray);
    WARPCAM_TRY(PLANE)
    WARPCAM_TRY(SPHERE)
    WARPCAM_TRY(ELLIPSOID)
    WARPCAM_TRY(CAPSULE)
    WARPCAM_TRY(CYLINDER)
    WARPCAM_TRY(BOX)
    WARPCAM_TRY(CONE)
    WARPCAM_TRY(BARREL)
#undef WARPCAM_TRY
    return MISS;
}

// Intersects several rays likewise; the type is one of GEOMETRY, which are tried in the order that follows.
template <int GEOMETRY, int COUNT, int TYPE, int... LATER>
WARPCAM_DEVICE void intersect_known(const ShapeRecord& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    constexpr bool last = (GEOMETRY & (0 | ... | (1 << LATER))) == 0;
    if constexpr (GEOMETRY == 0)
        for (int k = 0; k < COUNT; ++k)
            t[k] = MISS;
    if constexpr ((GEOMETRY >> TYPE & 1) != 0) {
        if (last || record.axis_x.w == TYPE) {
            enter_all<TYPE>(record, rays, t);
            return;
        }
    }
    if constexpr (!last)
        intersect_known<GEOMETRY, COUNT, LATER...>(record, rays, t);
}

}  // namespace warpcam
