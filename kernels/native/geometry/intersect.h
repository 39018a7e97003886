// Nearest entry of a ray into the analytic shapes. Exit faces do not count: a camera inside a shape sees out.
// Branch-free, so that 32 rays of a CPU loop become vector code.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

constexpr int BARREL_STEPS = 7;

struct Side {
    float t;
    bool hit;
};

// Unit sphere. The discriminant is taken from the ray's nearest point to the centre, which keeps its digits when
// the sphere is far away and small (Haines et al., Ray Tracing Gems, chapter 7).
WARPCAM_FN Side enter_ball(Vec o, Vec d)
{
    const float inverse = reciprocal(dot(d, d));
    const float middle = -dot(o, d) * inverse;
    const Vec f { o.x + middle * d.x, o.y + middle * d.y, o.z + middle * d.z };
    const float gap = 1.0f - dot(f, f);
    return { middle - root(upper(gap, 0.0f) * inverse), gap >= 0.0f };
}

WARPCAM_FN float enter_sphere(Vec o, Vec d)
{
    const Side side = enter_ball(o, d);
    return side.hit ? side.t : FAR_AWAY;
}

// The xy-plane seen from above, cut to half widths where they are positive.
WARPCAM_FN float enter_plane(Vec o, Vec d, float half_x, float half_y)
{
    const float t = -o.z * reciprocal(nonzero(d.z));
    const bool inside = ((half_x <= 0.0f) | (magnitude(o.x + t * d.x) <= half_x))
        & ((half_y <= 0.0f) | (magnitude(o.y + t * d.y) <= half_y));
    return ((d.z < 0.0f) & inside) ? t : FAR_AWAY;
}

// The cube of half width 1.
WARPCAM_FN float enter_box(Vec o, Vec d)
{
    const float ix = reciprocal(nonzero(d.x)), iy = reciprocal(nonzero(d.y)), iz = reciprocal(nonzero(d.z));
    const float mx = -o.x * ix, my = -o.y * iy, mz = -o.z * iz;
    const float wx = magnitude(ix), wy = magnitude(iy), wz = magnitude(iz);
    const float enter = upper(upper(mx - wx, my - wy), mz - wz);
    const float leave = lower(lower(mx + wx, my + wy), mz + wz);
    return enter <= leave ? enter : FAR_AWAY;
}

// When a ray is within the endless cylinder of radius 1 about z: between `middle` less `reach` and more.
struct Within {
    float middle, reach;
    bool hit;
};

WARPCAM_FN Within within_side(Vec o, Vec d)
{
    const float inverse = reciprocal(upper(d.x * d.x + d.y * d.y, 1.0e-30f));
    const float middle = -(o.x * d.x + o.y * d.y) * inverse;
    const float fx = o.x + middle * d.x, fy = o.y + middle * d.y;
    const float gap = 1.0f - (fx * fx + fy * fy);
    return { middle, root(upper(gap, 0.0f) * inverse), gap >= 0.0f };
}

WARPCAM_FN Side enter_side(Vec o, Vec d)
{
    const Within side = within_side(o, d);
    return { side.middle - side.reach, side.hit };
}

// Radius 1, half length 1. Where the cap and the side meet no ray is lost between them, as it would be if each had to
// be met within its own edge.
WARPCAM_FN float enter_cylinder(Vec o, Vec d)
{
    const Within side = within_side(o, d);
    const float rate = reciprocal(nonzero(d.z));
    const float cap = ((rate < 0.0f ? 1.0f : -1.0f) - o.z) * rate;  // the one that faces the ray
    const float enter = upper(side.middle - side.reach, cap);
    const float leave = lower(side.middle + side.reach, cap + 2.0f * magnitude(rate));
    return (side.hit & (enter <= leave)) ? enter : FAR_AWAY;
}

// Radius 1, half length `half`.
WARPCAM_FN float enter_capsule(Vec o, Vec d, const Side& side, float half)
{
    const float z = o.z + side.t * d.z;
    const Side end = enter_ball({ o.x, o.y, o.z - (z > 0.0f ? half : -half) }, d);
    const float found = magnitude(z) <= half ? side.t : end.t;
    return (side.hit & (end.hit | (magnitude(z) <= half))) ? found : FAR_AWAY;
}

// Tip at z = 1, base of radius 1 at z = -1. The side is where |xy| = w / 2 for w = 1 - z from 0 to 2; of the two roots
// the one by which a ray comes into it is the same for both halves of the double cone.
WARPCAM_FN float enter_cone(Vec o, Vec d)
{
    constexpr float ROUNDING = 1.0e-6f;
    const float middle = -dot(o, d) * reciprocal(dot(d, d));  // from the point nearest to the centre numbers are small
    const float x = o.x + middle * d.x, y = o.y + middle * d.y, z = o.z + middle * d.z;
    const float w = 0.5f * (1.0f - z), dw = -0.5f * d.z;
    const float a = d.x * d.x + d.y * d.y - dw * dw, b = x * d.x + y * d.y - w * dw, c = x * x + y * y - w * w;
    // b * b - a * c, of what is small where a ray passes near to the tip
    const float ex = x * dw - d.x * w, ey = y * dw - d.y * w, past = x * d.y - y * d.x;
    const float square = ex * ex + ey * ey - past * past, r = root(upper(square, 0.0f));
    const float near = b > 0.0f ? -(b + r) * reciprocal(nonzero(a)) : c * reciprocal(nonzero(r - b));
    const float at = w + near * dw;
    const bool on_side = (square >= 0.0f) & (at >= -ROUNDING) & (at <= 1.0f + ROUNDING);
    const float cap = (-1.0f - z) * reciprocal(nonzero(d.z));  // where the side ends it is rounded alike
    const float cx = x + cap * d.x, cy = y + cap * d.y;
    const bool on_cap = (d.z > 0.0f) & (cx * cx + cy * cy <= 1.0f);
    // a ray through the base and the tip comes in by the base
    return (on_cap | on_side) ? middle + (on_cap ? cap : near) : FAR_AWAY;
}

