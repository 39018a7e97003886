// The corners of a plane's cells, which a block lights once for all of its pixels.
//
// A floor fills images, and few of its cells do: see shading/gouraud.h. What a corner shows in each light that casts
// shadows, and in all others together, is kept; a pixel adds up what three corners show in the lights that reach it.
#pragma once
#include "output/hit_attributes.h"
#include "shading/fixed_function.h"
#include "texture/sampler.h"

namespace warpcam {

// Bytes that a block may keep for corners to be kept as well: with more it leaves the cache of its multiprocessor too
// little.
#if defined(__CUDA_ARCH__)
constexpr int CORNERED = 30720;
#else
constexpr int CORNERED = 44032;
#endif

// Numbers that a block keeps, for its pixels and the bytes that are left to it.
constexpr int corner_room(int pixels, int bytes)
{
    const int most = pixels < 4096 ? pixels : 4096, room = bytes / int(sizeof(float));
    return room < 256 ? 0 : room < most ? room : most;
}

// Along one side of the plane, in cells: `rate * x + start` is how far x is from the first corner that is kept. Where a
// side ends its last cells are shorter: beyond `low` and `high` places are `stretch` times farther on.
struct CellAxis {
    float rate, start, low, high, stretch;

    WARPCAM_FN float at(float x) const
    {
        const float cell = rate * x + start;
        return cell + stretch * (cell - between(cell, low, high));
    }
};

WARPCAM_FN CellAxis cell_axis(const Cells& cells)
{
    const float start = -cells.start * cells.inverse;
    if (cells.rest < 0.0f)
        return { cells.inverse, start, -FAR_AWAY, FAR_AWAY, 0.0f };
    const float stretch = cells.rest > 1.0e-5f * cells.step ? cells.step / cells.rest - 1.0f : 0.0f;
    return { cells.inverse, start, 0.0f, round_down(2.0f * start + 0.5f), stretch };
}

// Where corner `i` is on a side, counted from where its cells begin [m].
WARPCAM_FN float corner_of(const Cells& cells, float i)
{
    const float x = cells.start + i * cells.step;
    return cells.rest < 0.0f ? x : between(x, cells.start - cells.rest, cells.rest - cells.start);
}

constexpr int MAX_LEVELS = 16;

// A plane as one view sees it: what its pixels need beside light.
struct FloorView {
    Row axis_x, axis_y, axis_z;  // as in Pose
    Row place;                   // on the texture: u is x * local.x + z, v is y * local.y + w (a float's bits)
    // Steps on the texture from pixel to pixel, to the right and down, at depth 1 [texels]: for a ray of direction r,
    // that of u is x - y * r.x / r.z, that of v z - w * r.y / r.z (w: a float's bits).
    Row right, down;
    // Of the texture: width, height and start (of floats the bits); w: start of the next. With a sheet all are floats,
    // the last two where the level begins there, left and top.
    Row levels[MAX_LEVELS + 1];  // on a sheet the last of them twice
    unsigned long long sheet;    // see Textures.sheets; 0: none
    int count;                   // of levels
    int plain;                   // 1: it has a texture of one image, or none
};

constexpr int FEW = 4;  // numbers that are loaded at once

// The corners that are kept are a rectangle of columns and rows. One keeps `stride` numbers: what it shows in the
// lights that cast no shadow, and then in each that does; one number where all of that is grey, else three. Where these
// are few there are FEW of them, the last ones 0, and on CUDA the first is what it shows in all lights.
template <int ROOM_, bool SHADOWS_> struct CornerGrid {
    static constexpr int ROOM = ROOM_;
    static constexpr bool SHADOWS = SHADOWS_, LIT = true;

    alignas(16) float values[ROOM > 0 ? ROOM : 1];
    alignas(16) int bits[MAX_LIGHTS];  // of shadow masks, of the lights that cast shadows
    FloorView view;
    CellAxis u, v;
    int first_u, first_v;
    int columns, rows, stride;
    int shape;  // the plane, or -1 where nothing is kept
    int grey;
    int casting;  // lights that cast shadows
    int few;      // 1: a corner keeps FEW numbers
};

// The lights of a world with the corners that they light.
template <int ROOM, bool SHADOWS> struct LitCorners : LightList {
    CornerGrid<ROOM, SHADOWS> grid;
};

// The same of a floor that no light falls on: what it shows of its own colour is its texture.
struct BareGrid {
    static constexpr bool SHADOWS = false, LIT = false;

