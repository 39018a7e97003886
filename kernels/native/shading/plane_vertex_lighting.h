// The corners of a plane's cells, which a block lights once for all of its pixels.
//
// A floor fills images, and few of its cells do: see shading/gouraud.h. What a corner shows in each light that casts
// shadows, and in all others together, is kept; a pixel adds up what three corners show in the lights that reach it.
#pragma once
#include "shading/fixed_function.h"
#include "shading/floor_view.h"

namespace warpcam {

// Bytes that a block may keep for corners to be kept as well: with more it leaves the cache of its multiprocessor too
// little.
#if defined(__CUDA_ARCH__)
constexpr int VERTEX_GRID_BYTES = 30720;
#else
constexpr int VERTEX_GRID_BYTES = 44032;
#endif

// Numbers that a block keeps, for its pixels and the bytes that are left to it: no more than pixels in small regions.
constexpr int corner_room(int pixels, int bytes)
{
    const int most = pixels < 3072 ? pixels : 4096, room = bytes / int(sizeof(float));
    return room < 256 ? 0 : room < most ? room : most;
}

// Along one side of the plane, in cells: `rate * x + start` is how far x is from the first corner that is kept. Where a
// side ends its last cells are shorter: beyond `low` and `high` places are `stretch` times farther on.
struct CellAxis {
    float rate, start, low, high, stretch;

    template <class Number> WARPCAM_DEVICE Number at(Number x) const
    {
        const Number cell = rate * x + start;
        return stretched(cell);
    }
    template <class Number> WARPCAM_DEVICE Number stretched(Number cell) const
    {
        const Number least = low, most = high;
        return cell + stretch * (cell - clamp(cell, least, most));
    }
};

WARPCAM_DEVICE CellAxis cell_axis(const GridAxis& cells)
{
    const float start = -cells.start * cells.inverse;
    if (cells.rest < 0.0f)
        return { cells.inverse, start, -MISS, MISS, 0.0f };
    const float stretch = cells.rest > 1.0e-5f * cells.step ? cells.step / cells.rest - 1.0f : 0.0f;
    return { cells.inverse, start, 0.0f, round_down(2.0f * start + 0.5f), stretch };
}

// Position of vertex `i` along a side, from the start of its cells [m].
WARPCAM_DEVICE float corner_of(const GridAxis& cells, float i)
{
    const float x = cells.start + i * cells.step;
    return cells.rest < 0.0f ? x : clamp(x, cells.start - cells.rest, cells.rest - cells.start);
}

constexpr int GREY_VERTEX_LIGHTS = 4;  // numbers that are loaded at once

// Numbers of so many lights that cast shadows and of all others together, in whole groups.
constexpr int grouped(int casting) { return (casting / GREY_VERTEX_LIGHTS + 1) * GREY_VERTEX_LIGHTS; }

// The corners that are kept are a rectangle of columns and rows. One keeps `each` numbers of one channel, if all of it
// is grey, else of three: what it shows in the lights that cast no shadow, and then in each that does. Where these are
// in groups, `each` is a multiple of GREY_VERTEX_LIGHTS, the last ones are 0, and on CUDA the first is what it shows in
// all lights: for few grey lights, and on CUDA for all if GENERAL.
template <int ROOM_, bool SHADOWS_, bool GENERAL_> struct LitVertexGrid {
    static constexpr int SIZE = ROOM_;
    static constexpr bool SHADOWS = SHADOWS_, GENERAL = GENERAL_, LIT = true;

    alignas(16) float values[SIZE > 0 ? SIZE : 1];
    alignas(16) int bits[grouped(MAX_LIGHTS)];  // of shadow masks, for the numbers of a channel; 0 for the first
    FloorView view;
    CellAxis u, v;
    int first_u, first_v;
    int columns, rows;
    int each, stride;  // numbers of a channel, and of all
    int shape;  // the plane, or -1 where nothing is kept
    int grey;
    int casting;  // lights that cast shadows
    int few;  // 1: numbers are in groups, if there are shadows

    // Numbers that are in groups, of a channel and of all.
    WARPCAM_DEVICE int grouped_channel() const { return GENERAL ? each : GREY_VERTEX_LIGHTS; }
    WARPCAM_DEVICE int all_grouped() const { return GENERAL ? stride : GREY_VERTEX_LIGHTS; }

    // Three channels, or three times one if all is grey; `channel` tells what begins at a number. Small, not unrolled.
    template <class Channel> WARPCAM_DEVICE Vec3 by_channel(const Channel& channel) const
    {
        Vec3 light { 0.0f, 0.0f, 0.0f };
#pragma unroll 1
        for (int start = 0; start < stride; start += each)
            light = { light.y, light.z, channel(start) };
        return grey ? Vec3 { light.z, light.z, light.z } : light;
    }
};

// The lights of a world with the corners that they light.
template <int SIZE, bool SHADOWS, bool GENERAL> struct LitCorners : LightList {
    LitVertexGrid<SIZE, SHADOWS, GENERAL> grid;
};

// Grid of a plane that no light falls on: its colour is its texture.
struct BareGrid {
    static constexpr bool SHADOWS = false, LIT = false;

