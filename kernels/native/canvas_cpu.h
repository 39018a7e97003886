// A tile's rays, and what they have found, on a CPU: row by row where the whole tile lies in the image.
#pragma once
#include "canvas.h"

namespace warpcam {

// The rays of a tile, whose first pixel is given, and what they have met before a pass.
template <class Canvas_, class Near>
inline void start_tile(const Canvas_& canvas, int left, int top, bool first_pass, Near& near, Rays& rays)
{
    for (int lane = 0; lane < LANES; ++lane) {
        const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
        const auto ray = canvas.ray(i, j);
        near.set(lane, ray);
        const Hit hit = canvas.start(i, j, first_pass);
        rays.x[lane] = ray.x;
        rays.y[lane] = ray.y;
        rays.depth[lane] = hit.depth;
        rays.shape[lane] = hit.shape;
        rays.face[lane] = hit.face;
    }
}

// Writes what a pass has found in a tile.
template <class Canvas_> inline void put_tile(const Canvas_& canvas, int left, int top, bool first_pass, const Rays& rays)
{
    for (int lane = 0; lane < LANES; ++lane)
        canvas.put_new(left + lane % TILE_WIDTH, top + lane / TILE_WIDTH,
                       { rays.depth[lane], rays.shape[lane], rays.face[lane] }, first_pass);
}

// True if all of the tile was made ready, false if it is to be done ray by ray.
template <int TYPES, int LENS, int OUTPUTS, int CAPACITY, class Target, class Shapes, class Places_>
inline bool start_whole(const Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>& canvas, int left, int top,
                        Rays& rays)
{
    if (LENS == RAYS || (OUTPUTS & FLOW_VALID) || !canvas.inside(left + TILE_WIDTH - 1, top + TILE_HEIGHT - 1))
        return false;
    const Camera camera = canvas.camera;  // a copy, which nothing that is written here may change
    for (int row = 0; row < TILE_HEIGHT; ++row)
        for (int k = 0; k < TILE_WIDTH; ++k) {
            const int lane = row * TILE_WIDTH + k;
            rays.x[lane] = image_x(camera, float(left + k));
            rays.y[lane] = image_y(camera, float(top + row));
            rays.depth[lane] = camera.far;
            rays.shape[lane] = rays.face[lane] = -1;
        }
    return true;
}

template <class Value, class From> inline void put_row(Value* to, const From* from)
{
    Value row[TILE_WIDTH];
    for (int k = 0; k < TILE_WIDTH; ++k)
        row[k] = static_cast<Value>(from[k]);
    __builtin_memcpy(to, row, sizeof row);
}

// Writes depth, shape and face of a tile that lies in the image; the rest is left to be done pixel by pixel.
template <int TYPES, int LENS, int OUTPUTS, int CAPACITY, class Target, class Shapes, class Places_>
inline void put_whole(const Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>& canvas, int left, int top,
                      const Rays& rays)
{
    constexpr int IN_ROWS = DEPTH | FACE | (names_slots(OUTPUTS) ? 0 : SHAPE);
    constexpr int PIXELWISE = SHAPE | DISTANCE | POINTS | BODIES | NORMALS | IDS | FLOWS;
    const float miss = LENS == RAYS ? infinity() : canvas.camera.miss;
    for (int row = 0; row < TILE_HEIGHT; ++row) {
        const int lane = row * TILE_WIDTH;
        const unsigned first = canvas.at(left, top + row);
        float depth[TILE_WIDTH];
        for (int k = 0; k < TILE_WIDTH; ++k)
            depth[k] = rays.shape[lane + k] < 0 ? miss : rays.depth[lane + k];
        if constexpr ((OUTPUTS & DEPTH) != 0)
            put_row(canvas.target.depth.data + first, depth);
        if constexpr ((OUTPUTS & IN_ROWS & SHAPE) != 0)
            put_row(canvas.target.shape.data + first, rays.shape + lane);
        if constexpr ((OUTPUTS & FACE) != 0)
            put_row(canvas.target.face.data + first, rays.face + lane);
    }
    if constexpr ((OUTPUTS & PIXELWISE & ~IN_ROWS) != 0)
        for (int lane = 0; lane < LANES; ++lane)
            canvas.template put<OUTPUTS & ~IN_ROWS>(left + lane % TILE_WIDTH, top + lane / TILE_WIDTH,
                                                    { rays.depth[lane], rays.shape[lane], rays.face[lane] });
}

template <int TYPES, int LENS, int OUTPUTS, int CAPACITY, class Target, class Shapes, class Places_, class Near>
inline void start_tile(const Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>& canvas, int left, int top,
                       bool first_pass, Near& near, Rays& rays)
{
    if (!first_pass || !start_whole(canvas, left, top, rays))
        start_tile<Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>, Near>(canvas, left, top, first_pass, near,
                                                                                          rays);
}

template <int TYPES, int LENS, int OUTPUTS, int CAPACITY, class Target, class Shapes, class Places_>
inline void put_tile(const Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>& canvas, int left, int top,
                     bool first_pass, const Rays& rays)
{
    if (first_pass && canvas.inside(left + TILE_WIDTH - 1, top + TILE_HEIGHT - 1))
        put_whole(canvas, left, top, rays);
    else
        put_tile<Canvas<TYPES, LENS, OUTPUTS, CAPACITY, Target, Shapes, Places_>>(canvas, left, top, first_pass, rays);
}

}  // namespace warpcam
