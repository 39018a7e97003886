// Whether something lies between a camera and its keypoints: a ray to each, against all shapes that the camera sees.
//
// The ray is one of a table's, whatever the lens, of a camera that stands where the ray begins. On CUDA a warp has a
// keypoint, and each lane some of the shapes.
#pragma once
#include "traversal/visibility.h"

namespace warpcam {

constexpr int LANES_A_KEYPOINT = THREADS > 1 ? WARP_SIZE : 1;

// COCO's v.
enum KeypointVisibility { KEYPOINT_OUTSIDE, KEYPOINT_HIDDEN, KEYPOINT_VISIBLE };

// The coordinates of a table's ray of a unit direction: see camera/ray_table.h.
WARPCAM_DEVICE CameraRay<RAYS> ray_along(Vec3 direction)
{
    constexpr float MOST = 4.0e6f;  // of a ray straight back
    const float rate = 1.0f / max(1.0f - direction.z, 1.0e-12f), x = rate * direction.x, y = rate * direction.y;
    return abs(x) + abs(y) > 0.0f || direction.z < 0.0f ? CameraRay<RAYS> { x, y } : CameraRay<RAYS> { MOST, 0.0f };
}

// True if the ray meets a mesh between two distances.
template <class Types, class Meshes> WARPCAM_DEVICE bool mesh_blocks(const ShapeRecord& record, const Meshes& meshes,
                                                                     const CameraRay<RAYS>& ray, float near, float far)
{
#if defined(__CUDA_ARCH__)
    const Ray local = ray.local(record);
    NodeRay<by_child<Types>()> boxes;
    boxes.set(local.origin, local.direction, record.size.x);
    const unsigned nodes = as_int(record.size.y);
    int stack[STACK + 4], height = 1, shape = -1, face = -1;
    stack[0] = 0;
    while (height > 0 && shape < 0) {
        const int node = stack[--height];
        if (node < 0) {
            float depth = far;
            test_leaf<Types>(record, meshes, ray, node, near, depth, shape, face);
            continue;
        }
        float enter[4], t_far[4];
        int child[4];
        boxes.test(node_rows<Types>(meshes, nodes, node), near, far, enter, t_far, child);
        for (int k = 0; k < 4; ++k)
            if (enter[k] <= t_far[k] && child[k] != NO_NODE)
                stack[height++] = child[k];
    }
    return shape >= 0;
#else
    Rays rays;
    for (int lane = 0; lane < WARP_SIZE; ++lane) {
        rays.x[lane] = ray.x;
        rays.y[lane] = ray.y;
        rays.depth[lane] = lane == 0 ? far : -1.0f;
        rays.shape[lane] = rays.face[lane] = -1;
    }
    trace_mesh<Types, RAYS, true>(meshes, record, NearOf<CameraRay<RAYS>> { near }, rays);
    return rays.shape[0] >= 0;
#endif
}

// True if the ray meets a shape between two distances.
template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE bool blocks(const ShapeRecord& record, const Meshes& meshes, const HeightFields& fields,
                           const CameraRay<RAYS>& ray, float near, float far)
{
    if (as_float(record.size.w) >= far)
        return false;
    if constexpr (Types::has(MESH))
        if (is_mesh<Types>(record))
            return mesh_blocks<Types>(record, meshes, ray, near, far);
    if constexpr (Types::has(HEIGHT_FIELD))
        if (record.axis_x.w == HEIGHT_FIELD) {
            Hit hit { far, -1, -1 };
            walk_height_field(fields, record, ray, near, hit);
            return hit.shape >= 0;
        }
    const float t = intersect_any<Types::ANALYTIC>(record, ray.local(record));
    return t > near && t < far;
}

// Writes the visibility of one keypoint; `index` counts worlds, then keypoints, then (CUDA) lanes. `keypoints`:
// Keypoints of warpcam/labeling/kernels.py.
template <class Types, bool TABLE, class Shapes, class Materials, class Meshes, class HeightFields, class Views,
          class Keypoints>
WARPCAM_DEVICE void write_keypoint_visibility(const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                              const HeightFields& fields, const Views& views,
                                              const Keypoints& keypoints, int index)
{
    const auto& projection = keypoints.projection;
    const int lane = index % LANES_A_KEYPOINT, one = index / LANES_A_KEYPOINT, count = projection.points.shape[1];
    const int number = one % count, world = one / count;
    if (!wp::index(projection.mask, world))
        return;
    Camera camera = load_camera(wp::index(views, world));
    const Vec3 point = as_vec3(wp::index(projection.points, world, number));
    const Vec3 start = as_vec3(wp::index(projection.starts, world, number)), offset = point - start;
    const auto pixel = wp::index(projection.pixels, world, number);
    const float distance = sqrt(dot(offset, offset)), depth = TABLE ? distance : -point.z;
    const bool inside = pixel[0] >= 0.0f && pixel[0] < float(keypoints.width) && pixel[1] >= 0.0f
                        && pixel[1] < float(keypoints.height);  // not where a pixel is NaN
    int visibility = KEYPOINT_OUTSIDE;
    if (inside && depth >= camera.near && depth <= camera.far && depth > 0.0f) {
        const CameraRay<RAYS> ray = ray_along(1.0f / distance * offset);
        const float near = camera.near * distance / depth, far = distance - keypoints.tolerance;
        camera.origin = camera.origin + transform(camera.rotation, start);
        camera.near = near;
        camera.far = MAX_RAY_T;
        bool hidden = false;
        for (int k = lane; k < keypoints.shapes.shape[0] && !hidden && near < far; k += LANES_A_KEYPOINT) {
            const int id = wp::index(keypoints.shapes, k);
            ShapeRecord record;
            TileRect tiles;
            const Region region { 0, 0, TILE_WIDTH, TILE_HEIGHT };
            if (setup_shape<Types, RAYS, false>(load_shape(shapes, world, id), camera, region, meshes, fields, record,
                                                tiles)
                    == SEEN
                && !transparent(shapes, materials, world, id))
                hidden = blocks<Types>(record, meshes, fields, ray, near, far);
        }
        visibility = warp_any(hidden) ? KEYPOINT_HIDDEN : KEYPOINT_VISIBLE;
    }
    if (lane == 0)
        *wp::address(keypoints.visibility, world, number) = static_cast<unsigned char>(visibility);
}

}  // namespace warpcam
