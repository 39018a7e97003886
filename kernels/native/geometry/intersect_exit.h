// Exit point of a ray from an analytic shape: objects inside glass lie in the shadow of the side that they look out by.
#pragma once
#include "geometry/intersect.h"

namespace warpcam {

// MISS where the ray misses. Of planes, cones and barrels always.
template <int TYPE, class Vector>
WARPCAM_DEVICE NumberOf<Vector> intersect_exit(const ShapeRecord& record, Vector o, Vector d)
{
    if (TYPE == PLANE || TYPE == CONE || TYPE == BARREL)
        return MISS;
    const auto t = enter<TYPE>(record, o, -d);
    return t < MISS ? -t : MISS;
}
template <int TYPE> WARPCAM_DEVICE float intersect_exit(const ShapeRecord& record, Ray ray)
{
    return intersect_exit<TYPE>(record, ray.origin, ray.direction);
}

// Exit point from a shape whose type is known at run time only, out of a set known at compile time.
template <int GEOMETRY> WARPCAM_DEVICE float intersect_exit_any(const ShapeRecord& record, Ray ray)
{
    const int type = record.axis_x.w;
#define WARPCAM_TRY(TYPE)                                                                                              \
    if ((GEOMETRY >> TYPE & 1) && type == TYPE)                                                                        \
        return intersect_exit<TYPE>(record, ray);
    WARPCAM_TRY(SPHERE)
    WARPCAM_TRY(CAPSULE)
    WARPCAM_TRY(ELLIPSOID)
    WARPCAM_TRY(CYLINDER)
    WARPCAM_TRY(BOX)
#undef WARPCAM_TRY
    return MISS;
}

}  // namespace warpcam
