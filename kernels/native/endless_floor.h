// An endless floor, which is all that most tiles show where robots stand on one: what a block knows of it beforehand spares
// these the walk over shapes. For CUDA and pinholes.
#pragma once
#include "hits.h"
#include "record.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

WARPCAM_FN bool is_endless(const Record& record)
{
    return record.axis_x.w == PLANE && record.size.x <= 0.0f && record.size.y <= 0.0f;
}

struct EndlessFloor {
    Row axis;           // the record's axis_z; w: the shape
    float height;       // of the camera above it
    float least, most;  // rays that come down faster than `least` and slower than `most` meet it where the view sees
    unsigned bit;       // of its rank in the ballot of what touches a tile; 0: there is none

    // For one thread, before the block first meets.
    WARPCAM_FN void begin()
    {
        axis = { 0.0f, 0.0f, -1.0f, -1 };
        least = most = 0.0f;
        bit = 0u;
    }

    // For the thread that has found a shape's rank. Of two such planes both touch all tiles, so that none is found alone.
    WARPCAM_FN void note(const Record& record, int shape, int rank, float near, float far)
    {
        if (!is_endless(record) || rank >= LANES)
            return;
        axis = { record.axis_z.x, record.axis_z.y, record.axis_z.z, shape };
        height = record.origin.z;
        least = -0.9999f * height / near;
        most = lower(-1.0001f * height / far, -1.0e-18f);
        bit = 1u << rank;
    }

    // Do all rays of a warp meet it? Depths are those of enter_plane().
    template <int TALL> WARPCAM_FN bool meet(const ViewRay<PINHOLE> (&rays)[TALL], Hit (&hits)[TALL]) const
    {
        const Row a = axis;
        float down[TALL];
        bool meets = true;
        for (int k = 0; k < TALL; ++k) {
            down[k] = (a.x * rays[k].x - a.z) + a.y * rays[k].y;
            meets &= (down[k] < most) & (down[k] > least);
        }
        if (!__all_sync(ALL, meets))
            return false;
        for (int k = 0; k < TALL; ++k)
            hits[k] = { -height * reciprocal(down[k]), a.w, -1 };
        return true;
    }
};

}  // namespace warpcam
#endif
