// A cone of a base radius and a half length, its tip up. The unit frame's tip is at z = 1, its base of radius 1 at z =
// -1.
#pragma once
#include "shapes/shape_types.h"

namespace warpcam {

struct ConeTraits : AxialTraits {
    static constexpr ShapeType TYPE = CONE;
    static constexpr bool HAS_EXIT = false;

    // The side is where |xy| = w / 2 for w = 1 - z from 0 to 2; of the two roots the one by which a ray comes into it
    // is the same for both halves of the double cone.
    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int&, Vector o, Vector d)
    {
        using Number = NumberOf<Vector>;
        constexpr float ROUNDING = 1.0e-6f;
        const Number middle = -dot(o, d) * rcp(dot(d, d));  // from the point nearest to the centre numbers are small
        const Number x = o.x + middle * d.x, y = o.y + middle * d.y, z = o.z + middle * d.z;
        const Number w = 0.5f * (1.0f - z), dw = -0.5f * d.z;
        const Number a = d.x * d.x + d.y * d.y - dw * dw, b = x * d.x + y * d.y - w * dw, c = x * x + y * y - w * w;
        // b * b - a * c, of what is small where a ray passes near to the tip
        const Number ex = x * dw - d.x * w, ey = y * dw - d.y * w, ez = x * d.y - y * d.x;
        const Number square = ex * ex + ey * ey - ez * ez, r = sqrt(max(square, 0.0f));
        const Number near = b > 0.0f ? -(b + r) * rcp(avoid_zero(a)) : c * rcp(avoid_zero(r - b));
        const Number at = w + near * dw;
        const MaskOf<Vector> on_side = (square >= 0.0f) & (at >= -ROUNDING) & (at <= 1.0f + ROUNDING);
        const Number cap = (-1.0f - z) * rcp(avoid_zero(d.z));  // where the side ends it is rounded alike
        const Number cx = x + cap * d.x, cy = y + cap * d.y;
        const MaskOf<Vector> on_cap = (d.z > 0.0f) & (cx * cx + cy * cy <= 1.0f);
        // a ray through the base and the tip comes in by the base
        return (on_cap | on_side) ? middle + (on_cap ? cap : near) : MISS;
    }

    static WARPCAM_DEVICE Vec3 gradient(const Float3Int&, Vec3 at, Vec3 ray)
    {
        const float w = 0.5f * (1.0f - at.z), gap = w * w - at.x * at.x - at.y * at.y;
        if (ray.z > 0.0f && abs(1.0f + at.z) < 0.5f * abs(gap))
            return { 0.0f, 0.0f, -1.0f };
        return { at.x, at.y, 0.5f * w };
    }
    template <class Vector> static WARPCAM_DEVICE SurfacePoint<Vector> surface(Vec3 size, Vector ray, Vector p)
    {
        using Number = NumberOf<Vector>;
        using Int = IntOf<Vector>;
        const float radius = size.x, half_length = size.y, length = 2.0f * half_length;
        const Number axial = sqrt(p.x * p.x + p.y * p.y), rate = rcp(max(axial, MIN_NORMAL)), across = radius;
        // distance of the hit from the base, and from the side along the radius
        const Number gap = abs(radius * (half_length - p.z) - length * axial) * rcp(length);
        const MaskOf<Vector> on_base = (ray.z > 0.0f) & (abs(p.z + half_length) < gap);
        const Vector aslant = normalized(Vector { length * rate * p.x, length * rate * p.y, across });
        return { select(on_base, broadcast<Vector>({ 0.0f, 0.0f, -1.0f }), aslant), on_base ? (Int)BOTTOM : (Int)SIDE };
    }
};

}  // namespace warpcam
