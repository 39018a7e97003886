// The rays of a pixel that its paths begin with, spread evenly over the pixel.
#pragma once
#include "path/trace_path.h"

namespace warpcam {

struct CameraPath {
    PathRay ray;
    float far;   // [m] from the ray's point
    float x, y;  // of the view's ray: camera/shape_record.h
    bool blind;  // the pixel has no ray
};

// `u` and `v` in [0, 1): where in the pixel.
template <int LENS> WARPCAM_DEVICE CameraPath camera_path(const Camera& camera, int i, int j, float u, float v)
{
    const float right = u - 0.5f, down = v - 0.5f;
    CameraRay<LENS> seen = view_ray<LENS>(camera, i, j);
    Vec3 start { 0.0f, 0.0f, 0.0f }, along;
    bool blind = false;
    if constexpr (has_table(LENS))
        blind = sees_nothing(seen);
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay middle = seen.offset_ray(), to_right = seen.across(), to_below = seen.down();
        start = middle.start + right * to_right.start + down * to_below.start;
        along = normalized(middle.direction + right * to_right.direction + down * to_below.direction);
    } else {
        if constexpr (LENS == RAYS) {
            Float2 across, below;
            table_slopes(camera, i, j, across, below);
            seen = { seen.x + right * across.x + down * below.x, seen.y + right * across.y + down * below.y };
        } else {
            seen = { image_x(camera, float(i) + right), image_y(camera, float(j) + down) };
        }
        along = seen.direction();
        if (LENS == ORTHOGRAPHIC)
            start = { seen.x, seen.y, 0.0f };
    }
    const float length = wp::sqrt(dot(along, along)), near = length * camera.near;
    const Vec3 direction = transform(camera.rotation, 1.0f / length * along);
    return { { transform(camera.rotation, start) + near * direction, direction },
             length * camera.far - near,
             seen.x,
             seen.y,
             blind };
}

}  // namespace warpcam
