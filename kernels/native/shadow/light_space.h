// A light as a camera: where points and shapes lie as it sees them, and so which shapes may stand in its way.
#pragma once
#include "camera/shape_setup.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// A light and the frame it sees the scene in. All is relative to the camera of the view, along the world's axes.
struct LightView {
    bool distant;  // directional: its rays are parallel
    Vec3 aim;       // distant: the direction towards it; else its position
    Vec3 u, v;      // across its direction
    Vec3 w;         // distant: towards it; else the way it shines
    ShadowMap map;
};

// A point in that frame. Two points on one ray have equal u and v.
struct LightSpacePoint {
    float u, v;
    float height;  // greater is nearer to the light
    bool beside;   // behind a light that shines forwards: u and v mean nothing
};

// Bounds of a shape, or of a tile's points, in a light's view.
struct alignas(16) LightSpaceBounds {
    float left, right, bottom, top;
};

WARPCAM_DEVICE LightView make_light(bool distant, Vec3 position, Vec3 direction, const Camera& camera,
                                    const MapSize& size)
{
    LightView light;
    light.distant = distant;
    light.aim = distant
                    ? Vec3 { -direction.x, -direction.y, -direction.z }
                    : Vec3 { position.x - camera.origin.x, position.y - camera.origin.y, position.z - camera.origin.z };
    const Vec3 along = distant ? light.aim : direction;
    light.w = 1.0f / sqrt(max(dot(along, along), 1.0e-30f)) * along;
    // rows of the image run along u where they can, so that tiles on a floor fill their bounds
    const Mat3& r = camera.rotation;
    Vec3 across { r.at[0][0], r.at[1][0], r.at[2][0] };
    if (abs(dot(across, light.w)) > 0.9f)
        across = { r.at[0][1], r.at[1][1], r.at[2][1] };
    const Vec3 v = cross(light.w, across);
    light.v = 1.0f / sqrt(max(dot(v, v), 1.0e-30f)) * v;
    light.u = cross(light.v, light.w);
    const Vec3 shines = 1.0f / sqrt(max(dot(direction, direction), 1.0e-30f)) * direction;
    light.map = shadow_map(position - camera.origin, shines, { 0.0f, -shines.z, shines.y }, size);
    return light;
}

// From a point to the light: all of the way, or the direction if the light is distant.
WARPCAM_DEVICE Vec3 ray_to(const LightView& light, Vec3 p)
{
    return light.distant ? light.aim : Vec3 { light.aim.x - p.x, light.aim.y - p.y, light.aim.z - p.z };
}

// Length of a shadow ray from p to the light, in the units of ray_to(); `near` is its start.
WARPCAM_DEVICE float reach_of(const LightView& light, Vec3 p, float near)
{
    const float reach = light.distant ? MAX_RAY_T : 1.0f - near;
    const ShadowMap& map = light.map;
    if (!map.bounded)
        return reach;
    float along;
    if (!has_place(map, light.distant, p, along))
        return 0.0f;
    return light.distant ? along - map.near : min(reach, 1.0f - map.near * rcp(along));
}

// From pixels and their depths to points, in a frame of one's choice.
template <int LENS> struct PointReconstructor {
    Vec3 start, across, down;  // the ray through column i and row j: start + i * across + j * down
    Vec3 along;                // pinhole: where all rays begin; orthographic: the way they all run

    WARPCAM_DEVICE Vec3 point(float i, float j, float depth) const
    {
        const Vec3 r { start.x + i * across.x + j * down.x, start.y + i * across.y + j * down.y,
                       start.z + i * across.z + j * down.z };
        if (LENS == ORTHOGRAPHIC)
            return { r.x + depth * along.x, r.y + depth * along.y, r.z + depth * along.z };
        return { depth * r.x + along.x, depth * r.y + along.y, depth * r.z + along.z };
    }

    WARPCAM_DEVICE Vec3 along_of(Vec3 point, float,
                                 float) const  // the way the ray to a point runs, through column i and row j
    {
        return LENS == ORTHOGRAPHIC ? along : Vec3 { point.x - along.x, point.y - along.y, point.z - along.z };
    }
};

