// All rays of a tile at once, against a box.
#pragma once
#include "camera/shape_record.h"

namespace warpcam {

// Between which x and y a tile's rays lie in a pinhole's image: see CameraRay.
struct TileRays {
    float left, right, bottom, top;
};

// Intersects a tile's rays with the slab between two planes across an axis of a shape, `low` and `high` above the rays'
// common origin: when the first ray may enter, and the last leave. Returns false if none enters.
WARPCAM_DEVICE bool cross_slab(const TileRays& tile, const Float3Int& axis, float low, float high, float& enter,
                               float& t_far)
{
    const float left = axis.x * tile.left, right = axis.x * tile.right;
    const float bottom = axis.y * tile.bottom, top = axis.y * tile.top;
    const float slack = 1.0e-6f * (abs(left) + abs(right) + abs(bottom) + abs(top) + abs(axis.z));
    const float least = min(left, right) + min(bottom, top) - axis.z - slack;  // of the rays' steps along the axis
    const float most = max(left, right) + max(bottom, top) - axis.z + slack;
    const bool above = low > 0.0f, below = high < 0.0f;
    if ((above && !(most > 0.0f)) || (below && !(least < 0.0f)))
        return false;
    if (above || below)
        enter = max(enter, above ? low * rcp(most) : high * rcp(least));
    if (least > 0.0f || most < 0.0f)
        t_far = min(t_far, least > 0.0f ? high * rcp(least) : low * rcp(most));
    return true;
}

// True if a ray of a tile may intersect a mesh whose box has these corners in its own frame. The box is widened by more
// than all rounding.
WARPCAM_DEVICE bool may_meet_box(const ShapeRecord& record, Vec3 low, Vec3 high, const TileRays& tile)
{
    const Float3Int o = record.origin;
    const float pad = 2.0e-6f * (abs(o.x) + abs(o.y) + abs(o.z) + record.size.x);
    float enter = 0.0f, t_far = MISS;
    return cross_slab(tile, record.axis_x, low.x - pad - o.x, high.x + pad - o.x, enter, t_far)
           && cross_slab(tile, record.axis_y, low.y - pad - o.y, high.y + pad - o.y, enter, t_far)
           && cross_slab(tile, record.axis_z, low.z - pad - o.z, high.z + pad - o.z, enter, t_far)
           && 0.9999f * enter <= 1.0001f * t_far;
}

}  // namespace warpcam
