// Entries of rays into the ball and the tube that several shapes are made of.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

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

template <class Vector> WARPCAM_DEVICE NumberOf<Vector> intersect_unit_sphere(Vector o, Vector d)
{
    const RootHit<Vector> side = enter_ball(o, d);
    return side.hit ? side.t : MISS;
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

}  // namespace warpcam
