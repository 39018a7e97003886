// A capsule of a radius and the half length of its side, along z. The unit frame's has the radius 1.
#pragma once
#include "shapes/shape_types.h"
#include "shapes/ray_roots.h"

namespace warpcam {

struct CapsuleTraits : AxialTraits {
    static constexpr ShapeType TYPE = CAPSULE;
    static constexpr bool IS_ROUND = true;

    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size) { return { size.x, size.x, size.x + size.y }; }
    static WARPCAM_DEVICE Vec3 unit_scale(Vec3, Vec3 half)
    {
        const float rate = 1.0f / half.x;
        return { rate, rate, rate };
    }
    static WARPCAM_DEVICE Vec3 unit_size(Vec3 size, Vec3 scale) { return { size.y * scale.x, 0.0f, 0.0f }; }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number y, Number) { return x + y; }
    static WARPCAM_DEVICE float end_extent(Vec3 half) { return half.x; }
    static WARPCAM_DEVICE float support(Vec3 half, Vec3 n) { return abs(n.z) * half.z + half.x * (1.0f - abs(n.z)); }

    // Entry, from that into the infinite cylinder of the side.
    template <class Vector>
    static WARPCAM_DEVICE NumberOf<Vector> intersect(const RootHit<Vector>& side, float half, Vector o, Vector d)
    {
        using Number = NumberOf<Vector>;
        const Number z = o.z + side.t * d.z, top = half;
        const RootHit<Vector> end = enter_ball(Vector { o.x, o.y, o.z - (z > 0.0f ? top : -top) }, d);
        const Number found = abs(z) <= half ? side.t : end.t;
        return (side.hit & (end.hit | (abs(z) <= half))) ? found : MISS;
    }
    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int& size, Vector o, Vector d)
    {
        return intersect(enter_side(o, d), size.x, o, d);
    }

    // From the nearest point of the axis.
    static WARPCAM_DEVICE Vec3 gradient(const Float3Int& size, Vec3 at, Vec3)
    {
        return { at.x, at.y, at.z - clamp(at.z, -size.x, size.x) };
    }
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 size, Vector, Vector p)
    {
        using Int = IntOf<Vector>;
        const NumberOf<Vector> half_length = size.y;
        return { normalized(Vector { p.x, p.y, p.z - clamp(p.z, -half_length, half_length) }),
                 p.z > half_length    ? (Int)TOP
                 : p.z < -half_length ? (Int)BOTTOM
                                      : (Int)SIDE };
    }

    // Each cap has the image's top or bottom half to itself.
    static WARPCAM_DEVICE TextureProjection projection(Vec3 local, Vec3 half, int part)
    {
        if (part == SIDE)
            return round_projection(local, half, 0.5f, 0.0f);
        local.z -= part == TOP ? half.z : -half.z;
        return round_projection(local, { half.x, half.y, half.x }, part == TOP ? 1.0f : 0.0f, 2.0f / PI);
    }

    // Each cap is a unit sphere whose middle is one above or below the origin.
    template <class Vector>
    static WARPCAM_DEVICE void fit_cube(Vec3 half, IntOf<Vector> part, Vector& place, Vector& scale)
    {
        using Number = NumberOf<Vector>;
        const MaskOf<Vector> side = part == int(SIDE);
        const Number none = 0.0f, aside = half.x - half.z;
        scale.z = side ? scale.z : scale.x;
        scale.y = side ? scale.y : scale.x;
        place.z += side ? none : part == int(BOTTOM) ? -aside : aside;
    }
};

}  // namespace warpcam