    FloorView view;
    Vec3 color;
    int shape;
};

struct BareFloor : LightList {
    BareGrid grid;
};

template <class List> struct HasCorners {
    static constexpr bool VALUE = false;
};
template <int SIZE, bool SHADOWS, bool GENERAL> struct HasCorners<LitCorners<SIZE, SHADOWS, GENERAL>> {
    static constexpr bool VALUE = SIZE > 0;
};

// True if pixels can be lit from the list's vertices: with shadows only if the vertices hold them.
template <class List> constexpr bool lit_by_corners(bool shadows)
{
    if constexpr (HasCorners<List>::VALUE)
        return decltype(List::grid)::SHADOWS == shadows;
    return false;
}

// The least of what the threads of a team have.
WARPCAM_DEVICE float team_least(float value)
{
#if defined(__CUDA_ARCH__)
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        value = min(value, __shfl_xor_sync(FULL_WARP, value, step));
#endif
    return value;
}

WARPCAM_DEVICE float team_sum(float value)
{
#if defined(__CUDA_ARCH__)
    for (int step = WARP_SIZE / 2; step > 0; step /= 2)
        value += __shfl_xor_sync(FULL_WARP, value, step);
#endif
    return value;
}

constexpr int SAMPLE_COLUMNS = 8, SAMPLE_ROWS = 16;

// Chooses which corners of a plane are kept: those around what a region shows of it, and where there is no room for
// these around what is near. A team calls it. `plane`: its id, or -1; `atlas`: of its texture, see Textures.atlases; 0:
// none.
template <int LENS, class Grid, class Appearances, class Frame>
WARPCAM_DEVICE void choose_corners(Grid& grid, const LightList& list, const Appearances& look, const Camera& camera,
                                   const Region& region, const Frame& frame, int plane, unsigned long long atlas,
                                   bool mirrored, int lane)
{
    if (plane < 0 || look.cells.u.step == 0.0f) {
        if (lane == 0)
            grid.shape = -1;
        return;
    }
    constexpr int EACH = SAMPLE_COLUMNS * SAMPLE_ROWS / WARP_OR_ONE;
    CellAxis u_axis = cell_axis(look.cells.u), v_axis = cell_axis(look.cells.v);
    const ShapeFromCamera& pose = look.pose;
    const Vec3 eye = pose.eye();
    float u[EACH], v[EACH], depth[EACH];
    int casting = 0;
    const bool grey = !list.colored && look.material.color.x == look.material.color.y
                      && look.material.color.x == look.material.color.z;
    for (int n = 0; n < list.count; ++n)
        casting += Grid::SHADOWS && (list.lights[n].ambient.w & CASTS) ? 1 : 0;
#if defined(__CUDA_ARCH__)
    const bool few = Grid::SHADOWS && (Grid::GENERAL || (grey && casting < GREY_VERTEX_LIGHTS));
#else
    const bool few = grey && casting > 0 && casting < GREY_VERTEX_LIGHTS;
#endif
    const int each = few ? grouped(casting) : 1 + casting, stride = each * (grey ? 1 : 3);
    for (int k = 0; k < EACH; ++k) {
        const int sample = lane + k * WARP_OR_ONE;
        const float i =
            float(region.left) + float(sample % SAMPLE_COLUMNS) * (float(region.width - 1) / float(SAMPLE_COLUMNS - 1));
        const float j =
            float(region.top) + float(sample / SAMPLE_COLUMNS) * (float(region.height - 1) / float(SAMPLE_ROWS - 1));
        CameraRay<LENS> camera_ray { 0.0f, 0.0f };
        if constexpr (LENS == RAYS)
            camera_ray = table_ray(camera, int(i), int(j));
        else
            camera_ray = { image_x(camera, mirrored ? float(frame.width - 1) - i : i), image_y(camera, j) };
        const Vec3 ray = pose.local(camera_ray.direction());
        const Vec3 start = has_centre(LENS) ? eye : eye + pose.local({ camera_ray.x, camera_ray.y, 0.0f });
        const float away = -start.z * rcp(avoid_zero(ray.z));
        const bool seen = start.z * ray.z < 0.0f && away < camera.far && !(LENS == RAYS && camera_ray.x >= NO_RAY);
        depth[k] = seen ? away : MISS;
        u[k] = clamp(u_axis.at(start.x + away * ray.x), u_axis.low - 1.0f, u_axis.high + 0.999f);
        v[k] = clamp(v_axis.at(start.y + away * ray.y), v_axis.low - 1.0f, v_axis.high + 0.999f);
    }
    float limit = MISS, all = 0.0f;  // samples that see the plane
    int kept = -1;
    for (int trial = 0; trial < 24 && limit > 0.0f; ++trial) {
        float left = MISS, right = MISS, bottom = MISS, top = MISS, far = 0.0f, seen = 0.0f;
        for (int k = 0; k < EACH; ++k) {
            const bool counts = depth[k] < limit;
            seen += counts ? 1.0f : 0.0f;
            left = counts ? min(left, u[k]) : left;
            right = counts ? min(right, -u[k]) : right;
            bottom = counts ? min(bottom, v[k]) : bottom;
            top = counts ? min(top, -v[k]) : top;
            far = counts ? min(far, -depth[k]) : far;
        }
        left = round_down(team_least(left));
        bottom = round_down(team_least(bottom));
        const float columns = 2.0f + round_down(-team_least(right)) - left;
        const float rows = 2.0f + round_down(-team_least(top)) - bottom;
        far = -team_least(far);
        seen = team_sum(seen);
        all = max(all, seen);
        if (!(far > 0.0f) || seen < 0.6f * all)  // too little is near to be worth it
            break;
        if (columns * rows * float(stride) <= float(Grid::SIZE) && abs(left) < 1.0e6f && abs(bottom) < 1.0e6f) {
            kept = plane;
            if (lane == 0) {
                grid.first_u = int(left);
                grid.first_v = int(bottom);
                grid.columns = int(columns);
                grid.rows = int(rows);
            }
            u_axis.start -= left;
            u_axis.low -= left;
            u_axis.high -= left;
            v_axis.start -= bottom;
            v_axis.low -= bottom;
            v_axis.high -= bottom;
            break;
        }
        limit = 0.85f * far;
    }
    list_levels(grid.view, look, atlas, lane);
    if (lane != 0)
        return;
    grid.u = u_axis;
    grid.v = v_axis;
    grid.each = each;
    grid.stride = stride;
    grid.shape = kept;
    view_floor(grid.view, look, camera);
    grid.grey = grey;
    grid.few = few;
    grid.casting = 0;
    for (int n = 0; n < grouped(MAX_LIGHTS); ++n)
        grid.bits[n] = 0;
    for (int n = 0; n < list.count; ++n)
        if (Grid::SHADOWS && (list.lights[n].ambient.w & CASTS))
            grid.bits[++grid.casting] = list.lights[n].place.w;
}

WARPCAM_DEVICE void keep(float* values, int, Vec3 color, float) { values[0] = color.x; }
WARPCAM_DEVICE void keep(float* values, int each, Vec3 color, Vec3)
{
    values[0] = color.x;
    values[each] = color.y;
    values[2 * each] = color.z;
}

// Light of one vertex, display-encoded if DISPLAYED. Sum: float if all of it is grey, else Vec3, whose channels are
// `each` numbers apart.
template <class Sum, bool SHADOWS, bool DISPLAYED>
WARPCAM_DEVICE void light_corner(const LightList& list, Vec3 place, Vec3 normal, const ResolvedMaterial& material,
                                 int each, float* values)
{
    const LightingVertex corner = vertex_at(place, normal);
    const auto shown = [](Vec3 color) { return DISPLAYED ? clip(color) : color; };
    LightSum<Sum> steady {};
    int slot = 1;
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        LightDirection arrival;
        LightWeights<float> share;
        if (light.ambient.w & SPOT) {
            arrival = arrival_of<true>(light, corner, 1.0f);
            if (light.ambient.w & FADES)
                arrival.strength *= faded(light, corner);
            share = share_of<true>(light, corner, arrival, material.gloss.z);
        } else {
            arrival = arrival_of<false>(light, corner, 1.0f);
            share = share_of<false>(light, corner, arrival, material.gloss.z);
        }
        if (SHADOWS && (light.ambient.w & CASTS)) {
            LightSum<Sum> own {};
            add_share(own, share, light);
            keep(values + slot++, each, shown(reflected<Vec3>(own, of_casting(material))), Sum {});
        } else {
            add_share(steady, share, light);
        }
    }
    keep(values, each, shown(reflected<Vec3>(steady, always_on(list, material), material)), Sum {});
}

