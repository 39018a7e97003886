// The shapes of a world as rays in any direction meet them: a list for each world, made once a frame.
//
// All is relative to the view's camera, along the world's axes, so that a world may be far from its origin.
#pragma once
#include "geometry/shape_state.h"
#include "lights/active_lights.h"
#include "path/frame_axes.h"

namespace warpcam {

// Rows of one shape: middle and radius of a ball that holds it, of MISS without bounds; the five of its ShapeRecord, whose
// rows take world directions to the shape's; `origin`, the camera's place there, has in its w ShapeBit.
constexpr int PATH_SHAPE_ROWS = 6;

enum ShapeBit { UNSEEN_BY_CAMERA = 1 };

// Head of a world's list: how many shapes and lights it has. FAULTY: a pose is not finite, and the world shows nothing.
enum PathHead { NUM_SHAPES, NUM_LAMPS, FAULTY, FIRST_LAMP };

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

// Counts one world's paths: a `fresh` frame begins with `samples`, another has `more` added to what it has.
template <class Frame_, class Count>
WARPCAM_DEVICE void count_paths(const Frame_& frame, int samples, const Count& more, int fresh, int world)
{
    if (!wp::index(frame.mask, world))
        return;
    wp::index(frame.begun, world) = fresh ? 0 : wp::index(frame.begun, world) + wp::index(frame.wanted, world);
    wp::index(frame.wanted, world) = fresh ? samples : wp::index(more, 0);
}

// Lists one world's shapes and lights.
template <class Types, class Frame_, class Shapes, class Casters, class Materials, class Lights, class Meshes,
          class HeightFields, class Views>
WARPCAM_DEVICE void list_path_shapes(const Frame_& frame, const Shapes& shapes, const Casters& casters,
                                     const Materials& materials, const Lights& lights, const Meshes& meshes,
                                     const HeightFields& fields, const Views& views, int world)
{
    if (!wp::index(frame.mask, world))
        return;
    const Camera camera = load_camera(wp::index(views, world));
    int* const head = wp::address(frame.heads, world, 0);
    Float3Int* const rows = reinterpret_cast<Float3Int*>(wp::address(frame.rows, world, 0));
    int count = 0, faults = 0;
    const float seen_from = camera.origin.x + camera.origin.y + camera.origin.z;
    head[FAULTY] = !(abs(seen_from) < MISS);
    const auto add = [&](int id, int bits) {
        Float3Int ball;
        ShapeRecord record;
        const Visible found = path_shape<Types>(load_shape(shapes, world, id), camera, meshes, fields, ball, record);
        if (found == BROKEN)
            head[FAULTY] = 1;
        if (found == BROKEN || (found == FORMLESS && !transparent(shapes, materials, world, id)))
            faults = 1;
        if (found != SEEN || transparent(shapes, materials, world, id))
            return;
        record.origin.w = bits;
        Float3Int* const to = rows + PATH_SHAPE_ROWS * count++;
        to[0] = ball;
        to[1] = record.axis_x;
        to[2] = record.axis_y;
        to[3] = record.axis_z;
        to[4] = record.origin;
        to[5] = record.size;
    };
    for (int place = 0; place < shapes.drawn.shape[0]; ++place)
        add(wp::index(shapes.drawn, place), 0);
    for (int place = 0; place < casters.drawn.shape[0]; ++place) {
        const int id = wp::index(casters.drawn, place);
        if (wp::index(shapes.places, id) < 0)
            add(id, UNSEEN_BY_CAMERA);
    }
    head[NUM_SHAPES] = count;
    int lamps = 0;
    for (int light = 0; light < lights.types.shape[1]; ++light) {
        const int type = per_world(lights.types, world, light);
        if (per_world(lights.active, world, light) && (type == LIGHT_SPOT || type == LIGHT_DIRECTIONAL))
            head[FIRST_LAMP + lamps++] = light;
    }
    head[NUM_LAMPS] = lamps;
    if (faults)
        wp::index(frame.faults, world) = 1;
}

}  // namespace warpcam
