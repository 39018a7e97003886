// Sample positions of a pixel that an edge runs through.
#pragma once
#include "core/platform.h"

namespace warpcam {

constexpr int SAMPLES = 4;  // of a pixel

struct Offset {
    float right, down;  // from the pixel's centre [pixels]
};

// Sample positions of OpenGL's implementations (antialiasing.py has the same numbers).
WARPCAM_DEVICE Offset sample_offset(int sample)
{
    const bool upright = sample == 0 || sample == 3;
    const float sign = sample < 2 ? 1.0f : -1.0f;
    return { sign * (upright ? -0.125f : 0.375f), sign * (upright ? 0.375f : 0.125f) };
}

}  // namespace warpcam
