// Where a ray comes out of an analytic shape: what is inside of glass lies in the shadow of the side it looks out by.
#pragma once
#include "geometry/intersect.h"

namespace warpcam {

// FAR_AWAY where the ray misses. Of planes, cones and barrels always.
template <int TYPE, class Vector> WARPCAM_FN NumberOf<Vector> leave(const Record& record, Vector o, Vector d)
{
    if (TYPE == PLANE || TYPE == CONE || TYPE == BARREL)
        return FAR_AWAY;
    const auto t = enter<TYPE>(record, o, -d);
    return t < FAR_AWAY ? -t : FAR_AWAY;
}
template <int TYPE> WARPCAM_FN float leave(const Record& record, Ray ray)
{
    return leave<TYPE>(record, ray.origin, ray.direction);
}

// The same for a type known only now, out of a set of types known at compile time.
template <int TYPES> WARPCAM_FN float leave_any(const Record& record, Ray ray)
{
    const int type = record.axis_x.w;
#define WARPCAM_TRY(TYPE) \
    if ((TYPES >> TYPE & 1) && type == TYPE) \
        return leave<TYPE>(record, ray);
    WARPCAM_TRY(SPHERE)
    WARPCAM_TRY(CAPSULE)
    WARPCAM_TRY(ELLIPSOID)
    WARPCAM_TRY(CYLINDER)
    WARPCAM_TRY(BOX)
#undef WARPCAM_TRY
    return FAR_AWAY;
}

}  // namespace warpcam
