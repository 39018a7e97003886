// The points of one tile against the casters that may stand between them and a light.
#pragma once
#include "shadow/shadow_span.h"
#if !defined(__CUDA_ARCH__)
#include "shadow/shadow_tile_simd.h"
#endif

namespace warpcam {

#if defined(__CUDA_ARCH__)

// Bounds of unknown points.
WARPCAM_DEVICE TileBounds whole_tile() { return { { -MISS, MISS, -MISS, MISS }, -MISS }; }

WARPCAM_DEVICE TileBounds bounds_uv_around(const LightSpacePoint& place, bool asks)
{
    const float u = place.beside ? -MISS : place.u, v = place.beside ? -MISS : place.v;
    return { { warp_min(asks ? u : MISS), -warp_min(asks ? place.beside ? u : -u : MISS), warp_min(asks ? v : MISS),
               -warp_min(asks ? place.beside ? v : -v : MISS) },
             warp_min(asks ? place.height : MISS) };
}

// True if any caster of a list may shade a tile.
template <class List> WARPCAM_DEVICE bool may_occlude(const List& list, const TileBounds& tile)
{
    bool any = false;
    for (int slot = threadIdx.x % WARP_SIZE; slot < (list.count + 31) / 32 * 32; slot += WARP_SIZE)
        any |= may_occlude(list.bounds_uv[slot], list.heights[slot], tile.bounds_uv, tile.floor);
    return __any_sync(FULL_WARP, any);
}

// Tests whether the lane's point, of shape `id`, which the light sees at `place`, is in the shadow of a caster. `open`
// is false in lanes that do not ask; afterwards it is true in those that still do. Meshes are not tested but named in
// `met`, bits by slot, if the way to the light intersects their boxes; returns true if there are any.
template <class Types, int LENS, class List, class HeightFields>
WARPCAM_DEVICE bool shade_tile(const List& list, const ReceiverView<LENS>& view, Vec3 p, int id, const Span& span,
                               const LightSpacePoint& place, const TileBounds& tile, bool& open,
                               const HeightFields& fields, unsigned* met)
{
    constexpr bool HAS_MESH = Types::has(MESH), HAS_FIELD = Types::has(HEIGHT_FIELD);
    const int lane = threadIdx.x % WARP_SIZE, words = (list.count + 31) / 32;
    const bool distant = view.light.distant;
    bool met_any = false;
    for (int word = 0; word < words && __any_sync(FULL_WARP, open); ++word) {
        const bool mine =
            may_occlude(list.bounds_uv[word * 32 + lane], list.heights[word * 32 + lane], tile.bounds_uv, tile.floor);
        unsigned word_met = 0;
        for (unsigned mask = __ballot_sync(FULL_WARP, mine); mask; mask &= mask - 1) {
            const int bit = ctz(mask), slot = word * 32 + bit;
            bool meets = open & may_occlude(list.bounds_uv[slot], list.heights[slot], place);
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
                const float t = intersect_any<Types::ANALYTIC>(record, ray);
                open = open & !((t > span.near) & (t < span.reach));
                if constexpr (Types::has(TRANSPARENT_CASTERS)) {
                    if (list.aims[slot].w) {
                        const float out = intersect_exit_any<Types::ANALYTIC>(record, ray);
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
