// What follows from a hit alone, without its surface: distance, point, body.
#pragma once
#include "pixels.h"

namespace warpcam {

// What the trace found at a pixel.
struct Found {
    int shape, face;
    float depth;
};

WARPCAM_FN Vec turned(const Matrix& m, Vec v)
{
    return { m.at[0][0] * v.x + m.at[0][1] * v.y + m.at[0][2] * v.z,
             m.at[1][0] * v.x + m.at[1][1] * v.y + m.at[1][2] * v.z,
             m.at[2][0] * v.x + m.at[2][1] * v.y + m.at[2][2] * v.z };
}

template <int LENS> WARPCAM_FN float distance_of(const Found& found, float x, float y)
{
    const float length = LENS == PINHOLE ? root(x * x + y * y + 1.0f) : 1.0f;
    return found.shape >= 0 ? found.depth * length : infinity();
}

template <int LENS> WARPCAM_FN Vec point_of(const Found& found, const Camera& camera, float x, float y)
{
    if (found.shape < 0)
        return { infinity(), infinity(), infinity() };
    const float near = LENS == PINHOLE ? found.depth : 1.0f;
    return camera.origin + turned(camera.rotation, { near * x, near * y, -found.depth });
}

template <class Shapes> WARPCAM_FN int body_of(const Found& found, const Shapes& shapes)
{
    return found.shape >= 0 ? wp::index(shapes.bodies, found.shape) : -1;
}

}  // namespace warpcam
