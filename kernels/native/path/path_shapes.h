// The shapes of a world as rays in any direction meet them: a list for each world, made once a frame.
//
// All is relative to the view's camera, along the world's axes, so that a world may be far from its origin.
#pragma once
#include "geometry/shape_state.h"
#include "path/frame_axes.h"

namespace warpcam {

// Rows of one shape: middle and radius of a ball that holds it, of MISS without bounds; the five of its ShapeRecord, whose
// rows take world directions to the shape's; `origin`, the camera's place there, has in its w ShapeBit.
constexpr int PATH_SHAPE_ROWS = 6;

enum ShapeBit { UNSEEN_BY_CAMERA = 1 };

// Head of a world's list: how many shapes, lights and shapes that shine it has; the lights, then the others' ids. FAULTY: a pose is not finite, and the world shows nothing.
enum PathHead { NUM_SHAPES, NUM_LAMPS, NUM_EMITTERS, FAULTY, FIRST_LAMP };

// The camera's place with the world's axes.
WARPCAM_DEVICE Camera upright(const Camera& camera)
{
    Camera hub = camera;
    hub.rotation = { { { 1.0f, 0.0f, 0.0f }, { 0.0f, 1.0f, 0.0f }, { 0.0f, 0.0f, 1.0f } } };
    hub.scale_x = hub.scale_y = hub.center_x = hub.center_y = 0.0f;
    return hub;
}

// A ray from a point in a direction of length 1, both along the world's axes and from the view's camera.
struct PathRay {
    Vec3 point, direction;

    WARPCAM_DEVICE Ray local(const ShapeRecord& record) const
    {
        return { transform_rows(record, point, record.origin), transform_rows(record, direction) };
    }
};

// Writes a shape's rows; `bits`: of ShapeBit.
WARPCAM_DEVICE void put_path_shape(Float3Int* rows, const Float3Int& ball, const ShapeRecord& record, int bits)
{
    rows[0] = ball;
    rows[1] = record.axis_x;
    rows[2] = record.axis_y;
    rows[3] = record.axis_z;
    rows[4] = record.origin;
    rows[4].w = bits;
    rows[5] = record.size;
}

template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE Visible path_shape(const Shape& shape, const Camera& camera, const Meshes& meshes,
                                  const HeightFields& fields, Float3Int& ball, ShapeRecord& record)
{
    BoundsAndScale form;
    const Visible found = find_form<Types>(shape, meshes, fields, form, record);
    if (found != SEEN)
        return found;
    const Mat3& r = shape.rotation;
    const Vec3 scale = form.scale, place = shape.position - camera.origin, here = transform_transposed(r, place);
    record.axis_x = { r.at[0][0] * scale.x, r.at[1][0] * scale.x, r.at[2][0] * scale.x, shape.type };
    record.axis_y = { r.at[0][1] * scale.y, r.at[1][1] * scale.y, r.at[2][1] * scale.y, shape.id };
    record.axis_z = { r.at[0][2] * scale.z, r.at[1][2] * scale.z, r.at[2][2] * scale.z, shape.asset };
    record.origin = { -here.x * scale.x, -here.y * scale.y, -here.z * scale.z, 0 };
    const Vec3 middle = place + transform(r, form.extent.center), half = form.extent.half;
    const bool bounded = half.x >= 0.0f;
    const float slack = 1.0e-5f * wp::sqrt(dot(middle, middle));
    ball = make_float3_int(middle, as_int(bounded ? 1.00001f * wp::sqrt(dot(half, half)) + slack : MISS));
    return SEEN;
}

}  // namespace warpcam
