// Colours of Gaussians that depend on the direction they are seen in: real spherical harmonics up to degree 3, with the
// signs of the associated Legendre functions' Condon-Shortley phase, as training of splats has them.
#pragma once
#include "splats/gaussian_cloud.h"
#include "core/srgb.h"

namespace warpcam {

constexpr int LINEAR_HARMONICS = 16;  // bit beside the count: see types.py, Splats.harmonics

// The colour of a Gaussian; `constant` is its part of degree 0, d a unit vector along the ray in the cloud's frame.
template <class Splats>
WARPCAM_DEVICE Vec3 harmonic_color(const Splats& splats, unsigned gaussian, Vec3 constant, Vec3 d)
{
    const unsigned row = unsigned(splats.harmonic_rows) * gaussian;
    const auto term = [&](int k, float basis) { return basis * as_vec3(load(splats.harmonics.data, row + k)); };
    const int kind = load(splats.harmonics.data, row).w, count = kind & 15;
    if (count == 0)
        return constant;
    Vec3 sum = constant + term(0, -0.48860251f * d.y) + term(1, 0.48860251f * d.z) + term(2, -0.48860251f * d.x);
    if (count > 3) {
        const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
        sum = sum + term(3, 1.09254843f * d.x * d.y) + term(4, -1.09254843f * d.y * d.z)
              + term(5, 0.31539157f * (2.0f * zz - xx - yy)) + term(6, -1.09254843f * d.x * d.z)
              + term(7, 0.54627422f * (xx - yy));
        if (count > 8)
            sum = sum + term(8, -0.59004359f * d.y * (3.0f * xx - yy)) + term(9, 2.89061144f * d.x * d.y * d.z)
                  + term(10, -0.45704580f * d.y * (4.0f * zz - xx - yy))
                  + term(11, 0.37317633f * d.z * (2.0f * zz - 3.0f * xx - 3.0f * yy))
                  + term(12, -0.45704580f * d.x * (4.0f * zz - xx - yy)) + term(13, 1.44530572f * d.z * (xx - yy))
                  + term(14, -0.59004359f * d.x * (xx - 3.0f * yy));
    }
    sum = { max(sum.x, 0.0f), max(sum.y, 0.0f), max(sum.z, 0.0f) };
    return (kind & LINEAR_HARMONICS) != 0 ? encoded_beyond(sum) : sum;
}

}  // namespace warpcam
