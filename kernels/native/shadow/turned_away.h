// Points that no light reaches whatever stands between: they lie on a side of their own shape that is turned away.
#pragma once
#include "core/scalar_or_simd.h"
#include "geometry/shape_state.h"
#include "shadow/shadow_span.h"

namespace warpcam {

// True if such points are left out: what a light without an ambient part does to them is nothing.
template <class Types> constexpr bool leaves_out_backs() { return Types::has(BACKS_UNLIT) && Types::has(BOX); }

// True at points of a box, relative to `origin`, whose side is turned away from the light; at an edge that of both
// sides. Of a side thinner than the rounding of a point's place that is not known.
template <class Vector>
WARPCAM_DEVICE MaskOf<Vector> turned_away(const Shape& box, const LightView& light, Vec3 origin, Vector p)
{
    using Number = NumberOf<Vector>;
    const Mat3& r = box.rotation;
    const Vector here = p - broadcast<Vector>(box.position - origin), aim = broadcast<Vector>(light.aim);
    const Vector to = light.distant ? aim : aim - p;
    const Number rounding =
        4.0e-6f * (abs(p.x) + abs(p.y) + abs(p.z) + (abs(origin.x) + abs(origin.y) + abs(origin.z)));
    const Number level = rounding + 1.0e-5f * (abs(to.x) + abs(to.y) + abs(to.z));
    const float half[3] = { box.size.x, box.size.y, box.size.z };
    Number gap[3], facing[3];
#pragma unroll
    for (int k = 0; k < 3; ++k) {
        const Number place = r.at[0][k] * here.x + r.at[1][k] * here.y + r.at[2][k] * here.z;
        const Number towards = r.at[0][k] * to.x + r.at[1][k] * to.y + r.at[2][k] * to.z;
        gap[k] = half[k] - abs(place);
        facing[k] = half[k] > 2.0f * rounding ? sign(place) * towards : level;
    }
    const Number least = min(min(gap[0], gap[1]), gap[2]) + rounding;
    return ((gap[0] > least) | (facing[0] <= -level)) & ((gap[1] > least) | (facing[1] <= -level))
           & ((gap[2] > least) | (facing[2] <= -level));
}

// The same of any shape.
template <class Types, int LENS, class Shapes>
WARPCAM_DEVICE bool turned_away(const Shapes& shapes, int world, int id, const ReceiverView<LENS>& view, Vec3 p)
{
    return !view.dims && wp::index(shapes.types, id) == BOX
           && turned_away(load_shape(shapes, world, id), view.light, view.origin, p);
}

}  // namespace warpcam
