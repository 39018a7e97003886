// A tile's rays, and what they have found, on a CPU: row by row where the whole tile lies in the image.
#pragma once
#include "traversal/trace_target.h"
#include "core/simd8.h"

namespace warpcam {

// The rays of a tile, whose first pixel is given, and what they have met before a pass.
template <class TraceTarget_, class Near>
inline void start_tile(const TraceTarget_& trace_target, int left, int top, bool first_pass, Near& near, Rays& rays)
{
    for (int lane = 0; lane < WARP_SIZE; ++lane) {
        const int i = left + lane % TILE_WIDTH, j = top + lane / TILE_WIDTH;
        const auto ray = trace_target.ray(i, j);
        near.set(lane, ray);
        const Hit hit = trace_target.start(i, j, first_pass);
        rays.x[lane] = ray.x;
        rays.y[lane] = ray.y;
        rays.depth[lane] = hit.depth;
        rays.shape[lane] = hit.shape;
        rays.face[lane] = hit.face;
    }
}

// Writes what a pass has found in a tile.
template <class TraceTarget_>
inline void put_tile(const TraceTarget_& trace_target, int left, int top, bool first_pass, const Rays& rays)
{
    for (int lane = 0; lane < WARP_SIZE; ++lane)
        trace_target.write_hit(left + lane % TILE_WIDTH, top + lane / TILE_WIDTH,
                               { rays.depth[lane], rays.shape[lane], rays.face[lane] }, first_pass);
}

// True if all of the tile was made ready, false if it is to be done ray by ray.
template <class Types, int LENS, int OUTPUTS, class List, int TILES_PER_WARP, class Target, class Shapes, class Places_>
inline bool start_whole(
    const TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>& trace_target, int left,
    int top, Rays& rays)
{
    if (has_table(LENS) || (OUTPUTS & FLOW_VALID) || !trace_target.inside(left + TILE_WIDTH - 1, top + TILE_HEIGHT - 1))
        return false;
    const Camera camera = trace_target.camera;  // a copy, which nothing that is written here may change
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

// Writes a tile that lies in the image: depth, shape and face by rows, the rest pixel by pixel.
template <class Types, int LENS, int OUTPUTS, class List, int TILES_PER_WARP, class Target, class Shapes, class Places_>
inline void put_whole(
    const TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>& trace_target, int left,
    int top, const Rays& rays)
{
    constexpr int IN_ROWS = OUTPUTS & (DEPTH | FACE | (names_slots(OUTPUTS) ? 0 : SHAPE));
    const Target& target = trace_target.target;
    const bool depths = is_written<IN_ROWS & DEPTH>(target), shapes = is_written<IN_ROWS & SHAPE>(target),
               faces = is_written<IN_ROWS & FACE>(target);
    const float miss = has_table(LENS) ? infinity() : trace_target.camera.miss;
    static_assert(TILE_WIDTH == SIMD_WIDTH);
    for (int row = 0; row < TILE_HEIGHT; ++row) {
        const int lane = row * TILE_WIDTH;
        const unsigned first = trace_target.at(left, top + row);
        const Int8 shape = load8(rays.shape + lane);
        if (depths) {
            Float8 depth;
            __builtin_memcpy(&depth, rays.depth + lane, sizeof depth);
            depth = shape < 0 ? (Float8)miss : depth;
            __builtin_memcpy(target.depth.data + first, &depth, sizeof depth);
        }
        if (shapes)
            store8(target.shape.data + first, shape);
        if (faces)
            store8(target.face.data + first, load8(rays.face + lane));
    }
    put_written<OUTPUTS & ~IN_ROWS>(target, [&](auto images) {
        for (int lane = 0; lane < WARP_SIZE; ++lane)
            trace_target.template put<decltype(images)::SET>(left + lane % TILE_WIDTH, top + lane / TILE_WIDTH,
                                                             { rays.depth[lane], rays.shape[lane], rays.face[lane] });
    });
}

template <class Types, int LENS, int OUTPUTS, class List, int TILES_PER_WARP, class Target, class Shapes, class Places_,
          class Near>
inline void start_tile(
    const TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>& trace_target, int left,
    int top, bool first_pass, Near& near, Rays& rays)
{
    if (!first_pass || !start_whole(trace_target, left, top, rays))
        start_tile<TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>, Near>(
            trace_target, left, top, first_pass, near, rays);
}

template <class Types, int LENS, int OUTPUTS, class List, int TILES_PER_WARP, class Target, class Shapes, class Places_>
inline void put_tile(
    const TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>& trace_target, int left,
    int top, bool first_pass, const Rays& rays)
{
    if (first_pass && trace_target.inside(left + TILE_WIDTH - 1, top + TILE_HEIGHT - 1))
        put_whole(trace_target, left, top, rays);
    else
        put_tile<TraceTarget<Types, LENS, OUTPUTS, List, TILES_PER_WARP, Target, Shapes, Places_>>(
            trace_target, left, top, first_pass, rays);
}

}  // namespace warpcam
