// Plane of a mirror in the view from behind it.
#pragma once
#include "camera/shape_record.h"
#include "core/vec3.h"

namespace warpcam {

// A plane in a view's frame: see layers.py, Mirror.
struct MirrorPlane {
    Vec3 normal;
    float distance;

    // Depth at which a ray of the mirrored view leaves the mirror: 0 if the ray starts beyond it, infinity if it never
    // does.
    template <int LENS> WARPCAM_DEVICE float depth(const CameraRay<LENS>& ray) const
    {
        const float start = LENS != ORTHOGRAPHIC ? 0.0f : normal.x * ray.x + normal.y * ray.y;
        const float rate = dot(normal, ray.direction());
        return rate > 0.0f ? max((distance - start) / rate, 0.0f) : MAX_RAY_T;
    }
};

template <class Mirror> WARPCAM_DEVICE MirrorPlane plane_of(const Mirror& mirror)
{
    return { as_vec3(mirror.normal), mirror.distance };
}

}  // namespace warpcam
