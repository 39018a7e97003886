// Random numbers by counter: the same seed, pixel, sample and dimension give the same numbers on every device.
#pragma once
#include "core/vec3.h"

namespace warpcam {

struct Random4 {
    float x, y, z, w;  // in [0, 1)
};

// The hash pcg4d of Jarzynski and Olano ("Hash Functions for GPU Rendering", JCGT 2020).
struct RandomSource {
    unsigned seed, pixel, sample, dimension;

    // Four numbers of the next dimension.
    WARPCAM_DEVICE Random4 next()
    {
        unsigned v[4] = { seed, pixel, sample, dimension++ };
        for (int k = 0; k < 4; ++k)
            v[k] = v[k] * 1664525u + 1013904223u;
        mix(v);
        for (int k = 0; k < 4; ++k)
            v[k] ^= v[k] >> 16;
        mix(v);
        return { unit(v[0]), unit(v[1]), unit(v[2]), unit(v[3]) };
    }

private:
    WARPCAM_DEVICE static void mix(unsigned (&v)[4])
    {
        v[0] += v[1] * v[3];
        v[1] += v[2] * v[0];
        v[2] += v[0] * v[1];
        v[3] += v[1] * v[2];
    }
    WARPCAM_DEVICE static float unit(unsigned bits) { return float(int(bits >> 8)) * (1.0f / 16777216.0f); }
};

}  // namespace warpcam
