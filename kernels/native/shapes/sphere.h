// A sphere of a radius. The unit frame's has the radius 1.
#pragma once
#include "shapes/shape_types.h"
#include "shapes/ray_roots.h"

namespace warpcam {

struct SphereTraits : ConvexTraits {
    static constexpr ShapeType TYPE = SPHERE;
    static constexpr bool IS_ROUND = true;

    static WARPCAM_DEVICE Vec3 axes(Vec3 size) { return { size.x, size.x, size.x }; }
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size) { return axes(size); }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number, Number) { return x; }
    static WARPCAM_DEVICE float end_extent(Vec3 half) { return half.z; }
    static WARPCAM_DEVICE float support(Vec3 half, Vec3 n)
    {
        const Vec3 a { abs(n.x) * half.x, abs(n.y) * half.y, abs(n.z) * half.z };
        return sqrt(dot(a, a));
    }

    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int&, Vector o, Vector d)
    {
        return intersect_unit_sphere(o, d);
    }

    static WARPCAM_DEVICE Vec3 gradient(const Float3Int&, Vec3 at, Vec3) { return at; }

    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3, Vector, Vector local)
    {
        return { normalized(local), 0 };
    }

    static WARPCAM_DEVICE TextureProjection projection(Vec3 local, Vec3 half, int)
    {
        return round_projection(local, half, 0.5f, 1.0f / PI);
    }
};

}  // namespace warpcam
