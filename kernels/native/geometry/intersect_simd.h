// Entries of eight rays into an analytic shape, on a CPU: geometry/intersect.h, whose comments hold here.
#pragma once
#include "core/simd8.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

inline Floats enter_spheres(Vecs o, Vecs d)
{
    const Floats inverse = reciprocal(dot(d, d)), middle = -dot(o, d) * inverse, none = 0.0f;
    const Vecs f { o.x + middle * d.x, o.y + middle * d.y, o.z + middle * d.z };
    const Floats gap = 1.0f - dot(f, f), t = middle - root(upper(gap, none) * inverse);
    return gap >= none ? t : (Floats)FAR_AWAY;
}

inline Floats enter_planes(Vecs o, Vecs d, float half_x, float half_y)
{
    const Floats t = -o.z * reciprocal(nonzero(d.z));
    const Floats limit_x = half_x <= 0.0f ? FAR_AWAY : half_x, limit_y = half_y <= 0.0f ? FAR_AWAY : half_y;
    const Ints inside = (magnitude(o.x + t * d.x) <= limit_x) & (magnitude(o.y + t * d.y) <= limit_y);
    return (d.z < 0.0f) & inside ? t : (Floats)FAR_AWAY;
}

inline Floats enter_boxes(Vecs o, Vecs d)
{
    const Floats ix = reciprocal(nonzero(d.x)), iy = reciprocal(nonzero(d.y)), iz = reciprocal(nonzero(d.z));
    const Floats mx = -o.x * ix, my = -o.y * iy, mz = -o.z * iz;
    const Floats wx = magnitude(ix), wy = magnitude(iy), wz = magnitude(iz);
    const Floats enter = upper(upper(mx - wx, my - wy), mz - wz), leave = lower(lower(mx + wx, my + wy), mz + wz);
    return enter <= leave ? enter : (Floats)FAR_AWAY;
}

struct WithinSides {
    Floats middle, reach;
    Ints hit;
};

inline WithinSides within_sides(Vecs o, Vecs d)
{
    const Floats none = 0.0f, inverse = reciprocal(upper(d.x * d.x + d.y * d.y, (Floats)1.0e-30f));
    const Floats middle = -(o.x * d.x + o.y * d.y) * inverse;
    const Floats fx = o.x + middle * d.x, fy = o.y + middle * d.y, gap = 1.0f - (fx * fx + fy * fy);
    return { middle, root(upper(gap, none) * inverse), gap >= none };
}

inline Floats enter_cylinders(Vecs o, Vecs d)
{
    const WithinSides side = within_sides(o, d);
    const Floats rate = reciprocal(nonzero(d.z)), cap = (-sign(rate) - o.z) * rate;
    const Floats enter = upper(side.middle - side.reach, cap);
    const Floats leave = lower(side.middle + side.reach, cap + 2.0f * magnitude(rate));
    return (side.hit & (enter <= leave)) ? enter : (Floats)FAR_AWAY;
}

inline Floats enter_capsules(Vecs o, Vecs d, float half)
{
    const WithinSides side = within_sides(o, d);
    const Floats t = side.middle - side.reach, z = o.z + t * d.z, top = half;
    const Floats end = enter_spheres({ o.x, o.y, o.z - (z > 0.0f ? top : -top) }, d);
    return side.hit ? (magnitude(z) <= top ? t : end) : (Floats)FAR_AWAY;
}

template <int TYPE> inline Floats enter_eight(const Record& record, Vecs o, Vecs d)
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
    Floats t;
    for (int k = 0; k < PACKET; ++k)
        t[k] = enter<TYPE>(record, { one_of(o, k), one_of(d, k) });
    return t;
}

}  // namespace warpcam
