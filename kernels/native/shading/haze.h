// The haze over the horizon of an endless plane, and the skybox that ends it.
//
// Both stand around the eye in MuJoCo's renderer: the skybox is an upright cylinder, as high above and below the eye as
// it is wide; the haze a cone between the plane and the eye's height, widest at that height, where it meets the skybox.
// The haze is densest somewhere between.
#pragma once
#include "shading/appearance.h"
#include "geometry/shape_state.h"

namespace warpcam {

// The haze along a ray of a view.
struct HazeSample {
    float depth;  // where it stands: planar depth [m]
    float density;  // 0 where there is none
};

// Distance at which a ray of direction (x, y, z), in the world's axes, leaves the skybox.
WARPCAM_DEVICE float skybox_depth(Vec3 ray, float radius)
{
    const float wide = rsqrt(max(ray.x * ray.x + ray.y * ray.y, MIN_NORMAL));
    return radius * min(wide, rcp(max(abs(ray.z), MIN_NORMAL)));
}

// `width` is how far the cone narrows towards the plane, as a part of its radius, and `above` how high the eye stands
// over the plane, in radii; `along` and `down` are the ray's rates along the plane and towards it.
WARPCAM_DEVICE HazeSample haze_along(float along, float down, float above, float width, float radius)
{
    if (!(above > 0.0f && down > 0.0f))
        return { 0.0f, 0.0f };
    const float t = rcp(along + width * down / above);
    const float height = 1.0f - t * down / above;  // 0 at the plane, 1 at the eye's height
    // densest where the cone meets the line that falls from its rim at half a right angle
    const float middle = width / (1.0f + width);
    if (height < 0.0f)
        return { 0.0f, 0.0f };
    return { t * radius, height < middle ? height / middle : (1.0f - height) / (1.0f - middle) };
}

// `ray` begins at the eye, is along the world's axes and reaches a depth of 1.
template <class Scene_> WARPCAM_DEVICE HazeSample haze_of(const Scene_& scene, Vec3 eye, int world, Vec3 ray)
{
    const auto& haze = scene.frame.haze;
    const auto r = wp::index(scene.shapes.rotations, world, haze.plane);
    const Vec3 away = eye - as_vec3(wp::index(scene.shapes.positions, world, haze.plane));
    const Vec3 normal { r.data[0][2], r.data[1][2], r.data[2][2] };
    const auto size = per_world(scene.shapes.sizes, world, haze.plane);
    if (size[0] > 0.0f || size[1] > 0.0f || opacity(scene.shapes, scene.materials, world, haze.plane) == 0.0f)
        return { 0.0f, 0.0f };
    const float up = dot(normal, ray);
    return haze_along(sqrt(max(dot(ray, ray) - up * up, 0.0f)), -up, dot(normal, away) / haze.radius, haze.width,
                      haze.radius);
}

}  // namespace warpcam
