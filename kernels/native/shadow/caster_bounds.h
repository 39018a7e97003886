// Bounds of points and casters in a light's view, quantised so that a thousand casters fit in shared memory.
#pragma once
#include "shadow/receivers.h"

namespace warpcam {

constexpr int GRID_CELLS = 128;  // that what a region's points cover is divided into, along u and v
constexpr int PLACE_BITS = 20;  // of a shape's place among those that are drawn
constexpr unsigned LEVELS = 1u << (32 - PLACE_BITS);  // that their heights are divided into
constexpr unsigned GUARDS = 0x80808080u;

// A caster: the cells that it covers, and its height above its place among the shapes that are drawn.
// The cells are four bytes: left, bottom, and what is right of it and above it.
struct alignas(8) PackedCasterBounds {
    unsigned cells, rest;
};

// The cells and levels of a region. Numbers only ever grow with what they stand for, and are the same for shapes and
// points: none that covers another is missed, whatever the rounding.
struct Grid {
    float left, bottom, floor;
    float per_u, per_v, per_height;
    bool distant;  // the light is
    bool endless;  // some points are behind the light: nothing is said by what it sees

    // Maps a coordinate beside a light, which is far away along u and v, to between -1 and 1.
    WARPCAM_DEVICE static float bent(float x, bool distant)
    {
        const float rest = 1.0f / (1.0f + abs(x));  // rounded as a division is, which never turns an order round
        return distant ? x : x < 0.0f ? rest - 1.0f : 1.0f - rest;
    }
    WARPCAM_DEVICE static unsigned number(float value, float from, float rate, float last)
    {
        return unsigned(int(max(min((value - from) * rate, last), 0.0f)));
    }
    WARPCAM_DEVICE unsigned column(float u) const
    {
        return number(bent(u, distant), left, per_u, float(GRID_CELLS - 1));
    }
    WARPCAM_DEVICE unsigned row(float v) const
    {
        return number(bent(v, distant), bottom, per_v, float(GRID_CELLS - 1));
    }
    WARPCAM_DEVICE unsigned level(float height) const { return number(height, floor, per_height, float(LEVELS - 1)); }

    WARPCAM_DEVICE PackedCasterBounds of_shape(const LightSpaceBounds& w, float height, int place) const
    {
        const unsigned last = GRID_CELLS - 1;
        return { column(w.left) | row(w.bottom) << 8 | (last - column(w.right)) << 16 | (last - row(w.top)) << 24,
                 level(height) << PLACE_BITS | unsigned(place) };
    }

    // Packs the bounds of points for a comparison with casters: the opposite sides, and the lowest point.
    WARPCAM_DEVICE PackedCasterBounds of_points(const ReceiverBounds& cover) const
    {
        if (cover.beside)
            return { 0x7f7f7f7fu | GUARDS, 0u };
        const LightSpaceBounds& w = cover.bounds_uv;
        const unsigned last = GRID_CELLS - 1;
        const unsigned against = (last - column(w.left)) << 16 | (last - row(w.bottom)) << 24;
        return { column(w.right) | row(w.top) << 8 | against | GUARDS, level(cover.floor) << PLACE_BITS };
    }
};

WARPCAM_DEVICE Grid grid_of(const ReceiverBounds& all, bool distant)
{
    const LightSpaceBounds& w = all.bounds_uv;
    const float left = Grid::bent(w.left, distant), right = Grid::bent(w.right, distant);
    const float bottom = Grid::bent(w.bottom, distant), top = Grid::bent(w.top, distant), least = 1.0e-20f;
    return { left,
             bottom,
             all.floor,
             float(GRID_CELLS) / max(right - left, least),
             float(GRID_CELLS) / max(top - bottom, least),
             float(LEVELS) / max(all.top - all.floor, least),
             distant,
             all.beside };
}

WARPCAM_DEVICE bool may_occlude(const PackedCasterBounds& shape, const PackedCasterBounds& points)
{
    return ((points.cells - shape.cells) & GUARDS) == GUARDS && shape.rest >= points.rest;
}

}  // namespace warpcam
