// The images that need only what the trace found: distance, points, bodies.
#pragma once
#include "look.h"
#include "pixels.h"

namespace warpcam {

// What the trace found at a pixel.
struct Found {
    int shape, face;
    float depth;
};

WARPCAM_FN Vec turned(const Matrix& m, Vec v)
{
    return { m.at[0][0] * v.x + m.at[0][1] * v.y + m.at[0][2] * v.z,
             m.at[1][0] * v.x + m.at[1][1] * v.y + m.at[1][2] * v.z,
             m.at[2][0] * v.x + m.at[2][1] * v.y + m.at[2][2] * v.z };
}

template <int LENS> WARPCAM_FN float distance_of(const Found& found, float x, float y)
{
    const float length = LENS == PINHOLE ? root(x * x + y * y + 1.0f) : 1.0f;
    return found.shape >= 0 ? found.depth * length : infinity();
}

template <int LENS> WARPCAM_FN Vec point_of(const Found& found, const Camera& camera, float x, float y)
{
    if (found.shape < 0)
        return { infinity(), infinity(), infinity() };
    const float near = LENS == PINHOLE ? found.depth : 1.0f;
    return camera.origin + turned(camera.rotation, { near * x, near * y, -found.depth });
}

template <class Shapes> WARPCAM_FN int body_of(const Found& found, const Shapes& shapes)
{
    return found.shape >= 0 ? wp::index(shapes.bodies, found.shape) : -1;
}

template <int LENS, int IMAGES, int FACTS, class Images, class Shapes>
WARPCAM_FN void resolve_hit(const Images& images, const Shapes& shapes, const Camera& camera, const Pixel& pixel,
                            float x, float y, const Found& found)
{
    if (IMAGES & DISTANCE)
        put_one(images.distance, pixel, distance_of<LENS>(found, x, y));
    if (IMAGES & BODIES)
        put_one(images.bodies, pixel, body_of(found, shapes));
    if (IMAGES & POINTS)
        put_vec<(FACTS & QUADS) != 0>(images.points, pixel, point_of<LENS>(found, camera, x, y));
}

#if defined(__CUDA_ARCH__)

// Where there is nothing else to do, a thread does four neighbours at a time: what counts then is memory. The image's
// width is a multiple of four pixels.
template <int LENS, int WIDTH, int HEIGHT, int IMAGES, class Frame, class Images, class Shapes>
WARPCAM_FN void resolve_quads(const Frame& frame, const Images& images, const Shapes& shapes, const Camera& camera,
                              unsigned first, int left, int top, unsigned thread)
{
#pragma unroll 2
    for (unsigned quad = thread; quad < WIDTH / 4 * HEIGHT; quad += THREADS) {
        const int column = left + 4 * (quad % (WIDTH / 4)), row = top + quad / (WIDTH / 4);
        if (column >= frame.width || row >= frame.height)
            continue;
        const size_t at = (first + row * frame.width + column) / 4;
        const int4 ids = reinterpret_cast<const int4*>(frame.shape.data)[at];
        float4 depths = { 0.0f, 0.0f, 0.0f, 0.0f };
        if (IMAGES & (DISTANCE | POINTS))
            depths = reinterpret_cast<const float4*>(frame.depth.data)[at];
        const Found found[4] = { { ids.x, 0, depths.x }, { ids.y, 0, depths.y }, { ids.z, 0, depths.z },
                                 { ids.w, 0, depths.w } };
        float x[4];
        for (int k = 0; k < 4; ++k)
            x[k] = image_x(camera, float(column + k));
        const float y = image_y(camera, float(row));
        if (IMAGES & DISTANCE)
            reinterpret_cast<float4*>(images.distance.data)[at]
                = { distance_of<LENS>(found[0], x[0], y), distance_of<LENS>(found[1], x[1], y),
                    distance_of<LENS>(found[2], x[2], y), distance_of<LENS>(found[3], x[3], y) };
        if (IMAGES & BODIES)
            reinterpret_cast<int4*>(images.bodies.data)[at] = { body_of(found[0], shapes), body_of(found[1], shapes),
                                                                body_of(found[2], shapes), body_of(found[3], shapes) };
        if (IMAGES & POINTS) {
            Vec p[4];
            for (int k = 0; k < 4; ++k)
                p[k] = point_of<LENS>(found[k], camera, x[k], y);
            float4* points = reinterpret_cast<float4*>(images.points.data) + 3 * at;
            points[0] = { p[0].x, p[0].y, p[0].z, p[1].x };
            points[1] = { p[1].y, p[1].z, p[2].x, p[2].y };
            points[2] = { p[2].z, p[3].x, p[3].y, p[3].z };
        }
    }
}

#endif

}  // namespace warpcam
