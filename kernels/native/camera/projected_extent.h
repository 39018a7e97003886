// Projected extent of a round shape in a view.
#pragma once
#include "camera/ray_table.h"
#include "core/vec3.h"

namespace warpcam {

// Bounds of a shape in an image: x and y, up, of all its points divided by their depth, or undivided for parallel rays.
struct ViewSpan {
    float left, right, low, high;

    WARPCAM_DEVICE void take(float x0, float x1, float y0, float y1)
    {
        left = min(left, min(x0, x1));
        right = max(right, max(x0, x1));
        low = min(low, min(y0, y1));
        high = max(high, max(y0, y1));
    }
};

constexpr int ROUND_TYPES = types_with([](auto shape) { return shape.IS_ROUND; });

// Bounds of a round shape, which lies between two equal ellipsoids: these are half a sphere's or a disk's length from
// its middle, or coincide. An ellipsoid at `at` with half axes w spans the cone that touches it. `center`: of its box,
// with the depth there, which is positive for all of it; m: the axes of its own frame; e: half widths.
template <int LENS>
WARPCAM_DEVICE void span_round(int type, Vec3 center, float depth, const Mat3& m, Vec3 e, ViewSpan& span)
{
    Vec3 half = e;
    visit_shape<ROUND_TYPES>(type, [&](auto shape) { half.z = shape.end_extent(e); });
    const float length = e.z - half.z;
    const Vec3 x { half.x * m.at[0][0], half.y * m.at[1][0], half.z * m.at[2][0] };
    const Vec3 y { half.x * m.at[0][1], half.y * m.at[1][1], half.z * m.at[2][1] };
    const Vec3 z { half.x * m.at[0][2], half.y * m.at[1][2], half.z * m.at[2][2] };
    const float xx = dot(x, x), yy = dot(y, y), zz = dot(z, z), xz = dot(x, z), yz = dot(y, z);
    constexpr float MORE = 1.0001f;  // than rounding takes off
#pragma unroll
    for (int k = 0; k < 2; ++k) {
        const float step = k ? length : -length;
        const Vec3 at { center.x + step * m.at[2][0], center.y + step * m.at[2][1], depth - step * m.at[2][2] };
        if (LENS == ORTHOGRAPHIC) {
            const float wide = MORE * sqrt(xx), tall = MORE * sqrt(yy);
            span.take(at.x - wide, at.x + wide, at.y - tall, at.y + tall);
            continue;
        }
        const Vec3 across = at.z * x + at.x * z, along = at.z * y + at.y * z;
        const float wide = MORE * sqrt(max(dot(across, across) - (xx * zz - xz * xz), 0.0f));
        const float tall = MORE * sqrt(max(dot(along, along) - (yy * zz - yz * yz), 0.0f));
        const float rate = rcp(at.z * at.z - zz), middle = at.x * at.z + xz, level = at.y * at.z + yz;
        span.take((middle - wide) * rate, (middle + wide) * rate, (level - tall) * rate, (level + tall) * rate);
    }
}

}  // namespace warpcam
