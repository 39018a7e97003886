// An endless floor, which is all that most tiles show where robots stand on one: what a block knows of it beforehand
// spares these the walk over shapes. For CUDA and pinholes.
#pragma once
#include "output/hit_attributes.h"
#include "camera/shape_record.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

WARPCAM_DEVICE bool is_endless(const ShapeRecord& record)
{
    return record.axis_x.w == PLANE && record.size.x <= 0.0f && record.size.y <= 0.0f;
}

// The one that comes first of all shapes, as it begins where the camera is. Two of them touch all tiles both, so that
// no tile shows one alone.
struct InfinitePlane {
    Float3Int axis;           // the record's axis_z; w: what hits name
    float below;        // how far the camera is above it, negative
    float least, most;  // rays that come down faster than `least` and slower than `most` meet it where the view sees
    unsigned bit;       // in the ballot of what touches a tile; 0: there is none
    int shape;

    // For one thread, before the block first meets.
    WARPCAM_DEVICE void begin() { bit = 0u; }

    // For the thread that has found a shape's rank.
    WARPCAM_DEVICE void note(const ShapeRecord& record, int id, int rank, float near, float far)
    {
        if (rank > 0 || !is_endless(record))
            return;
        axis = { record.axis_z.x, record.axis_z.y, record.axis_z.z, record.axis_y.w };
        below = -record.origin.z;
        least = 0.9999f * below * rcp(near);
        most = min(1.0001f * below * rcp(far), -1.0e-18f);
        bit = 1u;
        shape = id;
    }

    // True if all rays of a warp certainly intersect the plane.
    template <int TILES_PER_WARP>
    WARPCAM_DEVICE bool test(const CameraRay<PINHOLE> (&rays)[TILES_PER_WARP], Hit (&hits)[TILES_PER_WARP]) const
    {
        const Float3Int a = axis;
        float down[TILES_PER_WARP];
        bool meets = true;
        for (int k = 0; k < TILES_PER_WARP; ++k) {
            down[k] = (a.x * rays[k].x - a.z) + a.y * rays[k].y;
            meets &= (down[k] < most) & (down[k] > least);
        }
        if (!__all_sync(FULL_WARP, meets))
            return false;
        for (int k = 0; k < TILES_PER_WARP; ++k)
            hits[k] = { below * rcp(down[k]), a.w, -1 };  // as PlaneTraits::intersect()
        return true;
    }
};

}  // namespace warpcam
#endif
