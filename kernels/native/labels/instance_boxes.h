// Frame and box of each instance: the box of all its shapes, along the axes of its frame.
#pragma once
#include "geometry/shape_state.h"
#include "output/pixel_store.h"

namespace warpcam {

// Half of what a shape's box spans along a direction, in the shape's frame [m]; of analytic shapes the shape itself.
template <class Types> WARPCAM_DEVICE float reach_along(const Shape& shape, Vec3 half, Vec3 along)
{
    float reach = ConvexTraits::support(half, along);
    visit_shape<Types::GEOMETRY>(shape.type, [&](auto traits) { reach = traits.support(half, along); });
    return reach;
}

constexpr float SAME_TURN = 1.0e-4f;  // of a rotation's numbers

// True if a mesh is what its box in MeshBoxes was made of, turned and scaled likewise.
template <class Types, class MeshBoxes>
WARPCAM_DEVICE bool has_mesh_box(const MeshBoxes& boxes, const Shape& shape, const Mat3& turn)
{
    if (!Types::has(MESH) || shape.type != MESH || wp::index(boxes.assets, shape.id) != shape.asset)
        return false;
    const Mat3 known = as_mat3(wp::index(boxes.turns, shape.id));
    const Vec3 scale = as_vec3(wp::index(boxes.scales, shape.id));
    float apart = 0.0f;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j)
            apart = max(apart, abs(known.at[i][j] - turn.at[i][j]));
        if (Types::has(PER_SHAPE_SCALE) && component(scale, i) != component(shape.size, i))
            return false;
    }
    return apart < SAME_TURN;
}

// Pose of an instance's frame in the world.
struct InstanceFrame {
    Vec3 position;
    Mat3 rotation;
};

// The pose of a body or of a shape; else the world's own frame.
template <class Shapes, class Boxes>
WARPCAM_DEVICE InstanceFrame instance_frame(const Shapes& shapes, const Boxes& boxes, int world, int row, int instance)
{
    InstanceFrame frame { { 0.0f, 0.0f, 0.0f },
                          { { { 1.0f, 0.0f, 0.0f }, { 0.0f, 1.0f, 0.0f }, { 0.0f, 0.0f, 1.0f } } } };
    const int body = wp::index(boxes.frame_bodies, row, instance), shape = wp::index(boxes.frame_shapes, row, instance);
    if (shape >= 0) {
        frame.position = as_vec3(wp::index(shapes.positions, world, shape));
        frame.rotation = as_mat3(wp::index(shapes.rotations, world, shape));
    } else if (body >= 0) {
        frame.position = as_vec3(wp::index(boxes.body_positions, world, body));
        frame.rotation = as_mat3(wp::index(boxes.body_rotations, world, body));
    }
    return frame;
}

// Writes frame and box of one instance; `index` counts worlds, then instances. `boxes`: Boxes of
// warpcam/labeling/kernels.py. Centre and half extents are NaN where nothing is drawn, half extents infinite for endless
// planes.
template <class Types, class Shapes, class Materials, class Meshes, class HeightFields, class Boxes>
WARPCAM_DEVICE void write_instance_box(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                       const HeightFields& fields, const Boxes& boxes, int index)
{
    const int instances = boxes.half_extents.shape[1], instance = index % instances, world = index / instances;
    if (!wp::index(boxes.mask, world))
        return;
    const auto& starts = boxes.members.starts;
    const int row = starts.shape[0] == 1 ? 0 : world;
    const int begin = wp::index(starts, row, instance), end = wp::index(starts, row, instance + 1);
    const InstanceFrame frame = instance_frame(shapes, boxes, world, row, instance);
    float low[3] { MISS, MISS, MISS }, high[3] { -MISS, -MISS, -MISS };
    bool any = false, broken = false, endless = false;
    for (int k = begin; k < end; ++k) {
        const int id = wp::index(boxes.members.columns, row, k);
        const Shape shape = load_shape(shapes, world, id);
        BoundsAndScale form;
        ShapeRecord record;
        const Visible found = find_form<Types>(shape, meshes, fields, form, record);
        broken |= found == BROKEN;
        if (found != SEEN || transparent(shapes, materials, world, id))
            continue;
        any = true;
        endless |= form.extent.half.x < 0.0f;
        const Mat3 turn = transposed_times(frame.rotation, shape.rotation);  // from the shape's frame
        const Vec3 origin = transform_transposed(frame.rotation, shape.position - frame.position);
        const Vec3 center = origin + transform(turn, form.extent.center);
        const bool is_known = has_mesh_box<Types>(boxes.meshes, shape, turn);
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3 along { turn.at[axis][0], turn.at[axis][1], turn.at[axis][2] };
            const float reach = reach_along<Types>(shape, form.extent.half, along), middle = component(center, axis);
            float from = middle - reach, to = middle + reach;
            if (is_known) {
                from = component(origin, axis) + wp::index(boxes.meshes.low, id)[axis];
                to = component(origin, axis) + wp::index(boxes.meshes.high, id)[axis];
            }
            low[axis] = min(low[axis], from);
            high[axis] = max(high[axis], to);
        }
    }
    for (int axis = 0; axis < 3; ++axis) {
        float center = 0.5f * (low[axis] + high[axis]), half = 0.5f * (high[axis] - low[axis]);
        if (endless) {
            center = 0.0f;
            half = infinity();
        }
        if (!any || broken)
            center = half = infinity() - infinity();
        (*wp::address(boxes.centers, world, instance))[axis] = center;
        (*wp::address(boxes.half_extents, world, instance))[axis] = half;
    }
    auto& position = *wp::address(boxes.positions, world, instance);
    auto& rotation = *wp::address(boxes.rotations, world, instance);
    for (int i = 0; i < 3; ++i) {
        position[i] = begin < end ? component(frame.position, i) : infinity() - infinity();
        for (int j = 0; j < 3; ++j)
            rotation.data[i][j] = frame.rotation.at[i][j];
    }
}

}  // namespace warpcam
