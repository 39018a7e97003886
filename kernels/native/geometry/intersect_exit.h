// Exit point of a ray from an analytic shape: objects inside glass lie in the shadow of the side that they look out by.
#pragma once
#include "geometry/intersect.h"

namespace warpcam {

constexpr int TYPES_WITH_EXIT = types_with([](auto shape) { return shape.HAS_EXIT; });

// MISS where the ray misses, and of shapes without HAS_EXIT.
template <class Shape, class Vector>
WARPCAM_DEVICE NumberOf<Vector> intersect_exit(Shape, const ShapeRecord& record, Vector o, Vector d)
{
    if constexpr (!Shape::HAS_EXIT)
        return MISS;
    const auto t = Shape::intersect(record.size, o, -d);
    return t < MISS ? -t : MISS;
}

// Exit point from a shape whose type is known at run time only, out of a set known at compile time.
template <int GEOMETRY> WARPCAM_DEVICE float intersect_exit_any(const ShapeRecord& record, Ray ray)
{
    float t = MISS;
    visit_shape<GEOMETRY & TYPES_WITH_EXIT>(
        record.axis_x.w, [&](auto shape) { t = intersect_exit(shape, record, ray.origin, ray.direction); });
    return t;
}

}  // namespace warpcam
