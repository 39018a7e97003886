// Segments from points to a light, and tests of single casters against them, one point at a time.
#pragma once
#include "shadow/casters.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

// One light in one view.
template <int LENS> struct ReceiverView {
    LightView light;
    PointReconstructor<LENS> reconstructor;  // points from the camera, along the world's axes
    PointReconstructor<LENS> lit;    // the same along the light's axes
    Vec3 origin;         // the camera, world frame
    bool dims;          // its shadow takes an ambient part from what is turned away from it, too
};

// A ray from a hit point to the light runs from t = 0 to 1, or to infinity if the light is distant. It counts from
// `near` on, past the rounding of its own starting point, to `reach`. What it enters there shades the point however
// near it is: MuJoCo's maps have the side that it leaves by, which is farther away.
struct Span {
    float near, reach;
};

WARPCAM_DEVICE Span span_of(const LightView& light, Vec3 origin, Vec3 p, float depth)
{
    const Vec3 d = ray_to(light, p);
    const float rounding = 2.0e-6f * (abs(origin.x + p.x) + abs(origin.y + p.y) + abs(origin.z + p.z) + depth);
    const float near = rounding * rcp(sqrt(max(dot(d, d), 1.0e-30f)));
    return { near, reach_of(light, p, near) };
}

// Span of single faces, which may be too near to the point to shade it.
WARPCAM_DEVICE Span thin_span(const LightView& light, const Span& span)
{
    return { span.near + light.map.nearest, span.reach };
}

// The ray of an analytic shape's test, in the shape's frame.
WARPCAM_DEVICE Ray look_back(const ShapeRecord& record, const Float3Int& aim, Vec3 p, bool distant)
{
    const Float3Int o = record.origin;
    const Vec3 origin = transform_rows(record, p, o);
    const float s = distant ? 0.0f : 1.0f;
    return { origin, { aim.x - s * origin.x, aim.y - s * origin.y, aim.z - s * origin.z } };
}

// True if the segment from p to the light intersects a mesh's box. The box is widened by more than all rounding.
WARPCAM_DEVICE bool meets_box(const ShapeRecord& record, const Float3Int& aim, const Box& box, Vec3 p, const Span& span,
                              bool distant)
{
    const Ray ray = look_back(record, aim, p, distant);
    const Vec3 o = ray.origin, d = ray.direction;
    const Vec3 inverse { rcp(avoid_zero(d.x)), rcp(avoid_zero(d.y)), rcp(avoid_zero(d.z)) };
    const float pad = 2.0e-6f * (abs(o.x) + abs(o.y) + abs(o.z));
    const Vec3 middle { (box.center.x - o.x) * inverse.x, (box.center.y - o.y) * inverse.y,
                        (box.center.z - o.z) * inverse.z };
    const Vec3 half { (box.half.x + pad) * abs(inverse.x), (box.half.y + pad) * abs(inverse.y),
                      (box.half.z + pad) * abs(inverse.z) };
    const float enter = max(max(middle.x - half.x, middle.y - half.y), max(middle.z - half.z, span.near));
    const float t_far = min(min(middle.x + half.x, middle.y + half.y), min(middle.z + half.z, span.reach));
    return enter <= t_far;
}

// True if a height field shades the point p of shape `id`. Points inside the ground are shaded by the side through
// which the way to the light leaves, as in shadow maps; a field's own points lie on its ground, where rounding would
// decide.
template <class HeightFields> WARPCAM_DEVICE bool in_shade_of_field(const HeightFields& fields,
                                                                    const ShapeRecord& record, const LightView& light,
                                                                    Vec3 p, int id, const Span& span)
{
    const WorldRay ray { p, ray_to(light, p) };
    const float near = thin_span(light, span).near;
    if (id != record.axis_y.w && comes_out(fields, record, ray.local(record), near, span.reach))
        return true;
    Hit hit { span.reach, -1, -1 };
    walk_height_field(fields, record, ray, near, hit);
    return hit.shape >= 0;
}

// Bounds of a tile's points that ask, and the lowest of them.
struct TileBounds {
    LightSpaceBounds bounds_uv;
    float floor;
};

}  // namespace warpcam