// Lights the corners that are kept; the threads of a block share them.
template <bool DISPLAYED, class Grid, class Appearances>
WARPCAM_DEVICE void light_corners(Grid& grid, const LightList& list, const Appearances& look, int thread)
{
    if (grid.shape < 0)
        return;
    const Vec3 eye = look.pose.eye(), normal = look.pose.seen({ 0.0f, 0.0f, 1.0f });
#pragma unroll 1
    for (int i = thread; i < grid.columns * grid.rows; i += THREADS) {
        const int row = int(unsigned(i) / unsigned(grid.columns)), column = i - row * grid.columns;
        const Vec3 place = look.pose.seen({ corner_of(look.cells.u, float(grid.first_u + column)) - eye.x,
                                            corner_of(look.cells.v, float(grid.first_v + row)) - eye.y, -eye.z });
        float* values = grid.values + i * grid.stride;
        if (grid.grey)
            light_corner<float, Grid::SHADOWS, DISPLAYED>(list, place, normal, look.material, grid.each, values);
        else
            light_corner<Vec3, Grid::SHADOWS, DISPLAYED>(list, place, normal, look.material, grid.each, values);
        if (!Grid::SHADOWS || !(Grid::GENERAL || grid.few))
            continue;
        const int each = grid.grouped_channel();
        for (int start = 0; start < grid.all_grouped(); start += each) {
            for (int n = 1 + grid.casting; n < each; ++n)
                values[start + n] = 0.0f;
            for (int n = 1; n < each; ++n)
                values[start] += values[start + n];
        }
    }
}

// A team calls it. `atlas`: of the plane's texture, see Textures.atlases; 0: none.
template <class Appearances> WARPCAM_DEVICE void see_floor(BareGrid& grid, const Appearances& look,
                                                           const Camera& camera, int plane, unsigned long long atlas,
                                                           int lane)
{
    list_levels(grid.view, look, atlas, lane);
    if (lane != 0)
        return;
    view_floor(grid.view, look, camera);
    grid.color = clip(as_vec3(look.material.color));
    grid.shape = plane;
}

}  // namespace warpcam
