// Directions around an axis, and the usual ways to draw them.
#pragma once
#include "core/vec3.h"

namespace warpcam {

// Sine and cosine of 2 pi u, to the last digits on CUDA, too: the quick ones of core/vec3.h are off by 1e-6.
WARPCAM_DEVICE Float2 on_circle(float u)
{
    const float angle = 6.28318530717959f * u;
    return { wp::cos(angle), wp::sin(angle) };
}

// An orthonormal frame whose third axis is given (Duff et al., JCGT 2017).
struct FrameAxes {
    Vec3 x, y, z;

    WARPCAM_DEVICE explicit FrameAxes(Vec3 axis) : z(axis)
    {
        const float side = axis.z < 0.0f ? -1.0f : 1.0f, a = -1.0f / (side + axis.z), b = axis.x * axis.y * a;
        x = { 1.0f + side * axis.x * axis.x * a, side * b, -side * axis.x };
        y = { b, side + axis.y * axis.y * a, -axis.y };
    }
    WARPCAM_DEVICE Vec3 local(Vec3 v) const { return { dot(x, v), dot(y, v), dot(z, v) }; }
    WARPCAM_DEVICE Vec3 world(Vec3 v) const { return v.x * x + v.y * y + v.z * z; }
};

// Density cosine / pi about +z.
WARPCAM_DEVICE Vec3 cosine_direction(float u, float v)
{
    const Float2 turn = on_circle(v);
    const float radius = wp::sqrt(u);
    return { radius * turn.x, radius * turn.y, wp::sqrt(max(1.0f - u, 0.0f)) };
}

// Even over the cap about +z, whose height 1 - cosine of its edge is given; all around for 2.
WARPCAM_DEVICE Vec3 cap_direction(float u, float v, float height)
{
    const Float2 turn = on_circle(v);
    const float down = u * height, radius = wp::sqrt(max(down * (2.0f - down), 0.0f));
    return { radius * turn.x, radius * turn.y, 1.0f - down };
}

}  // namespace warpcam
