// A plane: the xy-plane seen from above, of two half widths, or endless where one of them is 0.
#pragma once
#include "shapes/shape_types.h"

namespace warpcam {

struct PlaneTraits : ConvexTraits {
    static constexpr ShapeType TYPE = PLANE;
    static constexpr bool HAS_EXIT = false, SHADES_ITSELF = false;

    static WARPCAM_DEVICE Vec3 axes(Vec3 size) { return size; }
    static WARPCAM_DEVICE Vec3 half_extents(Vec3 size)
    {
        const Vec3 half = unit_size(size, size);
        return { half.x > 0.0f && half.y > 0.0f ? half.x : -1.0f, half.y, 0.0f };
    }
    static WARPCAM_DEVICE bool is_valid(Vec3, Vec3) { return true; }
    static WARPCAM_DEVICE Vec3 unit_scale(Vec3, Vec3) { return { 1.0f, 1.0f, 1.0f }; }
    static WARPCAM_DEVICE Vec3 unit_size(Vec3 size, Vec3)
    {
        return { size.x < MISS ? size.x : 0.0f, size.y < MISS ? size.y : 0.0f, 0.0f };
    }
    template <class Number> static WARPCAM_DEVICE Number bounding_radius(Number, Number, Number) { return MISS; }

    template <class Vector> static WARPCAM_DEVICE NumberOf<Vector> intersect(const Float3Int& size, Vector o, Vector d)
    {
        const auto t = -o.z * rcp(avoid_zero(d.z));
        const float limit_x = size.x <= 0.0f ? MISS : size.x, limit_y = size.y <= 0.0f ? MISS : size.y;
        const MaskOf<Vector> inside = (abs(o.x + t * d.x) <= limit_x) & (abs(o.y + t * d.y) <= limit_y);
        return ((d.z < 0.0f) & inside) ? t : MISS;
    }
};

}  // namespace warpcam
