// Where a mirror lies in the view from behind it.
#pragma once
#include "camera/shape_record.h"
#include "core/vec3.h"

namespace warpcam {

// A plane in a view's frame: see layers.py, Mirror.
struct MirrorPlane {
    Vec normal;
    float distance;

    // Where a ray of the mirrored view comes out of the mirror, 0 where it begins beyond; infinity for one that does
    // not.
    template <int LENS> WARPCAM_FN float depth(const ViewRay<LENS>& ray) const
    {
        const float start = LENS != ORTHOGRAPHIC ? 0.0f : normal.x * ray.x + normal.y * ray.y;
        const float rate = dot(normal, ray.direction());
        return rate > 0.0f ? upper((distance - start) / rate, 0.0f) : ENDLESS;
    }
};

template <class Mirror> WARPCAM_FN MirrorPlane plane_of(const Mirror& mirror)
{
    return { to_vec(mirror.normal), mirror.distance };
}

}  // namespace warpcam
