// A shape as one view sees it: the record every ray of the view is tested against.
#pragma once
#include "lanes.h"

namespace warpcam {

// Values of types.py.
enum ShapeType { PLANE, HEIGHT_FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH };
enum Lens { PINHOLE, ORTHOGRAPHIC };

// The rows take camera coordinates to the shape's own, in which spheres and ellipsoids are the unit sphere, boxes
// the cube of half width 1, cylinders have radius and half length 1, capsules radius 1; the rest is unscaled.
// A ray of the view is then origin + t * row . (x, y, -1), and its t is planar depth.
struct Record {
    Row axis_x;  // w: shape type
    Row axis_y;  // w: shape id
    Row axis_z;  // w: asset, the index of a mesh or height field
    Row origin;  // the camera's centre in the shape's frame; w: see casters.h, else unused
    Row size;    // plane: half widths, 0 infinite; capsule: x = half length / radius; height field: half widths, base
                 // depth. w: bits of `nearest`, a lower bound of the planar depth of every point of the shape
};

template <int TYPES> WARPCAM_FN bool is_mesh(const Record& record)
{
    return (TYPES >> MESH & 1) && record.axis_x.w == MESH;
}

struct Ray {
    Vec origin, direction;  // in the shape's frame
};

// The ray's own view of space: coordinates in which it runs from the origin along depth alone.
struct RayFrame {
    Vec origin;
    Vec across, up, depth;  // rows; across x up points against the ray, depth . (t * direction) is t
};

// The ray of a view through (x, y) of its image.
template <int LENS> struct ViewRay {
    float x, y;

    WARPCAM_FN Ray local(const Record& record) const
    {
        const Row ax = record.axis_x, ay = record.axis_y, az = record.axis_z, o = record.origin;
        if (LENS == ORTHOGRAPHIC)
            return { { o.x + ax.x * x + ax.y * y, o.y + ay.x * x + ay.y * y, o.z + az.x * x + az.y * y },
                     { -ax.z, -ay.z, -az.z } };
        return { { o.x, o.y, o.z },
                 { ax.x * x + ax.y * y - ax.z, ay.x * x + ay.y * y - ay.z, az.x * x + az.y * y - az.z } };
    }

    WARPCAM_FN RayFrame frame(const Record& record) const
    {
        const Row ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
        const Vec origin = local(record).origin;
        const Vec depth { -ax.z, -ay.z, -az.z };
        if (LENS == ORTHOGRAPHIC)
            return { origin, { ax.x, ay.x, az.x }, { ax.y, ay.y, az.y }, depth };
        return { origin,
                 { muladd(x, ax.z, ax.x), muladd(x, ay.z, ay.x), muladd(x, az.z, az.x) },
                 { muladd(y, ax.z, ax.y), muladd(y, ay.z, ay.y), muladd(y, az.z, az.y) },
                 depth };
    }
};

}  // namespace warpcam