// End radius 1, half length `half`; the side is the arc of a circle of radius `arc`, turned about the axis. How far a
// point is outside of the side, by the squares of distances, is convex along a ray: Newton's steps from before the
// entry never pass it, or the rate turns positive, and there is none.
WARPCAM_FN float enter_barrel(Vec o, Vec d, float half, float arc)
{
    const float end = root(upper(arc * arc - half * half, 0.0f)), belly = 1.0f + half * half * reciprocal(arc + end);
    const float inverse = reciprocal(upper(d.x * d.x + d.y * d.y, 1.0e-30f));
    const float middle = -(o.x * d.x + o.y * d.y) * inverse;
    const float fx = o.x + middle * d.x, fy = o.y + middle * d.y;
    const float gap = belly * belly - (fx * fx + fy * fy), reach = root(upper(gap, 0.0f) * inverse);
    const float rate = reciprocal(nonzero(d.z)), level = -o.z * rate, wide = half * magnitude(rate);
    const float leave = lower(middle + reach, level + wide), size = reciprocal(end + 1.0f);
    float t = upper(middle - reach, level - wide);
    bool meets = (gap >= 0.0f) & (t <= leave);
#pragma unroll 1
    for (int step = 0; step < BARREL_STEPS; ++step) {
        const float x = o.x + t * d.x, y = o.y + t * d.y, z = o.z + t * d.z;
        const float around = root(upper(x * x + y * y, 1.0e-30f)), past = upper(around - 1.0f, -end);
        const float left = size * (past * (past + 2.0f * end) + (z - half) * (z + half));
        const float speed = size * ((past + end) * (x * d.x + y * d.y) * reciprocal(around) + z * d.z);
        meets &= (left <= 1.0e-6f) | (speed < 0.0f);
        t = left > 0.0f ? t - 0.5f * left * reciprocal(lower(speed, -1.0e-20f)) : t;
    }
    meets &= t <= leave + 1.0e-6f * (magnitude(leave) + 1.0f);
    return meets ? t : FAR_AWAY;
}

// Entry of a ray, given in the shape's frame, into a shape of one type; FAR_AWAY where it misses.
template <int TYPE> WARPCAM_FN float enter(const Record& record, Ray ray)
{
    const Vec o = ray.origin, d = ray.direction;
    switch (TYPE) {
    case PLANE: return enter_plane(o, d, record.size.x, record.size.y);
    case SPHERE:
    case ELLIPSOID: return enter_sphere(o, d);
    case CAPSULE: return enter_capsule(o, d, enter_side(o, d), record.size.x);
    case CYLINDER: return enter_cylinder(o, d);
    case CONE: return enter_cone(o, d);
    case BARREL: return enter_barrel(o, d, record.size.x, record.size.y);
    default: return enter_box(o, d);
    }
}

// The same of several rays.
template <int TYPE, int COUNT>
WARPCAM_FN void enter_all(const Record& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    if constexpr (TYPE == CAPSULE) {
        Side sides[COUNT];
        bool any = false;
        for (int k = 0; k < COUNT; ++k) {
            sides[k] = enter_side(rays[k].origin, rays[k].direction);
            any |= sides[k].hit;
            t[k] = FAR_AWAY;
        }
        if (any)
            for (int k = 0; k < COUNT; ++k)
                t[k] = enter_capsule(rays[k].origin, rays[k].direction, sides[k], record.size.x);
    } else {
        for (int k = 0; k < COUNT; ++k)
            t[k] = enter<TYPE>(record, rays[k]);
    }
}

// The same for a type known only now, out of a set of types known at compile time.
template <int TYPES> WARPCAM_FN float enter_any(const Record& record, Ray ray)
{
    const int type = record.axis_x.w;
#define WARPCAM_TRY(TYPE) \
    if ((TYPES >> TYPE & 1) && type == TYPE) \
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
    return FAR_AWAY;
}

// The same of several rays; the type is surely one of TYPES, which are looked through in the order that follows.
template <int TYPES, int COUNT, int TYPE, int... LATER>
WARPCAM_FN void enter_each(const Record& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    constexpr bool last = (TYPES & (0 | ... | (1 << LATER))) == 0;
    if constexpr (TYPES == 0)
        for (int k = 0; k < COUNT; ++k)
            t[k] = FAR_AWAY;
    if constexpr ((TYPES >> TYPE & 1) != 0) {
        if (last || record.axis_x.w == TYPE) {
            enter_all<TYPE>(record, rays, t);
            return;
        }
    }
    if constexpr (!last)
        enter_each<TYPES, COUNT, LATER...>(record, rays, t);
}

}  // namespace warpcam
