// The points of one tile against the casters that may stand between them and a light.
#pragma once
#include "shadow/casters.h"
#include "geometry/intersect_exit.h"

namespace warpcam {

// One light in one view.
template <int LENS> struct LitView {
    LightView light;
    Sight<LENS> sight;  // points from the camera, along the world's axes
    Sight<LENS> lit;    // the same along the light's axes
    Vec origin;         // the camera, world frame
    bool dims;          // its shadow takes an ambient part from what is turned away from it, too: of meshes
};

// A ray from a hit point to the light runs from t = 0 to 1, or to infinity if the light is distant. It counts from
// `near` on, past the rounding of its own starting point, to `reach`. What it enters there shades the point however
// near it is: MuJoCo's maps have the side that it leaves by, which is farther away.
struct Span {
    float near, reach;
};

WARPCAM_FN Span span_of(const LightView& light, Vec origin, Vec p, float depth)
{
    const Vec d = ray_to(light, p);
    const float rounding = 2.0e-6f
        * (magnitude(origin.x + p.x) + magnitude(origin.y + p.y) + magnitude(origin.z + p.z) + depth);
    const float near = rounding * reciprocal(root(upper(dot(d, d), 1.0e-30f)));
    return { near, reach_of(light, p, near) };
}

// That of single faces, which may be too near to the point to shade it.
WARPCAM_FN Span thin_span(const LightView& light, const Span& span)
{
    return { span.near + light.map.nearest, span.reach };
}

// The ray of an analytic shape's test, in the shape's frame.
WARPCAM_FN Ray look_back(const Record& record, const Row& aim, Vec p, bool distant)
{
    const Row o = record.origin;
    const Vec origin = WorldRay::turned(record, p, { o.x, o.y, o.z });
    const float s = distant ? 0.0f : 1.0f;
    return { origin, { aim.x - s * origin.x, aim.y - s * origin.y, aim.z - s * origin.z } };
}

// Does the way from p to the light lead through the box of a mesh? Widened by more than all rounding.
WARPCAM_FN bool meets_box(const Record& record, const Row& aim, const Box& box, Vec p, const Span& span, bool distant)
{
    const Ray ray = look_back(record, aim, p, distant);
    const Vec o = ray.origin, d = ray.direction;
    const Vec inverse { reciprocal(nonzero(d.x)), reciprocal(nonzero(d.y)), reciprocal(nonzero(d.z)) };
    const float pad = 2.0e-6f * (magnitude(o.x) + magnitude(o.y) + magnitude(o.z));
    const Vec middle { (box.center.x - o.x) * inverse.x, (box.center.y - o.y) * inverse.y,
                       (box.center.z - o.z) * inverse.z };
    const Vec half { (box.half.x + pad) * magnitude(inverse.x), (box.half.y + pad) * magnitude(inverse.y),
                     (box.half.z + pad) * magnitude(inverse.z) };
    const float enter = upper(upper(middle.x - half.x, middle.y - half.y), upper(middle.z - half.z, span.near));
    const float leave = lower(lower(middle.x + half.x, middle.y + half.y), lower(middle.z + half.z, span.reach));
    return enter <= leave;
}

// Does a height field shade the point p of shape `id`? What is in the ground is shaded by the side that the way to the
// light comes out by, as the maps have that, too; a field's own points are on its ground, where rounding would tell.
template <class HeightFields> WARPCAM_FN bool in_shade_of_field(const HeightFields& fields, const Record& record,
                                                                const LightView& light, Vec p, int id, const Span& span)
{
    const WorldRay ray { p, ray_to(light, p) };
    const float near = thin_span(light, span).near;
    if (id != record.axis_y.w && comes_out(fields, record, ray.local(record), near, span.reach))
        return true;
    Hit hit { span.reach, -1, -1 };
    walk_height_field(fields, record, ray, near, hit);
    return hit.shape >= 0;
}

// What a tile's points that ask cover, and the lowest of them.
struct TileWindow {
    Window window;
    float floor;
};

#if defined(__CUDA_ARCH__)

// That of points of which nothing is known.
WARPCAM_FN TileWindow whole_tile() { return { { -FAR_AWAY, FAR_AWAY, -FAR_AWAY, FAR_AWAY }, -FAR_AWAY }; }

WARPCAM_FN TileWindow window_around(const Place& place, bool asks)
{
    const float u = place.beside ? -FAR_AWAY : place.u, v = place.beside ? -FAR_AWAY : place.v;
    return { { warp_min(asks ? u : FAR_AWAY), -warp_min(asks ? place.beside ? u : -u : FAR_AWAY),
               warp_min(asks ? v : FAR_AWAY), -warp_min(asks ? place.beside ? v : -v : FAR_AWAY) },
             warp_min(asks ? place.height : FAR_AWAY) };
}

// Whether any caster of a list may shade a tile.
template <class List> WARPCAM_FN bool may_shade(const List& list, const TileWindow& tile)
{
    bool any = false;
    for (int slot = threadIdx.x % LANES; slot < (list.count + 31) / 32 * 32; slot += LANES)
        any |= may_shade(list.windows[slot], list.heights[slot], tile.window, tile.floor);
    return __any_sync(ALL, any);
}

// Is the lane's point, of shape `id`, which the light sees at `place`, in the shadow of a caster? `open` is false in
// lanes that do not ask; afterwards it is true in those that still do. Meshes are not tried but named in `met`, bits by
// slot, if the way to the light leads through their boxes; true if there are any.
template <int TYPES, int LENS, class List, class HeightFields>
WARPCAM_FN bool shade_tile(const List& list, const LitView<LENS>& view, Vec p, int id, const Span& span,
                           const Place& place, const TileWindow& tile, bool& open, const HeightFields& fields,
                           unsigned* met)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    const int lane = threadIdx.x % LANES, words = (list.count + 31) / 32;
    const bool distant = view.light.distant;
    bool met_any = false;
    for (int word = 0; word < words; ++word) {
        const bool mine =
            may_shade(list.windows[word * 32 + lane], list.heights[word * 32 + lane], tile.window, tile.floor);
        unsigned word_met = 0;
        for (unsigned mask = __ballot_sync(ALL, mine); mask; mask &= mask - 1) {
            const int bit = lowest_bit(mask), slot = word * 32 + bit;
            bool meets = open & may_shade(list.windows[slot], list.heights[slot], place);
            if (!__any_sync(ALL, meets))
                continue;
            const Record& record = list.records[slot];
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
                const float t = enter_any<analytic_types(TYPES)>(record, ray);
                open = open & !((t > span.near) & (t < span.reach));
                if constexpr ((TYPES >> GLASS & 1) != 0) {
                    if (list.aims[slot].w) {
                        const float out = leave_any<analytic_types(TYPES)>(record, ray);
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
