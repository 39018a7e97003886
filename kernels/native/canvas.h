// Where a block draws: one region of one view, and what the trace writes there.
#pragma once
#include "hits.h"

namespace warpcam {

// What the trace writes. QUADS: the image's width is a multiple of four pixels. IDS: the ids that shapes have in each
// world; BY_WORLD: bodies have such ids too.
enum Output { DEPTH = 1, SHAPE = 2, FACE = 4, DISTANCE = 8, POINTS = 16, BODIES = 32, QUADS = 64 };
enum { IDS = 1 << 16, BY_WORLD = 1 << 17 };

// Pixel (i, j) is column i and row j of the image.
template <int LENS, int OUTPUTS, class Target, class Shapes> struct Canvas {
    const Target& target;
    const Shapes& shapes;
    Camera camera;
    Region region;
    int world;

    WARPCAM_FN bool inside(int i, int j) const { return i < target.width && j < target.height; }

    WARPCAM_FN unsigned at(int i, int j) const { return (unsigned(world) * target.height + j) * target.width + i; }

    WARPCAM_FN ViewRay<LENS> ray(int i, int j) const
    {
        return { image_x(camera, float(i)), image_y(camera, float(j)) };
    }

    // What a pixel shows before a pass. No ray outside of the image meets anything.
    WARPCAM_FN Hit start(int i, int j, bool first_pass) const
    {
        Hit hit { inside(i, j) ? camera.far : -1.0f, -1, -1 };
        if (!first_pass && inside(i, j)) {
            hit.shape = target.shape.data[at(i, j)];
            if (OUTPUTS & FACE)
                hit.face = target.face.data[at(i, j)];
            if (hit.shape >= 0)
                hit.depth = target.depth.data[at(i, j)];
        }
        return hit;
    }

    // Writes a pixel of the image, WHAT of it.
    template <int WHAT> WARPCAM_FN void put(int i, int j, const Hit& hit) const
    {
        const unsigned pixel = at(i, j);
        const ViewRay<LENS> seen = ray(i, j);
        if (WHAT & DEPTH)
            target.depth.data[pixel] = hit.shape < 0 ? camera.miss : hit.depth;
        if (WHAT & SHAPE)
            target.shape.data[pixel] = hit.shape;
        if (WHAT & FACE)
            target.face.data[pixel] = hit.face;
        if (WHAT & DISTANCE)
            target.distance.data[pixel] = distance_of<LENS>(hit, seen.x, seen.y);
        if (WHAT & BODIES)
            target.bodies.data[pixel] = body_of<(OUTPUTS & BY_WORLD) != 0>(hit, shapes, world);
        if (WHAT & IDS)
            target.ids.data[pixel] = id_of(hit, shapes, world);
        if (WHAT & POINTS)
            put_three(target.points.data, pixel, point_of<LENS>(hit, camera, seen.x, seen.y));
    }

#if defined(__CUDA_ARCH__)
    // Writes the pixels of a warp's tile, each lane's; `row_of_lanes` is room for 3 * LANES numbers where POINTS are
    // written in QUADS.
    WARPCAM_FN void put_tile(int i, int j, const Hit& hit, float* row_of_lanes) const
    {
        constexpr bool TOGETHER = (OUTPUTS & POINTS) && (OUTPUTS & QUADS);
        if (inside(i, j))
            put<TOGETHER ? OUTPUTS & ~POINTS : OUTPUTS>(i, j, hit);
        if (TOGETHER) {
            const int lane = threadIdx.x % LANES, left = i - lane % TILE_WIDTH, top = j - lane / TILE_WIDTH;
            Pixel pixel { i, j, at(i, j), inside(i, j), row_of_lanes, lane };
            pixel.width = target.width - left;
            pixel.height = target.height - top;
            pixel.stride = target.width;
            pixel.corner = at(left, top);
            const ViewRay<LENS> seen = ray(i, j);
            put_vec<true>(target.points, pixel, point_of<LENS>(hit, camera, seen.x, seen.y));
        }
    }
#endif
};

}  // namespace warpcam
