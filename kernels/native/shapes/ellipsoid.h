// An ellipsoid of three half axes. The unit frame's is the unit sphere.
#pragma once
#include "shapes/sphere.h"

namespace warpcam {

struct EllipsoidTraits : SphereTraits {
    static constexpr ShapeType TYPE = ELLIPSOID;

    static WARPCAM_DEVICE Vec3 axes(Vec3 size) { return size; }
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size) { return size; }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number y, Number z)
    {
        return max(max(x, y), z);
    }

    // The normal is the gradient of the sum of (x / half)^2.
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 half, Vector, Vector local)
    {
        const Vec3 rate { rcp(half.x), rcp(half.y), rcp(half.z) };
        return { normalized(mul(mul(local, broadcast<Vector>(rate)), broadcast<Vector>(rate))), 0 };
    }
};

}  // namespace warpcam
