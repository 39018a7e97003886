// Where the rays of a pixel lie: the same in each frame, and in each block of 4 x 4 pixels.
//
// The 64 rays of a block are the first points of Sobol's sequence, a (0, 6, 2)-net in base 2: one in each of 64 boxes of
// the unit square, for boxes of each shape. Those of a pixel, and of each four that make a square of a block, are such
// nets, too (Keller and Heidrich, "Interleaved Sampling", 2001, with nets for their lattices).
#pragma once
#include "core/vec3.h"

namespace warpcam {

constexpr int OCCLUSION_RAYS = 4;  // of a pixel
constexpr int OCCLUSION_BLOCK = 4;  // pixels, across and down

struct RayPattern {
    int first;  // number of the pixel's first point

    WARPCAM_DEVICE RayPattern(int column, int row)
    {
        first = OCCLUSION_RAYS * ((column & 1) | (row & 1) << 1 | (column & 2) << 1 | (row & 2) << 2);
    }

    // A point in [0, 1) x [0, 1).
    WARPCAM_DEVICE Float2 point(int ray) const
    {
        int x = 0, y = 0, v = 32;
        for (int bit = 0; bit < 6; ++bit, v ^= v >> 1)
            if ((first + ray) >> bit & 1) {
                x ^= 32 >> bit;
                y ^= v;
            }
        return { (float(x) + 0.5f) * (1.0f / 64.0f), (float(y) + 0.5f) * (1.0f / 64.0f) };
    }
};

}  // namespace warpcam
