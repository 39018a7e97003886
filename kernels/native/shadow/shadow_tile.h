// The points of one tile against the casters that may stand between them and a light.
#pragma once
#include "shadow/casters.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

// One light in one view.
template <int LENS> struct ReceiverView {
    LightView light;
    PointReconstructor<LENS> sight;  // points from the camera, along the world's axes
    PointReconstructor<LENS> lit;    // the same along the light's axes
    Vec3 origin;         // the camera, world frame
    bool dims;          // its shadow takes an ambient part from what is turned away from it, too: of meshes
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
    const float rounding = 2.0e-6f
        * (abs(origin.x + p.x) + abs(origin.y + p.y) + abs(origin.z + p.z) + depth);
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
    const Vec3 origin = WorldRay::transform(record, p, { o.x, o.y, o.z });
    const float s = distant ? 0.0f : 1.0f;
    return { origin, { aim.x - s * origin.x, aim.y - s * origin.y, aim.z - s * origin.z } };
}

// True if the segment from p to the light intersects a mesh's box. The box is widened by more than all rounding.
WARPCAM_DEVICE bool meets_box(const ShapeRecord& record, const Float3Int& aim, const Box& box, Vec3 p, const Span& span, bool distant)
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
    const float leave = min(min(middle.x + half.x, middle.y + half.y), min(middle.z + half.z, span.reach));
    return enter <= leave;
}

// True if a height field shades the point p of shape `id`. Points inside the ground are shaded by the side through
// which the way to the light leaves, as in shadow maps; a field's own points lie on its ground, where rounding would
// decide.
template <class HeightFields> WARPCAM_DEVICE bool in_shade_of_field(const HeightFields& fields, const ShapeRecord& record,
                                                                const LightView& light, Vec3 p, int id, const Span& span)
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
struct TileWindow {
    LightSpaceBounds window;
    float floor;
};

#if defined(__CUDA_ARCH__)

// Bounds of unknown points.
WARPCAM_DEVICE TileWindow whole_tile() { return { { -MISS, MISS, -MISS, MISS }, -MISS }; }

WARPCAM_DEVICE TileWindow window_around(const LightSpacePoint& place, bool asks)
{
    const float u = place.beside ? -MISS : place.u, v = place.beside ? -MISS : place.v;
    return { { warp_min(asks ? u : MISS), -warp_min(asks ? place.beside ? u : -u : MISS),
               warp_min(asks ? v : MISS), -warp_min(asks ? place.beside ? v : -v : MISS) },
             warp_min(asks ? place.height : MISS) };
}

// True if any caster of a list may shade a tile.
template <class List> WARPCAM_DEVICE bool may_occlude(const List& list, const TileWindow& tile)
{
    bool any = false;
    for (int slot = threadIdx.x % WARP_SIZE; slot < (list.count + 31) / 32 * 32; slot += WARP_SIZE)
        any |= may_occlude(list.windows[slot], list.heights[slot], tile.window, tile.floor);
    return __any_sync(FULL_WARP, any);
}

// Tests whether the lane's point, of shape `id`, which the light sees at `place`, is in the shadow of a caster. `open`
// is false in lanes that do not ask; afterwards it is true in those that still do. Meshes are not tested but named in
// `met`, bits by slot, if the way to the light intersects their boxes; returns true if there are any.
template <int TYPES, int LENS, class List, class HeightFields>
WARPCAM_DEVICE bool shade_tile(const List& list, const ReceiverView<LENS>& view, Vec3 p, int id, const Span& span,
                           const LightSpacePoint& place, const TileWindow& tile, bool& open, const HeightFields& fields,
                           unsigned* met)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    const int lane = threadIdx.x % WARP_SIZE, words = (list.count + 31) / 32;
    const bool distant = view.light.distant;
    bool met_any = false;
    for (int word = 0; word < words; ++word) {
        const bool mine =
            may_occlude(list.windows[word * 32 + lane], list.heights[word * 32 + lane], tile.window, tile.floor);
        unsigned word_met = 0;
        for (unsigned mask = __ballot_sync(FULL_WARP, mine); mask; mask &= mask - 1) {
            const int bit = ctz(mask), slot = word * 32 + bit;
            bool meets = open & may_occlude(list.windows[slot], list.heights[slot], place);
            if (!__any_sync(FULL_WARP, meets))
                continue;
            const ShapeRecord& record = list.records[slot];
            const int type = record.axis_x.w;
            if (HAS_MESH && type == MESH) {
                meets = meets
                        & meets_box(record, list.aims[slot], list.boxes[slot], p, thin_span(view.light, span), distant);
                word_met |= meets ? 1u << bit : 0u;
            } else if (HAS_FIELD && type == HEIGHT_FIELD) {
                if (meets)
                    open = !in_shade_of_field(fields, record, view.light, p, id, span);
                __syncwarp();
            } else {
                const Ray ray = look_back(record, list.aims[slot], p, distant);
                const float t = intersect_any<analytic_types(TYPES)>(record, ray);
                open = open & !((t > span.near) & (t < span.reach));
                if constexpr ((TYPES >> TRANSPARENT_CASTERS & 1) != 0) {
                    if (list.aims[slot].w) {
                        const float out = intersect_exit_any<analytic_types(TYPES)>(record, ray);
                        open = open & !((out > thin_span(view.light, span).near) & (out < span.reach));
                    }
                }
            }
        }
        if (HAS_MESH) {
            met[word] = word_met;
            met_any |= word_met != 0;
        }
    }
    return met_any;
}

#endif

}  // namespace warpcam

#if !defined(__CUDA_ARCH__)
#include "shadow/shadow_tile_simd.h"
#endif
