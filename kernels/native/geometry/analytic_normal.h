// The normal of an analytic shape at a hit, from the record that the ray met.
#pragma once
#include "camera/shape_setup.h"
#include "core/vec3.h"

namespace warpcam {

// In a box's own frame, where it is the cube of half width 1. On each axis a ray can enter by one side only; the hit is
// on the nearest of the three.
WARPCAM_DEVICE Vec3 box_gradient(Vec3 at, Vec3 ray)
{
    const float x = ray.x < 0.0f ? -at.x : at.x;  // -1 on the side of entry
    const float y = ray.y < 0.0f ? -at.y : at.y;
    const float z = ray.z < 0.0f ? -at.z : at.z;
    const int axis = y < x ? (z < y ? 2 : 1) : (z < x ? 2 : 0);
    return axis_vector(axis, -sign(component(ray, axis)));
}

// In a cylinder's own frame, where radius and half length are 1: of the side, or of the cap by which the ray can enter,
// whichever is nearer to the hit.
WARPCAM_DEVICE Vec3 cylinder_gradient(Vec3 at, Vec3 ray)
{
    const float axial = at.x * at.x + at.y * at.y;
    const bool cap = abs(1.0f + sign(ray.z) * at.z) < 0.5f * abs(1.0f - axial);
    return { cap ? 0.0f : at.x, cap ? 0.0f : at.y, cap ? -sign(ray.z) : 0.0f };
}

// In a cone's own frame, where its tip is at z = 1 and its base of radius 1 at z = -1.
WARPCAM_DEVICE Vec3 cone_gradient(Vec3 at, Vec3 ray)
{
    const float w = 0.5f * (1.0f - at.z), gap = w * w - at.x * at.x - at.y * at.y;
    if (ray.z > 0.0f && abs(1.0f + at.z) < 0.5f * abs(gap))
        return { 0.0f, 0.0f, -1.0f };
    return { at.x, at.y, 0.5f * w };
}

// In a barrel's own frame, where the radius of its ends is 1: see enter_barrel().
WARPCAM_DEVICE Vec3 barrel_gradient(Vec3 at, Vec3 ray, float half, float arc)
{
    const float axial = sqrt(max(at.x * at.x + at.y * at.y, MIN_NORMAL)), past = axial - 1.0f;
    const float end = sqrt(max(arc * arc - half * half, 0.0f)), rate = (past + end) / axial;
    const float gap = (past * (past + 2.0f * end) + at.z * at.z - half * half) / (2.0f * arc);
    if (abs(half + sign(ray.z) * at.z) < abs(gap))
        return { 0.0f, 0.0f, -sign(ray.z) };
    return { rate * at.x, rate * at.y, at.z };
}

// Outwards, in the camera's frame, of any length. The rows take a place to the shape's own frame, so their transpose
// takes back the gradient of a function of that place.
template <class Types, int LENS>
WARPCAM_DEVICE Vec3 gradient(const ShapeRecord& record, const CameraRay<LENS>& seen, float depth)
{
    const int type = record.axis_x.w;
    const Float3Int ax = record.axis_x, ay = record.axis_y, az = record.axis_z;
    if (Types::has(PLANE) && type == PLANE)
        return as_vec3(az);
    const Ray ray = seen.local(record);
    Vec3 g = ray.origin + depth * ray.direction;
    // from the nearest point of its axis; of the other shapes but barrels size.x is 0
    if (Types::has(CAPSULE) && (!Types::has(BARREL) || type != BARREL))
        g.z -= clamp(g.z, -record.size.x, record.size.x);
    if (Types::has(CYLINDER) && type == CYLINDER)
        g = cylinder_gradient(g, ray.direction);
    if (Types::has(CONE) && type == CONE)
        g = cone_gradient(g, ray.direction);
    if (Types::has(BARREL) && type == BARREL)
        g = barrel_gradient(g, ray.direction, record.size.x, record.size.y);
    if (Types::has(BOX) && type == BOX)
        g = box_gradient(g, ray.direction);
    return { ax.x * g.x + ay.x * g.y + az.x * g.z, ax.y * g.x + ay.y * g.y + az.y * g.z,
             ax.z * g.x + ay.z * g.y + az.z * g.z };
}

}  // namespace warpcam
