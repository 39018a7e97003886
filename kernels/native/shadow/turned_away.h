// Points that no light reaches whatever stands between: they lie on a side of their own shape that is turned away.
#pragma once
#include "geometry/shape_state.h"
#include "shadow/shadow_span.h"

namespace warpcam {

// True if such points are left out: what a light without an ambient part does to them is nothing.
template <class Types> constexpr bool leaves_out_backs() { return Types::has(BACKS_UNLIT) && Types::has(BOX); }

// True if a point of a box, relative to `origin`, lies on a side that is turned away from the light; at an edge, on two
// such sides. Of a side thinner than the rounding of a point's place that is not known.
WARPCAM_DEVICE bool turned_away(const Shape& box, const LightView& light, Vec3 origin, Vec3 p)
{
    const Vec3 place = transform_transposed(box.rotation, p - (box.position - origin));
    const Vec3 to = ray_to(light, p), towards = transform_transposed(box.rotation, to);
    const float rounding = 4.0e-6f * (abs(p.x) + abs(p.y) + abs(p.z) + abs(origin.x) + abs(origin.y) + abs(origin.z));
    const float level = rounding + 1.0e-5f * (abs(to.x) + abs(to.y) + abs(to.z));
    const Vec3 gap = { box.size.x - abs(place.x), box.size.y - abs(place.y), box.size.z - abs(place.z) };
    const float least = min(min(gap.x, gap.y), gap.z) + rounding;
    const auto away = [&](float half, float gap, float place, float towards) {
        return gap > least || (half > 2.0f * rounding && sign(place) * towards <= -level);
    };
    return away(box.size.x, gap.x, place.x, towards.x) && away(box.size.y, gap.y, place.y, towards.y)
           && away(box.size.z, gap.z, place.z, towards.z);
}

// The same of any shape.
template <class Types, int LENS, class Shapes>
WARPCAM_DEVICE bool turned_away(const Shapes& shapes, int world, int id, const ReceiverView<LENS>& view, Vec3 p)
{
    return !view.dims && wp::index(shapes.types, id) == BOX
           && turned_away(load_shape(shapes, world, id), view.light, view.origin, p);
}

}  // namespace warpcam