// Reconstructs points from a ray table, whose depths are distances.
template <> struct PointReconstructor<RAYS> {
    Vec3 right, up, back;  // the camera's axes
    Vec3 along;            // where all rays begin
    Camera camera;

    WARPCAM_DEVICE Vec3 point(float i, float j, float depth) const
    {
        const Vec3 d = table_ray(camera, int(i), int(j)).direction();
        return along + depth * (d.x * right + d.y * up + d.z * back);
    }

    WARPCAM_DEVICE Vec3 along_of(Vec3 point, float, float) const { return point - along; }
};

// Reconstructs points from rays with own origins.
template <> struct PointReconstructor<RAY_TABLE_WITH_ORIGINS> {
    Vec3 right, up, back;
    Vec3 along;  // where the camera is
    Camera camera;

    WARPCAM_DEVICE Vec3 point(float i, float j, float depth) const
    {
        const OffsetRay offset_ray = spread_ray(camera, int(i), int(j)).offset_ray();
        return along + axes(offset_ray.start + depth * offset_ray.direction);
    }

    WARPCAM_DEVICE Vec3 along_of(Vec3, float i, float j) const
    {
        return axes(spread_ray(camera, int(i), int(j)).direction());
    }

    WARPCAM_DEVICE Vec3 axes(Vec3 v) const { return v.x * right + v.y * up + v.z * back; }
};

// Points from the camera, along the world's axes.
template <int LENS> WARPCAM_DEVICE PointReconstructor<LENS> reconstructor_of(const Camera& camera)
{
    const Mat3& r = camera.rotation;
    const Vec3 right { r.at[0][0], r.at[1][0], r.at[2][0] }, up { r.at[0][1], r.at[1][1], r.at[2][1] };
    const Vec3 forward { -r.at[0][2], -r.at[1][2], -r.at[2][2] };
    if constexpr (has_table(LENS)) {
        return { right, up, -forward, { 0.0f, 0.0f, 0.0f }, camera };
    } else {
        const float x = image_x(camera, 0.0f), y = image_y(camera, 0.0f);
        const bool parallel = LENS == ORTHOGRAPHIC;
        const float ahead = parallel ? 0.0f : 1.0f;
        return { { x * right.x + y * up.x + ahead * forward.x, x * right.y + y * up.y + ahead * forward.y,
                   x * right.z + y * up.z + ahead * forward.z },
                 camera.scale_x * right,
                 -camera.scale_y * up,
                 (1.0f - ahead) * forward };
    }
}

// Points along the light's axes; from the light, if it is not distant.
template <int LENS>
WARPCAM_DEVICE PointReconstructor<LENS> lit_reconstructor(const LightView& light,
                                                          const PointReconstructor<LENS>& reconstructor)
{
    const auto to_light_axes = [&](Vec3 a) { return Vec3 { dot(light.u, a), dot(light.v, a), dot(light.w, a) }; };
    if constexpr (has_table(LENS)) {
        const Vec3 start = light.distant ? Vec3 { 0.0f, 0.0f, 0.0f } : -to_light_axes(light.aim);
        return { to_light_axes(reconstructor.right), to_light_axes(reconstructor.up), to_light_axes(reconstructor.back),
                 start, reconstructor.camera };
    } else {
        PointReconstructor<LENS> s { to_light_axes(reconstructor.start), to_light_axes(reconstructor.across),
                                     to_light_axes(reconstructor.down), to_light_axes(reconstructor.along) };
        if (!light.distant) {
            const Vec3 aim = to_light_axes(light.aim);
            Vec3& origin = LENS == ORTHOGRAPHIC ? s.start : s.along;
            origin = { origin.x - aim.x, origin.y - aim.y, origin.z - aim.z };
        }
        return s;
    }
}

// The place of a point that is given along the light's axes.
WARPCAM_DEVICE LightSpacePoint place_of(bool distant, Vec3 p)
{
    if (distant)
        return { p.x, p.y, p.z, false };
    const bool beside = !(p.z > 1.0e-4f * (abs(p.x) + abs(p.y)));
    const float scale = rcp(beside ? 1.0f : p.z);
    return { p.x * scale, p.y * scale, beside ? -MISS : -p.z, beside };
}