    FloorView view;
    Vec color;
    int shape;
};

struct BareFloor : LightList {
    BareGrid grid;
};

template <class List> struct HasCorners {
    static constexpr bool VALUE = false;
};
template <int ROOM, bool SHADOWS> struct HasCorners<LitCorners<ROOM, SHADOWS>> {
    static constexpr bool VALUE = ROOM > 0;
};

// Whether pixels can be lit by the list's corners: with shadows only if these are.
template <class List> constexpr bool lit_by_corners(bool shadows)
{
    if constexpr (HasCorners<List>::VALUE)
        return decltype(List::grid)::SHADOWS == shadows;
    return false;
}

// The least of what the threads of a team have.
WARPCAM_FN float team_least(float value)
{
#if defined(__CUDA_ARCH__)
    for (int step = LANES / 2; step > 0; step /= 2)
        value = lower(value, __shfl_xor_sync(ALL, value, step));
#endif
    return value;
}

WARPCAM_FN float team_sum(float value)
{
#if defined(__CUDA_ARCH__)
    for (int step = LANES / 2; step > 0; step /= 2)
        value += __shfl_xor_sync(ALL, value, step);
#endif
    return value;
}

constexpr int SAMPLE_COLUMNS = 8, SAMPLE_ROWS = 16;

// Chooses which corners of a plane are kept: those around what a region shows of it, and where there is no room for
// these around what is near. A team calls it. `sheet`: of the plane's texture, see Textures.sheets; 0: none.
template <int LENS, class Grid, class Looks, class Frame>
WARPCAM_FN void choose_corners(Grid& grid, const LightList& list, const Looks& look, const Camera& camera,
                               const Region& region, const Frame& frame, unsigned long long sheet, bool mirrored,
                               int lane)
{
    if (frame.plane < 0 || look.cells.u.step == 0.0f) {
        if (lane == 0)
            grid.shape = -1;
        return;
    }
    constexpr int EACH = SAMPLE_COLUMNS * SAMPLE_ROWS / TEAM;
    CellAxis u_axis = cell_axis(look.cells.u), v_axis = cell_axis(look.cells.v);
    const Pose& pose = look.pose;
    const Vec eye = pose.eye();
    float u[EACH], v[EACH], depth[EACH];
    int stride = 1, casting = 0;
    const bool grey = !list.colored && look.finish.color.x == look.finish.color.y
        && look.finish.color.x == look.finish.color.z;
    for (int n = 0; n < list.count; ++n)
        casting += Grid::SHADOWS && (list.lights[n].ambient.w & CASTS) ? 1 : 0;
    const bool few = grey && casting > 0 && casting < FEW;
    stride = few ? FEW : (1 + casting) * (grey ? 1 : 3);
    for (int k = 0; k < EACH; ++k) {
        const int sample = lane + k * TEAM;
        const float i = float(region.left)
            + float(sample % SAMPLE_COLUMNS) * (float(region.width - 1) / float(SAMPLE_COLUMNS - 1));
        const float j = float(region.top)
            + float(sample / SAMPLE_COLUMNS) * (float(region.height - 1) / float(SAMPLE_ROWS - 1));
        ViewRay<LENS> sight { 0.0f, 0.0f };
        if constexpr (LENS == RAYS)
            sight = table_ray(camera, int(i), int(j));
        else
            sight = { image_x(camera, mirrored ? float(frame.width - 1) - i : i), image_y(camera, j) };
        const Vec ray = pose.local(sight.direction());
        const Vec start = has_centre(LENS) ? eye : eye + pose.local({ sight.x, sight.y, 0.0f });
        const float away = -start.z * reciprocal(nonzero(ray.z));
        const bool seen = start.z * ray.z < 0.0f && away < camera.far && !(LENS == RAYS && sight.x >= BLIND);
        depth[k] = seen ? away : FAR_AWAY;
        u[k] = between(u_axis.at(start.x + away * ray.x), u_axis.low - 1.0f, u_axis.high + 0.999f);
        v[k] = between(v_axis.at(start.y + away * ray.y), v_axis.low - 1.0f, v_axis.high + 0.999f);
    }
    float limit = FAR_AWAY, all = 0.0f;  // samples that see the plane
    int kept = -1;
    for (int trial = 0; trial < 24 && limit > 0.0f; ++trial) {
        float left = FAR_AWAY, right = FAR_AWAY, bottom = FAR_AWAY, top = FAR_AWAY, far = 0.0f, seen = 0.0f;
        for (int k = 0; k < EACH; ++k) {
            const bool counts = depth[k] < limit;
            seen += counts ? 1.0f : 0.0f;
            left = counts ? lower(left, u[k]) : left;
            right = counts ? lower(right, -u[k]) : right;
            bottom = counts ? lower(bottom, v[k]) : bottom;
            top = counts ? lower(top, -v[k]) : top;
            far = counts ? lower(far, -depth[k]) : far;
        }
        left = round_down(team_least(left));
        bottom = round_down(team_least(bottom));
        const float columns = 2.0f + round_down(-team_least(right)) - left;
        const float rows = 2.0f + round_down(-team_least(top)) - bottom;
        far = -team_least(far);
        seen = team_sum(seen);
        all = upper(all, seen);
        if (!(far > 0.0f) || seen < 0.6f * all)  // too little is near to be worth it
            break;
        if (columns * rows * float(stride) <= float(Grid::ROOM) && magnitude(left) < 1.0e6f
            && magnitude(bottom) < 1.0e6f) {
            kept = frame.plane;
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
    list_levels(grid.view, look, sheet, lane);
    if (lane != 0)
        return;
    grid.u = u_axis;
    grid.v = v_axis;
    grid.stride = stride;
    grid.shape = kept;
    view_floor(grid.view, look, camera);
    grid.grey = grey;
    grid.few = few;
    grid.casting = 0;
    for (int n = 0; n < FEW; ++n)
        grid.bits[n] = 0;
    for (int n = 0; n < list.count; ++n)
        if (Grid::SHADOWS && (list.lights[n].ambient.w & CASTS))
            grid.bits[grid.casting++] = list.lights[n].place.w;
}

WARPCAM_FN void keep(float* values, Vec color, float) { values[0] = color.x; }
WARPCAM_FN void keep(float* values, Vec color, Vec)
{
    values[0] = color.x;
    values[1] = color.y;
    values[2] = color.z;
}

// What one corner shows, on a display if DISPLAYED. Sum: float where all of it is grey, else Vec.
template <class Sum, bool SHADOWS, bool DISPLAYED>
WARPCAM_FN void light_corner(const LightList& list, Vec place, Vec normal, const Finish& finish, float* values)
{
    constexpr int CHANNELS = sizeof(Sum) / sizeof(float);
    const Vertex corner = vertex_at(place, normal);
    const auto shown = [](Vec color) { return DISPLAYED ? clip(color) : color; };
    Glow<Sum> steady {};
    int slot = CHANNELS;
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        Arrival arrival;
        Share share;
        if (light.ambient.w & SPOT) {
            arrival = arrival_of<true>(light, corner, 1.0f);
            if (light.ambient.w & FADES)
                arrival.strength *= faded(light, corner);
            share = share_of<true>(light, corner, arrival, finish.gloss.z);
        } else {
            arrival = arrival_of<false>(light, corner, 1.0f);
            share = share_of<false>(light, corner, arrival, finish.gloss.z);
        }
        if (SHADOWS && (light.ambient.w & CASTS)) {
            Glow<Sum> own {};
            add_share(own, share, light);
            keep(values + slot, shown(reflected(own, of_casting(finish))), Sum {});
            slot += CHANNELS;
        } else {
            add_share(steady, share, light);
        }
    }
    keep(values, shown(reflected(steady, always_on(list, finish), finish)), Sum {});
}

// Lights the corners that are kept; the threads of a block share them.
template <bool DISPLAYED, class Grid, class Looks>
WARPCAM_FN void light_corners(Grid& grid, const LightList& list, const Looks& look, int thread)
{
    if (grid.shape < 0)
        return;
    const Vec eye = look.pose.eye(), normal = look.pose.seen({ 0.0f, 0.0f, 1.0f });
#pragma unroll 1
    for (int i = thread; i < grid.columns * grid.rows; i += THREADS) {
        const int row = int(unsigned(i) / unsigned(grid.columns)), column = i - row * grid.columns;
        const Vec place = look.pose.seen({ corner_of(look.cells.u, float(grid.first_u + column)) - eye.x,
                                           corner_of(look.cells.v, float(grid.first_v + row)) - eye.y, -eye.z });
        float* values = grid.values + i * grid.stride;
        if (grid.grey)
            light_corner<float, Grid::SHADOWS, DISPLAYED>(list, place, normal, look.finish, values);
        if (grid.few) {
            for (int n = 1 + grid.casting; n < FEW; ++n)
                values[n] = 0.0f;
            for (int n = 1; n < FEW; ++n)
                values[0] += values[n];
        }
        if (!grid.grey)
            light_corner<Vec, Grid::SHADOWS, DISPLAYED>(list, place, normal, look.finish, values);
    }
}

template <class Looks>
WARPCAM_FN void list_levels(FloorView& view, const Looks& look, unsigned long long sheet, int lane)
{
    if constexpr (Looks::TEXTURED) {
        const Image& image = look.layout.image;
        if (lane == 0)
            view.sheet = sheet;
        for (int i = lane; i < lower_int(image.levels, MAX_LEVELS) + 1; i += TEAM) {
            const Level level = Level { image.start, image.width, image.height }.after(i, 1);
            if (sheet) {
                view.levels[i] = level_on_sheet(image, lower_int(i, image.levels - 1));
                continue;
            }
            view.levels[i] = { as_float(level.width), as_float(level.height), as_float(level.start),
                               level.next(1).start };
        }
    }
}

template <class Looks> WARPCAM_FN void view_floor(FloorView& view, const Looks& look, const Camera& camera)
{
    const Pose& pose = look.pose;
    view.axis_x = pose.axis_x;
    view.axis_y = pose.axis_y;
    view.axis_z = pose.axis_z;
    view.count = 0;
    view.plain = 1;
    if constexpr (Looks::TEXTURED) {
        const Layout& layout = look.layout;
        const float rate_u = layout.repeat[0], rate_v = layout.repeat[1];
        const float u = rate_u * float(layout.image.width), v = rate_v * float(layout.image.height);
        const float a = camera.scale_x, b = -camera.scale_y;
        float start_u = layout.start[0], start_v = layout.start[1];
        shift(look, start_u, start_v);
        view.place = { rate_u, rate_v, start_u, as_int(start_v) };
        view.right = { a * u * pose.axis_x.x, a * u * pose.axis_z.x, a * v * pose.axis_y.x,
                       as_int(a * v * pose.axis_z.x) };
        view.down = { b * u * pose.axis_x.y, b * u * pose.axis_z.y, b * v * pose.axis_y.y,
                      as_int(b * v * pose.axis_z.y) };
        view.count = layout.image.levels;
        view.plain = !(layout.image.levels > 0 && layout.cube) && layout.image.levels <= MAX_LEVELS;
    }
}

// A team calls it. `sheet` as above.
template <class Looks>
WARPCAM_FN void see_floor(BareGrid& grid, const Looks& look, const Camera& camera, int plane, unsigned long long sheet,
                          int lane)
{
    list_levels(grid.view, look, sheet, lane);
    if (lane != 0)
        return;
    view_floor(grid.view, look, camera);
    grid.color = clip(to_vec(look.finish.color));
    grid.shape = plane;
}

}  // namespace warpcam
