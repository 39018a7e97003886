// The spheres around eight shapes at once, on a CPU: what these leave out need not be looked at closely.
#pragma once
#include "core/simd8.h"
#include "geometry/shape_state.h"

namespace warpcam {

struct Spheres {
    Vec3x8 at;  // world frame
    Float8 radius;
    Int8 unknown;   // how large the shape is, or it is broken or formless: see Visible
    unsigned there;  // a bit each: the last may be fewer than eight
};

// Radii of balls that hold shapes, MISS of those that have none.
template <class... Shapes> inline Float8 bounding_radii(Int8 type, const Vec3x8& size, ShapeTable<Shapes...>)
{
    Float8 radius = MISS;
    ((radius = type == int(Shapes::TYPE) ? Shapes::bounding_radius(size.x, size.y, size.z) : radius), ...);
    return radius;
}

// Loads the bounding spheres of the drawn shapes from `first` on.
template <class Shapes> inline Spheres load_spheres(const Shapes& shapes, int world, int first)
{
    const int count = min(SIMD_WIDTH, shapes.drawn.shape[0] - first);
    Spheres s;
    Vec3x8 size;
    Int8 type;
    Float8 turns;
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const int id = wp::index(shapes.drawn, first + min(k, count - 1));
        const float* const turn = &wp::address(shapes.rotations, world, id)->data[0][0];
        set_lane(s.at, k, as_vec3(wp::index(shapes.positions, world, id)));
        set_lane(size, k, as_vec3(per_world(shapes.sizes, world, id)));
        type[k] = wp::index(shapes.types, id);
        float sum = 0.0f;
        for (int n = 0; n < 9; ++n)
            sum += turn[n];
        turns[k] = sum;
    }
    const Float8 none = 0.0f;
    s.radius = bounding_radii(type, size, AnalyticShapes());
    s.unknown = ~((abs(s.at.x + s.at.y + s.at.z + turns + size.x + size.y + size.z + s.radius) < MISS) & (turns != none)
                  & ((size.x > none) | (size.y > none) | (size.z > none)));
    s.there = (1u << count) - 1;
    return s;
}

// Bit mask of the spheres that a cone of rays may show.
inline unsigned spheres_in(const Spheres& s, const Camera& camera, const RegionCone& cone)
{
    const Vec3x8 offset = s.at - broadcast(camera.origin);
    const Float8 length = sqrt(dot(offset, offset)), radius = s.radius + 1.0e-4f * (s.radius + length);
    const Float8 sine = min(radius / length, (Float8)1.0f), cosine = sqrt(max(1.0f - sine * sine, (Float8)0.0f));
    const Float8 wide = cone.cosine;
    const Float8 along = dot(broadcast(transform(camera.rotation, cone.axis)), offset);
    const Int8 inside = (length <= radius) | (along >= least_along(wide, cosine, sine) * length);
    return movemask(inside | s.unknown) & s.there;
}

// Bit mask of the spheres that a region of a view may show. `cone` holds the region's rays, of a lens that is a table.
template <int LENS>
inline unsigned spheres_in(const Spheres& s, const Camera& camera, const Region& region, const RegionCone& cone)
{
    if constexpr (LENS == RAYS)
        return spheres_in(s, camera, cone);
    if constexpr (has_table(LENS))
        return s.there;
    const Mat3& r = camera.rotation;
    const Vec3x8 offset = s.at - broadcast(camera.origin);
    const auto along = [&](int axis) {
        return r.at[0][axis] * offset.x + r.at[1][axis] * offset.y + r.at[2][axis] * offset.z;
    };
    const Float8 x = along(0), y = along(1), depth = -along(2), one = 1.0f;
    const Float8 radius = s.radius + 1.0e-4f * (s.radius + abs(x) + abs(y) + abs(depth));
    Int8 outside = (depth + radius < camera.near) | (depth - radius > camera.far);
    const Float8 away = LENS == ORTHOGRAPHIC ? one : depth;
    const auto beyond = [&](Float8 at, float edge,
                            float sign) {  // the plane through an edge of the region and the camera
        const float length = LENS == ORTHOGRAPHIC ? 1.0f : sqrt(1.0f + edge * edge);
        return sign * (at - edge * away) > length * radius;
    };
    // a pixel more on each side
    const float sides[2] = { image_x(camera, float(region.left - 1)),
                             image_x(camera, float(region.left + region.width)) };
    const float ends[2] = { image_y(camera, float(region.top - 1)),
                            image_y(camera, float(region.top + region.height)) };
    outside |= beyond(x, min(sides[0], sides[1]), -1.0f) | beyond(x, max(sides[0], sides[1]), 1.0f)
               | beyond(y, min(ends[0], ends[1]), -1.0f) | beyond(y, max(ends[0], ends[1]), 1.0f);
    return movemask(~outside | s.unknown) & s.there;
}

}  // namespace warpcam
