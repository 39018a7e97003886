// All rays of a tile at once, against a box.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// Between which x and y a tile's rays lie in a pinhole's image: see ViewRay.
struct TileRays {
    float left, right, bottom, top;
};

// When the first of a tile's rays may enter, and the last leave, what lies between two planes across an axis of a
// shape, which are `low` and `high` above where all rays begin. False if none does.
WARPCAM_FN bool cross_slab(const TileRays& tile, const Row& axis, float low, float high, float& enter, float& leave)
{
    const float left = axis.x * tile.left, right = axis.x * tile.right;
    const float bottom = axis.y * tile.bottom, top = axis.y * tile.top;
    const float slack = 1.0e-6f
        * (magnitude(left) + magnitude(right) + magnitude(bottom) + magnitude(top) + magnitude(axis.z));
    const float least = lower(left, right) + lower(bottom, top) - axis.z - slack;  // of the rays' steps along the axis
    const float most = upper(left, right) + upper(bottom, top) - axis.z + slack;
    const bool above = low > 0.0f, below = high < 0.0f;
    if ((above && !(most > 0.0f)) || (below && !(least < 0.0f)))
        return false;
    if (above || below)
        enter = upper(enter, above ? low * reciprocal(most) : high * reciprocal(least));
    if (least > 0.0f || most < 0.0f)
        leave = lower(leave, least > 0.0f ? high * reciprocal(least) : low * reciprocal(most));
    return true;
}

// May a ray of a tile meet a mesh whose box has these corners in its own frame? Widened by more than all rounding.
WARPCAM_FN bool may_meet_box(const Record& record, Vec low, Vec high, const TileRays& tile)
{
    const Row o = record.origin;
    const float pad = 2.0e-6f * (magnitude(o.x) + magnitude(o.y) + magnitude(o.z) + record.size.x);
    float enter = 0.0f, leave = FAR_AWAY;
    return cross_slab(tile, record.axis_x, low.x - pad - o.x, high.x + pad - o.x, enter, leave)
        && cross_slab(tile, record.axis_y, low.y - pad - o.y, high.y + pad - o.y, enter, leave)
        && cross_slab(tile, record.axis_z, low.z - pad - o.z, high.z + pad - o.z, enter, leave)
        && 0.9999f * enter <= 1.0001f * leave;
}

}  // namespace warpcam
