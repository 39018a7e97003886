// Colours of the pixels of a plane whose lit vertices are cached.
#pragma once
#include "shading/plane_vertex_lighting.h"

namespace warpcam {

// The texture's colour where a ray, in the plane's frame, meets it.
template <bool USE_ATLAS> WARPCAM_DEVICE Vec3 floor_texture(const FloorView& view, const unsigned* texels, Vec3 ray,
                                                            float depth, float x, float y)
{
    const Float3Int place = view.place, right = view.right, down = view.down;
    const float slope = rcp(ray.z), along = ray.x * slope, across = ray.y * slope;
    const float right_u = right.x - right.y * along, right_v = right.z - as_float(right.w) * across;
    const float down_u = down.x - down.y * along, down_v = down.z - as_float(down.w) * across;
    const float square = depth * depth;
    const float detail = level_of_detail(square * (right_u * right_u + right_v * right_v),
                                         square * (down_u * down_u + down_v * down_v), view.count);
    const int steps = int(detail);
#if defined(__CUDA_ARCH__)
    if (USE_ATLAS && view.atlas)
        return sample_atlas(view.atlas, view.levels[steps], view.levels[min(steps + 1, view.count - 1)],
                            place.x * x + place.z, place.y * y + as_float(place.w), detail - float(steps));
#endif
    const Float3Int row = view.levels[steps];
    const Level level { as_int(row.z), as_int(row.x), as_int(row.y) };
    return sample_levels(texels, level, row.w, place.x * x + place.z, place.y * y + as_float(place.w),
                         detail - float(steps));
}

// A pixel among the corners that are kept: those of its half of a cell, and their weights.
struct GridInterpolation {
    int first, second, third;  // numbers of the corners
    float weight1, weight2, weight3;
    bool inside;
};

template <class Grid> WARPCAM_DEVICE GridInterpolation on_corners(const Grid& grid, Vec3 local, bool on_plane)
{
    constexpr float BASE = 1.5f * 8388608.0f;  // of whole numbers of either sign
    const float u = grid.u.at(local.x), v = grid.v.at(local.y);
    const float base_u = (u - 0.5f) + BASE, base_v = (v - 0.5f) + BASE;
    const int column = as_int(base_u) - as_int(BASE), row = as_int(base_v) - as_int(BASE);
    const float a = u - (base_u - BASE), b = v - (base_v - BASE);
    const bool high = a + b > 1.0f;
    const int corner = row * grid.columns + column;
    GridInterpolation on;
    on.inside = on_plane && unsigned(column) < unsigned(grid.columns - 1) && unsigned(row) < unsigned(grid.rows - 1);
    on.first = (on.inside ? corner + (high ? grid.columns + 1 : 0) : 0) * grid.stride;
    on.second = (on.inside ? corner + 1 : 0) * grid.stride;
    on.third = (on.inside ? corner + grid.columns : 0) * grid.stride;
    on.weight2 = high ? 1.0f - b : a;
    on.weight3 = high ? 1.0f - a : b;
    on.weight1 = 1.0f - on.weight2 - on.weight3;
    return on;
}

template <class Grid> WARPCAM_DEVICE float shown_at(const Grid& grid, const GridInterpolation& on, int value)
{
    const float* values = grid.values + value;
    return on.weight1 * values[on.first] + on.weight2 * values[on.second] + on.weight3 * values[on.third];
}

// GREY_VERTEX_LIGHTS numbers that lie together, from a place that is a multiple of as many.
WARPCAM_DEVICE void load_few(const float* from, float* to)
{
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(to) = *reinterpret_cast<const float4*>(from);
#else
    for (int k = 0; k < GREY_VERTEX_LIGHTS; ++k)
        to[k] = from[k];
#endif
}

// What a pixel shows of a channel, whose numbers begin at `start`, in the lights that `shadow` leaves.
template <class Grid>
WARPCAM_DEVICE float channel_from_corners(const Grid& grid, const GridInterpolation& on, int shadow, int start)
{
    float sum = shown_at(grid, on, start);
#pragma unroll 1
    for (int n = 0; Grid::SHADOWS && n < grid.casting; ++n) {
        const float light = shown_at(grid, on, start + 1 + n);
        sum += grid.bits[1 + n] & shadow ? 0.0f : light;
    }
    return sum;
}

// The same where numbers are in groups.
template <class Grid>
WARPCAM_DEVICE float channel_from_groups(const Grid& grid, const GridInterpolation& on, int shadow, int start)
{
    float sum = 0.0f;
#pragma unroll 1
    for (int group = 0; group < grid.grouped_channel(); group += GREY_VERTEX_LIGHTS) {
        alignas(16) float first[GREY_VERTEX_LIGHTS], second[GREY_VERTEX_LIGHTS], third[GREY_VERTEX_LIGHTS];
        const float* values = grid.values + start + group;
        load_few(values + on.first, first);
        load_few(values + on.second, second);
        load_few(values + on.third, third);
#pragma unroll
        for (int n = 0; n < GREY_VERTEX_LIGHTS; ++n) {
            const float light = on.weight1 * first[n] + on.weight2 * second[n] + on.weight3 * third[n];
            if (n == 0 && group == 0) {
                sum = light;
                continue;
            }
#if defined(__CUDA_ARCH__)
            sum -= grid.bits[group + n] & shadow ? light : 0.0f;
#else
            sum += grid.bits[group + n] & shadow ? 0.0f : light;
#endif
        }
    }
    return max(sum, 0.0f);  // what is left of a sum may be less by its rounding
}

// Colour of a pixel in the lights that `shadow` leaves.
template <class Grid> WARPCAM_DEVICE Vec3 light_from_corners(const Grid& grid, const GridInterpolation& on, int shadow)
{
    const auto grouped = [&](int start) { return channel_from_groups(grid, on, shadow, start); };
    const auto single = [&](int start) { return channel_from_corners(grid, on, shadow, start); };
#if defined(__CUDA_ARCH__)
    if constexpr (Grid::SHADOWS && Grid::GENERAL)
        return grid.by_channel(grouped);
#endif
    if (Grid::SHADOWS && grid.few) {  // grey
        const float light = grouped(0);
        return { light, light, light };
    }
    return grid.by_channel(single);
}

// Shades a pixel of the plane from its cached vertices; returns false if they do not cover the pixel. `found` is the
// trace's result there, `shadow_at()` the lights that do not reach it. All threads of a warp call it together. APART:
// pixels that show something else are left out; otherwise such a pixel makes it return false for the whole warp.
template <bool TEXTURED, bool APART, bool USE_ATLAS, class Grid, class Textures, class Shadow>
WARPCAM_DEVICE bool draw_floor(const Grid& grid, const Textures& textures, const Hit& found, const Shadow& shadow_at,
                               float x, float y, Vec3& display)
{
    const FloorView& view = grid.view;
    const bool hit = found.shape >= 0, on_plane = hit && found.shape == grid.shape;
    if (!warp_any(on_plane) || (!APART && warp_any(hit && !on_plane)) || !view.plain)
        return false;
    const Float3Int axis_x = view.axis_x, axis_y = view.axis_y, axis_z = view.axis_z;
    const Vec3 ray { axis_x.x * x + axis_x.y * y - axis_x.z, axis_y.x * x + axis_y.y * y - axis_y.z,
                     axis_z.x * x + axis_z.y * y - axis_z.z };
    const Vec3 local { as_float(axis_x.w) + found.depth * ray.x, as_float(axis_y.w) + found.depth * ray.y, 0.0f };
    const GridInterpolation on = on_corners(grid, local, on_plane);
    if (APART ? !warp_any(on.inside) : warp_any(hit && !on.inside))
        return false;
    const int shadow = Grid::SHADOWS ? shadow_at() : 0;
    Vec3 texture { 1.0f, 1.0f, 1.0f };
    if (TEXTURED && view.count > 0)
        texture = floor_texture<USE_ATLAS>(view, textures.texels.data, ray, found.depth, local.x, local.y);
    display = mul(light_from_corners(grid, on, shadow), texture);
    return !APART || on.inside;
}

}  // namespace warpcam
