// A cylinder of a radius and a half length, along z. The unit frame's has radius 1 and half length 1.
#pragma once
#include "shapes/shape_types.h"
#include "shapes/ray_roots.h"

namespace warpcam {

struct CylinderTraits : AxialTraits {
    static constexpr ShapeType TYPE = CYLINDER;
    static constexpr bool IS_ROUND = true, HAS_FACES = true;

    static WARPCAM_DEVICE float end_extent(Vec3) { return 0.0f; }
    static WARPCAM_DEVICE float support(Vec3 half, Vec3 n)
    {
        const Vec3 a { abs(n.x) * half.x, abs(n.y) * half.y, abs(n.z) * half.z };
        return a.z + sqrt(a.x * a.x + a.y * a.y);
    }

    // No ray is lost between the cap and the side where they meet, as it would be if each had to be met within its own
    // edge.
    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int&, Vector o, Vector d)
    {
        using Number = NumberOf<Vector>;
        const Interval<Vector> side = within_side(o, d);
        const Number rate = rcp(avoid_zero(d.z));
        const Number cap = (-sign(rate) - o.z) * rate;  // the one that faces the ray
        const Number enter = max(side.middle - side.reach, cap);
        const Number t_far = min(side.middle + side.reach, cap + 2.0f * abs(rate));
        return (side.hit & (enter <= t_far)) ? enter : MISS;
    }

    static WARPCAM_DEVICE int face_at(Vec3 at)  // 0 the side, 1 an end
    {
        const float x = at.x * at.x, y = at.y * at.y, z = at.z * at.z;
        return x + y < z;
    }

    // The normal of the side, or of the cap by which the ray can enter, whichever is nearer to the hit.
    static WARPCAM_DEVICE Vec3 gradient(const Float3Int&, Vec3 at, Vec3 ray)
    {
        const float axial = at.x * at.x + at.y * at.y;
        const bool cap = abs(1.0f + sign(ray.z) * at.z) < 0.5f * abs(1.0f - axial);
        return { cap ? 0.0f : at.x, cap ? 0.0f : at.y, cap ? -sign(ray.z) : 0.0f };
    }
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 size, Vector ray, Vector p)
    {
        using Number = NumberOf<Vector>;
        using Int = IntOf<Vector>;
        const float radius = size.x, half_length = size.y;
        const Number none = 0.0f, axial = sqrt(p.x * p.x + p.y * p.y);
        const auto on_cap = abs(half_length + sign(ray.z) * p.z) < abs(radius - axial);
        return { select(on_cap, Vector { none, none, -sign(ray.z) }, normalized(Vector { p.x, p.y, none })),
                 on_cap ? (ray.z < 0.0f ? (Int)TOP : (Int)BOTTOM) : (Int)SIDE };
    }
};

}  // namespace warpcam