// Support of a shape: its reach from the centre along a unit direction in the shape's frame.
WARPCAM_DEVICE float reach_along(int type, Vec3 half, Vec3 n)
{
    float reach = ConvexTraits::support(half, n);
    visit_shape<ROUND_TYPES>(type, [&](auto shape) { reach = shape.support(half, n); });
    return reach;
}

// The bounds of a shape whose box has `extent` in its own frame, `position` from the camera; `height` is that of its
// point nearest to the light. Both are widened by more than the rounding of the shape's and of any point's place.
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE LightSpaceBounds bounds_uv_of(const LightView& light, int type, Vec3 position,
                                                                  const Mat3& rotation, const LocalBounds& extent,
                                                                  float& height)
{
    const Vec3 u = transform_transposed(rotation, light.u), v = transform_transposed(rotation, light.v);
    const Vec3 w = transform_transposed(rotation, light.w), back = ray_to(light, position);
    const Vec3 from = light.distant ? position : -back;
    const float pad = 1.0e-5f
                      * (abs(position.x) + abs(position.y) + abs(position.z)
                         + (light.distant ? 0.0f : abs(light.aim.x) + abs(light.aim.y) + abs(light.aim.z))
                         + extent.half.x + extent.half.y + extent.half.z);
    const float at_u = dot(light.u, from) + dot(u, extent.center), at_v = dot(light.v, from) + dot(v, extent.center);
    const float at_w = dot(light.w, from) + dot(w, extent.center);
    const float half_u = reach_along(type, extent.half, u) + pad, half_v = reach_along(type, extent.half, v) + pad;
    const float half_w = reach_along(type, extent.half, w) + pad;
    const LightSpaceBounds flat { at_u - half_u, at_u + half_u, at_v - half_v, at_v + half_v };
    height = at_w + half_w;
    if (light.distant)
        return flat;
    const float near = at_w - half_w, far = at_w + half_w;
    height = -near;
    if (far < 0.0f)  // only in the way of points behind the light, whose bounds are everything
        return { MISS, MISS, MISS, MISS };
    if (!(near > 1.0e-3f * half_w)) {
        height = MISS;
        // what is before the light and to its right lies at least `left` aside, at most `far` away
        const float rate = 0.99999f / far;
        return { flat.left > 0.0f ? flat.left * rate : -MISS, flat.right < 0.0f ? flat.right * rate : MISS,
                 flat.bottom > 0.0f ? flat.bottom * rate : -MISS, flat.top < 0.0f ? flat.top * rate : MISS };
    }
    const float at_near = 1.0f / near, at_far = 1.0f / far, slack = 1.0e-5f;
    const LightSpaceBounds seen { flat.left * (flat.left < 0.0f ? at_near : at_far),
                                  flat.right * (flat.right > 0.0f ? at_near : at_far),
                                  flat.bottom * (flat.bottom < 0.0f ? at_near : at_far),
                                  flat.top * (flat.top > 0.0f ? at_near : at_far) };
    return { seen.left - slack * abs(seen.left), seen.right + slack * abs(seen.right),
             seen.bottom - slack * abs(seen.bottom), seen.top + slack * abs(seen.top) };
}

// True if a shape with these bounds may stand between the light and a point of a tile. `height` is the shape's highest,
// `floor` the tile's lowest. Free of branches, as are the functions below.
WARPCAM_DEVICE bool may_occlude(const LightSpaceBounds& shape, float height, const LightSpaceBounds& tile, float floor)
{
    return (shape.left <= tile.right) & (shape.right >= tile.left) & (shape.bottom <= tile.top)
           & (shape.top >= tile.bottom) & (height > floor);
}

WARPCAM_DEVICE bool within(const LightSpaceBounds& bounds_uv, float u, float v)
{
    return (bounds_uv.left <= u) & (bounds_uv.right >= u) & (bounds_uv.bottom <= v) & (bounds_uv.top >= v);
}

WARPCAM_DEVICE bool may_occlude(const LightSpaceBounds& shape, float height, const LightSpacePoint& point)
{
    return (within(shape, point.u, point.v) | point.beside) & (height > point.height);
}

}  // namespace warpcam
