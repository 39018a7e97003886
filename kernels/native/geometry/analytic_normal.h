// The normal of an analytic shape at a hit, from the record that the ray met.
#pragma once
#include "camera/shape_setup.h"
#include "core/vec3.h"

namespace warpcam {

// Outwards, in the camera's frame, of any length. The rows take a place to the shape's own frame, so their transpose
// takes back the gradient of a function of that place.
template <class Types, int LENS>
WARPCAM_DEVICE Vec3 gradient(const ShapeRecord& record, const CameraRay<LENS>& seen, float depth)
{
    const int type = record.axis_x.w;
    if (Types::has(PLANE) && type == PLANE)
        return as_vec3(record.axis_z);
    const Ray ray = seen.local(record);
    Vec3 g = ray.origin + depth * ray.direction;
    visit_shape<Types::GEOMETRY & ~(1 << PLANE)>(
        type, [&](auto shape) { g = shape.gradient(record.size, g, ray.direction); });
    return transform_rows_transposed(record, g);
}

}  // namespace warpcam
