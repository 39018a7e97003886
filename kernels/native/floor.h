// What pixels show of a plane whose corners are kept.
#pragma once
#include "corners.h"

namespace warpcam {

// The texture's colour where a ray, in the plane's frame, meets it.
template <bool ON_SHEETS>
WARPCAM_FN Vec floor_texture(const FloorView& view, const unsigned* texels, Vec ray, float depth, float x, float y)
{
    const Row place = view.place, right = view.right, down = view.down;
    const float slope = reciprocal(ray.z), along = ray.x * slope, across = ray.y * slope;
    const float right_u = right.x - right.y * along, right_v = right.z - as_float(right.w) * across;
    const float down_u = down.x - down.y * along, down_v = down.z - as_float(down.w) * across;
    const float square = depth * depth;
    const float detail = level_of_detail(square * (right_u * right_u + right_v * right_v),
                                         square * (down_u * down_u + down_v * down_v), view.count);
    const int steps = int(detail);
#if defined(__CUDA_ARCH__)
    if (ON_SHEETS && view.sheet)
        return sample_sheet(view.sheet, view.levels[steps], view.levels[lower_int(steps + 1, view.count - 1)],
                            place.x * x + place.z, place.y * y + as_float(place.w), detail - float(steps));
#endif
    const Row row = view.levels[steps];
    const Level level { as_int(row.z), as_int(row.x), as_int(row.y) };
    return sample_levels(texels, level, row.w, place.x * x + place.z, place.y * y + as_float(place.w),
                         detail - float(steps));
}

// A pixel among the corners that are kept: those of its half of a cell, and their weights.
struct OnCorners {
    int first, second, third;  // numbers of the corners
    float weight1, weight2, weight3;
    bool inside;
};

template <class Grid> WARPCAM_FN OnCorners on_corners(const Grid& grid, Vec local, bool on_plane)
{
    constexpr float BASE = 1.5f * 8388608.0f;  // of whole numbers of either sign
    const float u = grid.u.at(local.x), v = grid.v.at(local.y);
    const float base_u = (u - 0.5f) + BASE, base_v = (v - 0.5f) + BASE;
    const int column = as_int(base_u) - as_int(BASE), row = as_int(base_v) - as_int(BASE);
    const float a = u - (base_u - BASE), b = v - (base_v - BASE);
    const bool high = a + b > 1.0f;
    const int corner = row * grid.columns + column;
    OnCorners on;
    on.inside = on_plane && unsigned(column) < unsigned(grid.columns - 1) && unsigned(row) < unsigned(grid.rows - 1);
    on.first = (on.inside ? corner + (high ? grid.columns + 1 : 0) : 0) * grid.stride;
    on.second = (on.inside ? corner + 1 : 0) * grid.stride;
    on.third = (on.inside ? corner + grid.columns : 0) * grid.stride;
    on.weight2 = high ? 1.0f - b : a;
    on.weight3 = high ? 1.0f - a : b;
    on.weight1 = 1.0f - on.weight2 - on.weight3;
    return on;
}

template <class Grid> WARPCAM_FN float shown_at(const Grid& grid, const OnCorners& on, int value)
{
    const float* values = grid.values + value;
    return on.weight1 * values[on.first] + on.weight2 * values[on.second] + on.weight3 * values[on.third];
}

// FEW numbers that lie together, from a place that is a multiple of FEW.
WARPCAM_FN void load_few(const float* from, float* to)
{
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(to) = *reinterpret_cast<const float4*>(from);
#else
    for (int k = 0; k < FEW; ++k)
        to[k] = from[k];
#endif
}

// What a pixel shows in the lights that `shadow` leaves.
template <class Grid> WARPCAM_FN Vec light_from_corners(const Grid& grid, const OnCorners& on, int shadow)
{
    if (Grid::SHADOWS && grid.few) {
        alignas(16) float first[FEW], second[FEW], third[FEW];
        load_few(grid.values + on.first, first);
        load_few(grid.values + on.second, second);
        load_few(grid.values + on.third, third);
        float sum = on.weight1 * first[0] + on.weight2 * second[0] + on.weight3 * third[0];
#pragma unroll
        for (int n = 1; n < FEW; ++n) {
            const float light = on.weight1 * first[n] + on.weight2 * second[n] + on.weight3 * third[n];
            sum += grid.bits[n - 1] & shadow ? 0.0f : light;
        }
        return { sum, sum, sum };
    }
    if (grid.grey) {
        float sum = shown_at(grid, on, 0);
#pragma unroll 1
        for (int n = 0; Grid::SHADOWS && n < grid.casting; ++n) {
            const float light = shown_at(grid, on, 1 + n);
            sum += grid.bits[n] & shadow ? 0.0f : light;
        }
        return { sum, sum, sum };
    }
    Vec sum { shown_at(grid, on, 0), shown_at(grid, on, 1), shown_at(grid, on, 2) };
#pragma unroll 1
    for (int n = 0; Grid::SHADOWS && n < grid.casting; ++n)
        if (!(grid.bits[n] & shadow)) {
            const int value = 3 + 3 * n;
            sum = sum + Vec { shown_at(grid, on, value), shown_at(grid, on, value + 1), shown_at(grid, on, value + 2) };
        }
    return sum;
}

// Where a pixel's ray meets the plane, and between which corners.
struct FloorPoint {
    Vec ray, local;
    OnCorners on;
};

template <class Grid>
WARPCAM_FN FloorPoint floor_point(const Grid& grid, const Hit& found, bool on_plane, float x, float y)
{
    const FloorView& view = grid.view;
    const Row axis_x = view.axis_x, axis_y = view.axis_y, axis_z = view.axis_z;
    FloorPoint point;
    point.ray = { axis_x.x * x + axis_x.y * y - axis_x.z, axis_y.x * x + axis_y.y * y - axis_y.z,
                  axis_z.x * x + axis_z.y * y - axis_z.z };
    point.local = { as_float(axis_x.w) + found.depth * point.ray.x, as_float(axis_y.w) + found.depth * point.ray.y, 0.0f };
    point.on = on_corners(grid, point.local, on_plane);
    return point;
}

template <bool TEXTURED, bool ON_SHEETS, class Grid, class Textures>
WARPCAM_FN Vec floor_color(const Grid& grid, const Textures& textures, const FloorPoint& point, float depth)
{
    if (TEXTURED && grid.view.count > 0)
        return floor_texture<ON_SHEETS>(grid.view, textures.texels.data, point.ray, depth, point.local.x, point.local.y);
    return { 1.0f, 1.0f, 1.0f };
}

// What a pixel shows of the plane, if it is among the corners that are kept; false if not. `found` is what the trace
// found there, `shadow_at()` the lights that do not reach it. All threads of a warp call it together. APART: where some
// of their pixels show something else, these are left out; otherwise it then returns false for all of them.
template <bool TEXTURED, bool APART, class Grid, class Textures, class Shadow>
WARPCAM_FN bool draw_floor(const Grid& grid, const Textures& textures, const Hit& found, const Shadow& shadow_at,
                           float x, float y, Vec& display)
{
    const bool hit = found.shape >= 0, on_plane = hit && found.shape == grid.shape;
    if (!any_lane(on_plane) || (!APART && any_lane(hit && !on_plane)) || !grid.view.plain)
        return false;
    const FloorPoint point = floor_point(grid, found, on_plane, x, y);
    if (APART ? !any_lane(point.on.inside) : any_lane(hit && !point.on.inside))
        return false;
    const int shadow = Grid::SHADOWS ? shadow_at() : 0;
    const Vec texture = floor_color<TEXTURED, APART>(grid, textures, point, found.depth);
    display = times(light_from_corners(grid, point.on, shadow), texture);
    return !APART || point.on.inside;
}

// The same of two tiles side by side, so that one is worked on while the other waits for its texels; false where not
// all of their pixels are among the corners that are kept.
template <bool TEXTURED, class Grid, class Textures>
WARPCAM_FN bool draw_floors(const Grid& grid, const Textures& textures, const Hit* found, const int* shadow,
                            const float* x, const float* y, Vec* display)
{
    const bool on_plane = found[0].shape == grid.shape && found[1].shape == grid.shape;
    if (any_lane(!on_plane) || !grid.view.plain || grid.shape < 0)
        return false;
    const FloorPoint points[2] = { floor_point(grid, found[0], true, x[0], y[0]),
                                   floor_point(grid, found[1], true, x[1], y[1]) };
    if (any_lane(!points[0].on.inside || !points[1].on.inside))
        return false;
    const Vec colors[2] = { floor_color<TEXTURED, true>(grid, textures, points[0], found[0].depth),
                            floor_color<TEXTURED, true>(grid, textures, points[1], found[1].depth) };
    for (int k = 0; k < 2; ++k)
        display[k] = times(light_from_corners(grid, points[k].on, shadow[k]), colors[k]);
    return true;
}

}  // namespace warpcam
