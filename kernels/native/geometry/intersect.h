// Nearest entry of a ray into analytic shapes, each by its traits.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// Intersects several rays with a shape of one type.
template <class Shape, int COUNT>
WARPCAM_DEVICE void intersect_all(Shape, const ShapeRecord& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    if constexpr (Shape::TYPE == CAPSULE) {
        RootHit<Vec3> sides[COUNT];
        bool any = false;
        for (int k = 0; k < COUNT; ++k) {
            sides[k] = enter_side(rays[k].origin, rays[k].direction);
            any |= sides[k].hit;
            t[k] = MISS;
        }
        if (any)
            for (int k = 0; k < COUNT; ++k)
                t[k] = Shape::intersect(sides[k], record.size.x, rays[k].origin, rays[k].direction);
    } else {
        for (int k = 0; k < COUNT; ++k)
            t[k] = Shape::intersect(record.size, rays[k].origin, rays[k].direction);
    }
}

// Intersects a shape whose type is known at run time only, out of a set known at compile time.
template <int GEOMETRY> WARPCAM_DEVICE float intersect_any(const ShapeRecord& record, Ray ray)
{
    float t = MISS;
    visit_shape<GEOMETRY>(record.axis_x.w,
                          [&](auto shape) { t = shape.intersect(record.size, ray.origin, ray.direction); });
    return t;
}

// Intersects several rays likewise; the type is one of GEOMETRY.
template <int GEOMETRY, int COUNT>
WARPCAM_DEVICE void intersect_known(const ShapeRecord& record, const Ray (&rays)[COUNT], float (&t)[COUNT])
{
    if constexpr ((GEOMETRY & ANALYTIC_TYPES) == 0)
        for (int k = 0; k < COUNT; ++k)
            t[k] = MISS;
    visit_known_shape<GEOMETRY>(record.axis_x.w, [&](auto shape) { intersect_all(shape, record, rays, t); });
}

}  // namespace warpcam
