// Outputs that follow from a hit alone, without its surface: distance, point, body, labels.
#pragma once
#include "accel/bvh4.h"
#include "geometry/surface_interaction.h"
#include "output/pixel_store.h"

namespace warpcam {

// A face as it is stored. Of 16 bits the last number is none: -1, what is no face of a height field.
template <class Types, class Face> WARPCAM_DEVICE int stored_face(Face face)
{
    return (Types::has(HEIGHT_FIELD)) && sizeof(Face) == 2 && face == static_cast<Face>(-1) ? -1 : int(face);
}

// Up to where a pass looks for what is seen, after one that has found something so far away: of shapes at one place the
// later is seen, as within a pass.
WARPCAM_DEVICE float next_float(float depth) { return as_float(as_int(depth) + 1); }

// With a table, whose depth is the distance, the planar depth: the other of the two.
template <int LENS> WARPCAM_DEVICE float distance_of(const Hit& hit, const CameraRay<LENS>& seen)
{
    if constexpr (LENS == RAYS)
        return hit.shape >= 0 ? -hit.depth * seen.direction().z : infinity();
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay offset_ray = seen.offset_ray();
        return hit.shape >= 0 ? -(offset_ray.start.z + hit.depth * offset_ray.direction.z) : infinity();
    }
    if (LENS != PINHOLE)
        return hit.shape >= 0 ? hit.depth : infinity();
#if defined(                                                                                                           \
    __CUDA_ARCH__)  // the compiler would choose, at each place where a pixel is written, which square is rounded
    const float across = fma(seen.x, seen.x, mul_rn(seen.y, seen.y));
#else
    const float across = seen.x * seen.x + seen.y * seen.y;
#endif
    return hit.shape >= 0 ? hit.depth * sqrt(across + 1.0f) : infinity();
}

template <int LENS> WARPCAM_DEVICE Vec3 point_of(const Hit& hit, const Camera& camera, const CameraRay<LENS>& seen)
{
    if (hit.shape < 0)
        return { infinity(), infinity(), infinity() };
    if constexpr (LENS == RAYS)
        return camera.origin + transform(camera.rotation, hit.depth * seen.direction());
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay offset_ray = seen.offset_ray();
        return camera.origin + transform(camera.rotation, offset_ray.start + hit.depth * offset_ray.direction);
    }
    const float near = LENS == PINHOLE ? hit.depth : 1.0f;
    return camera.origin + transform(camera.rotation, { near * seen.x, near * seen.y, -hit.depth });
}

// A hit in the camera's frame.
template <int LENS> WARPCAM_DEVICE Vec3 place_along(float x, float y, float depth)
{
    if constexpr (LENS == RAYS)
        return depth * CameraRay<LENS> { x, y }.direction();
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS) {
        const OffsetRay offset_ray = CameraRay<LENS> { x, y }.offset_ray();
        return offset_ray.start + depth * offset_ray.direction;
    }
    return LENS == PINHOLE ? Vec3 { depth * x, depth * y, -depth } : Vec3 { x, y, -depth };
}

// A hit in the shape's frame; `place` is the same in the camera's frame, `ray` the ray's direction in the shape's, of
// any length.
template <int LENS>
WARPCAM_DEVICE Vec3 locate_hit(const ShapeFromCamera& pose, float x, float y, float depth, Vec3& place, Vec3& ray)
{
    place = place_along<LENS>(x, y, depth);
    ray = LENS == PINHOLE ? pose.local({ x, y, -1.0f }) : pose.local({ 0.0f, 0.0f, -1.0f });
    if constexpr (LENS == RAYS)
        ray = pose.local(CameraRay<LENS> { x, y }.direction());
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        ray = pose.local(CameraRay<LENS> { x, y }.offset_ray().direction);
    return pose.eye() + (has_centre(LENS) ? depth * ray : pose.local(place));
}

// With BY_WORLD ids differ from world to world: types.py, Shapes.
template <bool BY_WORLD, class Shapes> WARPCAM_DEVICE int body_of(const Shapes& shapes, int world, int shape)
{
    if (BY_WORLD)
        return shape >= 0 ? wp::index(shapes.body_ids, world, shape) : -1;
    return shape >= 0 ? wp::index(shapes.bodies, shape) : -1;
}

template <class Shapes> WARPCAM_DEVICE int id_of(const Shapes& shapes, int world, int shape)
{
    return shape >= 0 ? wp::index(shapes.ids, world, shape) : -1;
}

// Label of a shape from a table, (world or 1, shape); `none` where nothing is hit.
template <class Table> WARPCAM_DEVICE int label_of(const Table& table, int world, int shape, int none)
{
    return shape >= 0 ? wp::index(table, table.shape[0] > 1 ? world : 0, shape) : none;
}

}  // namespace warpcam
