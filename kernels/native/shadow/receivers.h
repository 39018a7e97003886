// The points that pixels show, and what they cover as a light sees them.
#pragma once
#include "shadow/casters.h"
#include "shadow/shadow_span.h"
#include "shadow/turned_away.h"

namespace warpcam {

// Bounds of points in a light's view.
struct ReceiverBounds {
    LightSpaceBounds bounds_uv;  // of those that lie before a light that shines forwards
    float floor, top;
    bool beside, any;  // some lie behind it; there are any at all

    WARPCAM_DEVICE void add(const LightSpacePoint& place)
    {
        any = true;
        if (place.beside) {
            beside = true;
            return;
        }
        bounds_uv = { min(bounds_uv.left, place.u), max(bounds_uv.right, place.u), min(bounds_uv.bottom, place.v),
                      max(bounds_uv.top, place.v) };
        floor = min(floor, place.height);
        top = max(top, place.height);
    }

    WARPCAM_DEVICE void add(const ReceiverBounds& other)
    {
        const LightSpaceBounds& w = other.bounds_uv;
        bounds_uv = { min(bounds_uv.left, w.left), max(bounds_uv.right, w.right), min(bounds_uv.bottom, w.bottom),
                      max(bounds_uv.top, w.top) };
        floor = min(floor, other.floor);
        top = max(top, other.top);
        beside |= other.beside;
        any |= other.any;
    }
};

WARPCAM_DEVICE ReceiverBounds no_cover() { return { { MISS, -MISS, MISS, -MISS }, MISS, -MISS, false, false }; }

// The points of a region that ask, a bit each, by tiles. Without tiles it is not known beforehand which do.
template <int WIDTH, int HEIGHT> struct AskingTiles {
    static constexpr int ACROSS = WIDTH > 0 ? WIDTH / TILE_WIDTH : 1,
                         COUNT = WIDTH / TILE_WIDTH * (HEIGHT / TILE_HEIGHT);

    unsigned of[COUNT > 0 ? COUNT : 1];

    WARPCAM_DEVICE static int column(int tile) { return tile % ACROSS * TILE_WIDTH; }
    WARPCAM_DEVICE static int row(int tile) { return tile / ACROSS * TILE_HEIGHT; }

#if defined(__CUDA_ARCH__)
    // Leaves out lanes' points of a tile. Called by the only warp that looks at it.
    WARPCAM_DEVICE void leave_out(int tile, bool mine, int lane)
    {
        const unsigned done = __ballot_sync(FULL_WARP, mine);
        if (done && lane == 0)
            of[tile] &= ~done;
    }
#endif
};

#if defined(__CUDA_ARCH__)

// Union of the bounds that a warp's lanes have found.
WARPCAM_DEVICE ReceiverBounds joined(const ReceiverBounds& cover)
{
    const LightSpaceBounds& w = cover.bounds_uv;
    return { { warp_min(w.left), -warp_min(-w.right), warp_min(w.bottom), -warp_min(-w.top) },
             warp_min(cover.floor),
             -warp_min(-cover.top),
             __any_sync(FULL_WARP, cover.beside) != 0,
             __any_sync(FULL_WARP, cover.any) != 0 };
}

// The point that a pixel shows, if something may keep the light from it.
struct Asking {
    size_t at;  // the pixel
    Vec3 p;
    int id;  // of its shape
    LightSpacePoint place;
    Span span;
    bool asks;
};

template <class Task, class Target>
WARPCAM_DEVICE Asking asking_at(const Task& task, const Target& target, int column, int row)
{
    Asking a {};
    const auto& view = task.view;
    const int i = task.region.left + column, j = task.region.top + row;
    a.at = task.corner + unsigned(row * target.width + column);
    a.id = i < target.width && j < target.height ? target.shape.data[a.at] : -1;
    if (a.id >= 0) {
        const float depth = target.depth.data[a.at];
        a.p = view.reconstructor.point(float(i), float(j), depth);
        a.place = place_of(view.light.distant, view.lit.point(float(i), float(j), depth));
        a.span = span_of(view.light, view.origin, a.p, depth);
        a.asks = a.span.near < a.span.reach;
    }
    return a;
}

// Finds the points of a region that ask, and their bounds. Called by a block, whose warps each leave theirs in `covers`.
template <class Types, class Tiles, class Task, class Shapes, class Target>
WARPCAM_DEVICE void survey_region(const Task& task, const Shapes& shapes, const Target& target, ReceiverBounds* covers,
                                  Tiles& tiles, int thread)
{
    const int lane = thread % WARP_SIZE;
    ReceiverBounds cover = no_cover();
#pragma unroll 2
    for (int tile = thread / WARP_SIZE; tile < Tiles::COUNT; tile += THREADS / WARP_SIZE) {
        Asking a =
            asking_at(task, target, Tiles::column(tile) + lane % TILE_WIDTH, Tiles::row(tile) + lane / TILE_WIDTH);
        if constexpr (leaves_out_backs<Types>())
            a.asks = a.asks && !turned_away<Types>(shapes, task.world, a.id, task.view, a.p);
        if (a.asks)
            cover.add(a.place);
        const unsigned asking = __ballot_sync(FULL_WARP, a.asks);
        if (lane == 0)
            tiles.of[tile] = asking;
    }
    cover = joined(cover);
    if (thread % WARP_SIZE == 0)
        covers[thread / WARP_SIZE] = cover;
    block_sync();
    if (thread == 0)
        for (int warp = 1; warp < THREADS / WARP_SIZE; ++warp)
            covers[0].add(covers[warp]);
    block_sync();
}

#endif

// Casters that may shade some point of a region.
struct NearCasters {
    const ReceiverBounds& cover;

    WARPCAM_DEVICE bool has(const Caster& caster) const
    {
        return cover.beside || may_occlude(caster.bounds_uv, caster.height, cover.bounds_uv, cover.floor);
    }
};

}  // namespace warpcam
