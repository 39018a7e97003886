// The surface that a pixel shows, for passes that derive an output from it.
#pragma once
#include "output/hit_attributes.h"
#include "shading/appearance.h"

namespace warpcam {

// Surface of the trace's hit at a pixel. Where nothing is hit `shape` is -1, and the rest is undefined.
struct SeenSurface {
    int shape, face;
    ShapeFromCamera pose;
    SurfaceInteraction surface;

    WARPCAM_DEVICE bool is(int type) const { return shape >= 0 && pose.type() == type; }
};

// Calls `write` with a pixel's place in images of one channel and the surface that it shows; `index` counts worlds,
// then pixels.
template <class Types, int LENS, class Frame, class Shapes, class Meshes, class HeightFields, class Write>
WARPCAM_DEVICE void derive_pixel(const Frame& frame, const Shapes& shapes, const Meshes& meshes,
                                 const HeightFields& fields, int index, const Write& write)
{
    const int pixels = frame.width * frame.height, world = index / pixels, place = index - world * pixels;
    if (!wp::index(frame.mask, world))
        return;
    SeenSurface seen {};
    seen.shape = frame.shape.data[index];
    if (seen.shape >= 0) {
        const Camera camera = load_camera(wp::index(frame.views, world));
        const int row = place / frame.width, column = place - row * frame.width;
        const CameraRay<LENS> camera_ray = view_ray<LENS>(camera, column, row);
        seen.pose = load_pose<Types>(shapes, meshes, camera, world, seen.shape);
        if constexpr (Types::has_any(MESH, HEIGHT_FIELD))
            seen.face = stored_face<Types>(frame.face.data[index]);
        Vec3 point, ray;
        const Vec3 local = locate_hit<LENS>(seen.pose, camera_ray.x, camera_ray.y, frame.depth.data[index], point, ray);
        seen.surface = surface_at<Types>(seen.pose, meshes, fields, seen.face, local, ray);
    }
    write(index, seen);
}

}  // namespace warpcam
