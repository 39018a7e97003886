// A barrel: a cylinder of an end radius and a half length, along z, whose side is bent outwards in the arc of a circle
// of a third size's radius; 0 stands for no bend. The unit frame's end radius is 1.
#pragma once
#include "shapes/shape_types.h"

namespace warpcam {

constexpr int BARREL_STEPS = 7;
constexpr float STRAIGHT = 1.0e9f;  // radius of an arc that is a line

struct BarrelTraits : AxialTraits {
    static constexpr ShapeType TYPE = BARREL;
    static constexpr bool HAS_EXIT = false;

    // Half a length of the arc lies outside of the ends' radius.
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 s)
    {
        const float arc = max(s.z, s.y),
                    belly = s.x + (s.z > 0.0f ? s.y * s.y / (arc + sqrt(arc * arc - s.y * s.y)) : 0.0f);
        return { belly, belly, s.y };
    }
    static WARPCAM_DEVICE bool is_valid(Vec3 size, Vec3) { return size.x > 0.0f && size.y > 0.0f; }
    static WARPCAM_DEVICE Vec3 unit_scale(Vec3 size, Vec3)
    {
        const float rate = 1.0f / size.x;
        return { rate, rate, rate };
    }
    static WARPCAM_DEVICE Vec3 unit_size(Vec3 size, Vec3 scale)
    {
        return { size.y * scale.x, size.z > 0.0f ? max(size.z, size.y) * scale.x : STRAIGHT, 0.0f };
    }
    // The side is bent by less than its half length.
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number x, Number y, Number)
    {
        const Number wide = x + y;
        return sqrt(wide * wide + y * y);
    }

    // The distance of a point outside of the side, by squares of distances, is convex along a ray: Newton's steps from
    // before the entry never pass it, or the rate turns positive, and there is none.
    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int& size, Vector o, Vector d)
    {
        using Number = NumberOf<Vector>;
        const Number half = size.x, arc = size.y;
        const Number end = sqrt(max(arc * arc - half * half, 0.0f)), belly = 1.0f + half * half * rcp(arc + end);
        const Number inverse = rcp(max(d.x * d.x + d.y * d.y, 1.0e-30f));
        const Number middle = -(o.x * d.x + o.y * d.y) * inverse;
        const Number fx = o.x + middle * d.x, fy = o.y + middle * d.y;
        const Number gap = belly * belly - (fx * fx + fy * fy), reach = sqrt(max(gap, 0.0f) * inverse);
        const Number rate = rcp(avoid_zero(d.z)), level = -o.z * rate, wide = half * abs(rate);
        const Number t_far = min(middle + reach, level + wide), scale = rcp(end + 1.0f);
        Number t = max(middle - reach, level - wide);
        MaskOf<Vector> meets = (gap >= 0.0f) & (t <= t_far);
#pragma unroll 1
        for (int step = 0; step < BARREL_STEPS; ++step) {
            const Number x = o.x + t * d.x, y = o.y + t * d.y, z = o.z + t * d.z;
            const Number axial = sqrt(max(x * x + y * y, 1.0e-30f)), outside = max(axial - 1.0f, -end);
            const Number left = scale * (outside * (outside + 2.0f * end) + (z - half) * (z + half));
            const Number speed = scale * ((outside + end) * (x * d.x + y * d.y) * rcp(axial) + z * d.z);
            meets &= (left <= 1.0e-6f) | (speed < 0.0f);
            t = left > 0.0f ? t - 0.5f * left * rcp(min(speed, -1.0e-20f)) : t;
        }
        meets &= t <= t_far + 1.0e-6f * (abs(t_far) + 1.0f);
        return meets ? t : MISS;
    }

    static WARPCAM_DEVICE Vec3 gradient(const Float3Int& size, Vec3 at, Vec3 ray)
    {
        const float half = size.x, arc = size.y;
        const float axial = sqrt(max(at.x * at.x + at.y * at.y, MIN_NORMAL)), outside = axial - 1.0f;
        const float end = sqrt(max(arc * arc - half * half, 0.0f)), rate = (outside + end) / axial;
        const float gap = (outside * (outside + 2.0f * end) + at.z * at.z - half * half) / (2.0f * arc);
        if (abs(half + sign(ray.z) * at.z) < abs(gap))
            return { 0.0f, 0.0f, -sign(ray.z) };
        return { rate * at.x, rate * at.y, at.z };
    }
    // Normals of the side point away from the middle of the arc.
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 size, Vector ray, Vector p)
    {
        using Number = NumberOf<Vector>;
        using Int = IntOf<Vector>;
        const float arc = size.z > 0.0f ? max(size.z, size.y) : STRAIGHT;
        const float end = sqrt(max(arc * arc - size.y * size.y, 0.0f));
        const Number axial = sqrt(p.x * p.x + p.y * p.y), outside = axial - size.x, none = 0.0f;
        const Number rate = (outside + end) * rcp(max(axial, MIN_NORMAL));
        const Number gap = (outside * (outside + 2.0f * end) + p.z * p.z - size.y * size.y) * rcp(2.0f * arc);
        const MaskOf<Vector> on_end = abs(size.y + sign(ray.z) * p.z) < abs(gap);
        const Vector aslant = normalized(Vector { rate * p.x, rate * p.y, p.z });
        return { select(on_end, Vector { none, none, -sign(ray.z) }, aslant),
                 on_end ? (ray.z < 0.0f ? (Int)TOP : (Int)BOTTOM) : (Int)SIDE };
    }
};

}  // namespace warpcam
