// A floor that is lit by its corners, drawn apart from what stands on it: a lane draws four pixels beside each other,
// so that what a strip of 128 takes, its numbers and its stores are paid once for four tiles.
#pragma once
#include "shading_pass/covered_tiles.h"
#include "shading_pass/store_quads.h"
#include "shading_pass/strip_lighting.h"
#include "traversal/trace_tile.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// A region's strips, 32 pixels wide and a tile high, dealt out to its warps: each has one column of them.
template <int WIDTH, int HEIGHT> struct Strips {
    static constexpr int PIXELS = QUAD * WARP_SIZE, ACROSS = WIDTH / WARP_SIZE, WARPS = THREADS / WARP_SIZE;
    static constexpr int EACH = WIDTH * HEIGHT / (PIXELS * WARPS);  // of a warp
    static constexpr bool FIT =
        WIDTH % WARP_SIZE == 0 && WARPS % ACROSS == 0 && EACH * PIXELS * WARPS == WIDTH * HEIGHT && EACH * QUAD <= 32;

    // Column of a lane's first pixel in the region; `strip` counts those of a warp.
    WARPCAM_DEVICE static int column(int warp, int lane)
    {
        return warp % ACROSS * WARP_SIZE + lane % TILE_WIDTH * QUAD;
    }
    WARPCAM_DEVICE static int row(int warp, int lane, int strip)
    {
        return (warp / ACROSS + strip * (WARPS / ACROSS)) * TILE_HEIGHT + lane / TILE_WIDTH;
    }
};

// A plane whose corners are kept, by the numbers of pixels: what follows from these in steps.
struct StripPlan {
    // Rate at which a pixel's ray approaches the plane, and its coordinates along the plane's sides in cells times that
    // rate: changes from column to column and from row to row, and values at the image's first pixel. w: bits of the
    // eye's coordinate [cells].
    Float3Int height, u, v;
    Float3Int texture;      // u is x * cells + y, v is z * cells + w (a float's bits)
    Float3Int right,
        down;  // steps on the texture, times the square of the height: x * row + y, z * row + w; `down` by column
    float columns, rows;  // of what is kept
    float coarsest;   // level of the texture
    unsigned long long image;  // its texture: a mipmapped one, or an atlas
    unsigned bias;    // of a corner's number
    int plain;        // 1: pixels can be drawn by all of this
    int simple;  // 1: light is grey, a corner keeps as few numbers as may be, all cells are equal, no exposure; if all
    // that is `plain` is not
    Vec3 gain;  // the camera's exposure
    int count, next;  // of pixels that are left; of 32 of them the next that no warp has
};

template <class Grid> WARPCAM_DEVICE void plan_strips(StripPlan& plan, const Grid& grid, const Camera& camera,
                                                      unsigned long long image, Vec3 gain)
{
    const FloorView& view = grid.view;
    plan.image = image;
    CellAxis cells_u { 1.0f, 0.0f, 0.0f, 0.0f, 0.0f }, cells_v = cells_u;  // places in metres where there are no cells
    plan.count = plan.next = 0;
    plan.plain = grid.shape >= 0 && view.plain && (view.count == 0 || image);
    if constexpr (Grid::LIT) {
        cells_u = grid.u;
        cells_v = grid.v;
        plan.gain = gain;
        plan.simple = grid.grey && grid.each == (Grid::SHADOWS ? GREY_VERTEX_LIGHTS : 1) && cells_u.stretch == 0.0f
                      && cells_v.stretch == 0.0f && gain.x == 1.0f && gain.y == 1.0f && gain.z == 1.0f;
        if (!Grid::GENERAL)
            plan.plain &= plan.simple;
        plan.columns = float(grid.columns) - 1.0001f;
        plan.rows = float(grid.rows) - 1.0001f;
        plan.bias = unsigned(as_int(WHOLE_NUMBERS)) * unsigned(grid.columns + 1);
    }
    const float x = image_x(camera, 0.0f), y = image_y(camera, 0.0f), dx = camera.scale_x, dy = -camera.scale_y;
    const Float3Int ax = view.axis_x, ay = view.axis_y, az = view.axis_z;
    const float away = -as_float(az.w), side = away < 0.0f ? -1.0f : 1.0f;
    const auto along = [&](const Float3Int& axis, float scale, float eye) {
        return Float3Int { scale * axis.x * dx, scale * axis.y * dy, scale * (axis.x * x + axis.y * y - axis.z),
                           as_int(eye) };
    };
    plan.height = along(az, side, 0.0f);
    plan.u = along(ax, side * away * cells_u.rate, cells_u.rate * as_float(ax.w) + cells_u.start);
    plan.v = along(ay, side * away * cells_v.rate, cells_v.rate * as_float(ay.w) + cells_v.start);
    const float rate_u = view.place.x / cells_u.rate, rate_v = view.place.y / cells_v.rate;
    plan.texture = { rate_u, view.place.z - rate_u * cells_u.start, rate_v,
                     as_int(as_float(view.place.w) - rate_v * cells_v.start) };
    // Along its own direction a step does not change these.
    const Float3Int right = view.right, down = view.down;
    const float right_w = as_float(right.w), down_w = as_float(down.w);
    plan.right = { away * dy * (right.x * az.y - right.y * ax.y),
                   away * (right.x * (az.y * y - az.z) - right.y * (ax.y * y - ax.z)),
                   away * dy * (right.z * az.y - right_w * ay.y),
                   as_int(away * (right.z * (az.y * y - az.z) - right_w * (ay.y * y - ay.z))) };
    plan.down = { away * dx * (down.x * az.x - down.y * ax.x),
                  away * (down.x * (az.x * x - az.z) - down.y * (ax.x * x - ax.z)),
                  away * dx * (down.z * az.x - down_w * ay.x),
                  as_int(away * (down.z * (az.x * x - az.z) - down_w * (ay.x * x - ay.z))) };
    plan.coarsest = float(view.count - 1);
}

// Half the logarithm of the square of a step.
WARPCAM_DEVICE float step_size(const Float3Int& steps, float at)
{
    const float u = steps.x * at + steps.y, v = steps.z * at + as_float(steps.w);
    return 0.5f * log2(max(u * u + v * v, MIN_NORMAL));
}

// Values that a lane's pixels share in all rows.
struct StripColumn {
    float height, u, v;  // at the first one, in the image's first row
    float down[QUAD];  // step_size()
};

WARPCAM_DEVICE StripColumn strip_column(const StripPlan& plan, float column)
{
    StripColumn own { plan.height.z + column * plan.height.x, plan.u.z + column * plan.u.x,
                      plan.v.z + column * plan.v.x };
    for (int k = 0; k < QUAD; ++k)
        own.down[k] = step_size(plan.down, column + float(k));
    return own;
}

// Draws four pixels of the plane. `shadows`: the lights that do not reach them, a byte each, if SHADED. False if what
// is kept does not reach as far.
template <bool TEXTURED, bool MIPS, bool SHADED, int IMAGES, class Grid>
WARPCAM_DEVICE bool draw_quad(const StripPlan& plan, const Grid& grid, const StripColumn& own, float row,
                              unsigned shadows, Quad<IMAGES>& quad)
{
    const FloorView& view = grid.view;
    const Float3Int height = plan.height, across_u = plan.u, across_v = plan.v;
    const float start = own.height + row * height.y, start_u = own.u + row * across_u.y,
                start_v = own.v + row * across_v.y;
    float rate[QUAD], u[QUAD], v[QUAD];
#pragma unroll
    for (int k = 0; k < QUAD; ++k) {
        rate[k] = rcp(start + float(k) * height.x);
        u[k] = fma(start_u + float(k) * across_u.x, rate[k], as_float(across_u.w));
        v[k] = fma(start_v + float(k) * across_v.x, rate[k], as_float(across_v.w));
    }
    // Tolerance in rounding: a point between two pixels that the vertices cover is covered, too.
    constexpr float SLACK = 1.0e-5f;
    bool within = min(rate[0], rate[3]) > 0.0f;
    if constexpr (Grid::LIT) {
        float u0 = u[0], u3 = u[3], v0 = v[0], v3 = v[3];
        if (Grid::GENERAL && !plan.simple) {
            u0 = grid.u.stretched(u0);
            u3 = grid.u.stretched(u3);
            v0 = grid.v.stretched(v0);
            v3 = grid.v.stretched(v3);
        }
        within = within & (min(u0, u3) >= SLACK) & (max(u0, u3) < plan.columns) & (min(v0, v3) >= SLACK)
                 & (max(v0, v3) < plan.rows);
    }
    if (!within)
        return false;
    const float right = TEXTURED ? step_size(plan.right, row) : 0.0f;
    const Float3Int texture = plan.texture;
    Vec3 colors[QUAD];
#pragma unroll
    for (int k = 0; k < QUAD; ++k) {
        Vec3 color { 1.0f, 1.0f, 1.0f };
        if constexpr (TEXTURED && MIPS) {
            color = look_up(plan.image, texture.x * u[k] + texture.y, texture.z * v[k] + as_float(texture.w),
                            2.0f * log2(rate[k]) + max(own.down[k], right));
        } else if constexpr (TEXTURED) {
            const float detail = min(max(2.0f * log2(rate[k]) + max(own.down[k], right), 0.0f), plan.coarsest);
            const float base = __fadd_rd(detail, WHOLE_NUMBERS);
            const int level = as_int(base) - as_int(WHOLE_NUMBERS);
            color = sample_atlas(plan.image, view.levels[level], view.levels[level + 1], texture.x * u[k] + texture.y,
                                 texture.z * v[k] + as_float(texture.w), detail - (base - WHOLE_NUMBERS));
        }
        if constexpr (Grid::LIT)
            colors[k] = color;
        else
            colors[k] = mul(grid.color, color);
    }
    if constexpr (Grid::LIT) {
        // Rounding can leave a sum below zero; conversion to bytes clips.
        const auto at_least_none = [](float light) { return SHADED && (IMAGES & HDR) ? max(light, 0.0f) : light; };
        if (!Grid::GENERAL || plan.simple) {
#pragma unroll
            for (int k = 0; k < QUAD; ++k)
                colors[k] = at_least_none(light_at<SHADED>(grid, plan.bias, u[k], v[k], shadows >> 8 * k)) * colors[k];
        } else {
#pragma unroll
            for (int k = 0; k < QUAD; ++k) {
                const Vec3 light =
                    color_at<SHADED>(grid, plan.bias, grid.u.stretched(u[k]), grid.v.stretched(v[k]), shadows >> 8 * k);
                colors[k] =
                    mul(mul({ at_least_none(light.x), at_least_none(light.y), at_least_none(light.z) }, plan.gain),
                        colors[k]);
            }
        }
    }
    quad.fill(colors);
    return true;
}

// Bit mask of a lane's pixels that show a plane.
template <int BYTES> WARPCAM_DEVICE unsigned showing(const AlignedArray<unsigned, BYTES>& ids, int plane)
{
    constexpr unsigned MASK = BYTES == 4 ? FULL_WARP : (1u << 8 * (BYTES % 4)) - 1u;
    unsigned bits = 0;
#pragma unroll
    for (int k = 0; k < QUAD; ++k)
        bits |= (ids.at[k * BYTES / 4] >> k * BYTES * 8 % 32 & MASK) == (unsigned(plane) & MASK) ? 1u << k : 0u;
    return bits;
}

// Draws what a warp's strips show of the plane. Returns which of a lane's pixels are left, four bits a strip. MIPS: its
// texture is a mipmapped one, else in an atlas. WHOLE: all of the region is in the image; all or none of a lane's four
// pixels are. Pixels of `covered` tiles are left.
template <bool TEXTURED, bool MIPS, bool WHOLE, int IMAGES, int WIDTH, int HEIGHT, class Grid, class Covered,
          class Frame_, class Images_>
WARPCAM_DEVICE unsigned draw_strips(const StripPlan& plan, const Grid& grid, const Covered& covered,
                                    const Frame_& frame, const Images_& images, const Region& region, unsigned corner,
                                    int warp, int lane, float* row_of_lanes)
{
    using Own = Strips<WIDTH, HEIGHT>;
    const int column = Own::column(warp, lane);
    const StripColumn own = strip_column(plan, float(region.left + column));
    const unsigned first = corner + unsigned(Own::row(warp, lane, 0) * frame.width + column);
    const unsigned step = unsigned(Own::row(0, 0, 1) * frame.width);
    // Of the image, from the warp's first pixel on.
    const int columns = frame.width - region.left - Own::column(warp, 0);
    const int rows = frame.height - region.top - Own::row(warp, 0, 0);
    const int own_rows = lane % TILE_WIDTH * QUAD < columns ? rows - lane / TILE_WIDTH : 0;
    const auto inside = [&](int strip) { return WHOLE || Own::row(0, 0, strip) < own_rows; };
    AlignedArray<unsigned, sizeof(*frame.shape.data)> ids {};
    unsigned dark = 0u, left = 0u;
    const auto ask_for = [&](int strip) {
        if (!inside(strip))
            return;
        const unsigned at = first + unsigned(strip) * step;
        ids = load4(frame.shape.data + at);
        if (Grid::SHADOWS)
            dark = *reinterpret_cast<const unsigned*>(frame.shadow.data + at);
    };
    // Twelve bytes of each lane, stored by sixteen.
    const int piece_row = lane / 6, piece = lane % 6;
    const unsigned highest = corner + unsigned(Own::row(warp, 0, 0) * frame.width + Own::column(warp, 0));
    const unsigned stored = highest + unsigned(piece_row * frame.width);
    ask_for(0);
#pragma unroll 1
    for (int strip = 0; strip < Own::EACH; ++strip) {
        const unsigned all = inside(strip) ? 15u : 0u, shadow = dark;
        const unsigned on = covered.has(column, Own::row(warp, lane, strip)) ? 0u : showing(ids, grid.shape) & all;
        if (strip + 1 < Own::EACH)  // ask for the next strip's pixels before this one's are drawn
            ask_for(strip + 1);
        const float row = float(region.top + Own::row(warp, lane, strip));
        Quad<IMAGES> quad {};
        bool drawn = false;
        if (Grid::SHADOWS && warp_any(on && shadow)) {
            if (on)
                drawn = draw_quad<TEXTURED, MIPS, true>(plan, grid, own, row, shadow, quad);
        } else if (on) {
            drawn = draw_quad<TEXTURED, MIPS, false>(plan, grid, own, row, 0u, quad);
        }
        left |= (drawn ? ~on & all : all) << 4 * strip;
        if (warp_any(drawn)) {
            const unsigned down = unsigned(strip) * step;
            const ImagePart part { columns, rows - Own::row(0, 0, strip) };
            store_quads<WHOLE>(images, quad, drawn, first + down, stored + down, piece, highest + down, part,
                               frame.width, lane, row_of_lanes);
        }
    }
    return left;
}

// Lists the pixels that a warp's lanes have left, strip after strip; `count` is the block's.
template <int EACH> WARPCAM_DEVICE void list_pixels(unsigned short* list, int& count, unsigned left, int warp, int lane)
{
    const int total = warp_reduce_add(__popc(left));
    if (total == 0)
        return;
    int place = __shfl_sync(FULL_WARP, lane == 0 ? atomicAdd(&count, total) : 0, 0);
    const unsigned before = (1u << lane) - 1u;
#pragma unroll 1
    for (int strip = 0; strip < EACH; ++strip) {
        const unsigned mine = left >> 4 * strip & 15u;
        if (!warp_any(mine))
            continue;
        int own = place;
#pragma unroll
        for (int k = 0; k < QUAD; ++k) {
            const unsigned lanes = __ballot_sync(FULL_WARP, mine >> k & 1u);
            own += __popc(lanes & before);
            place += __popc(lanes);
        }
#pragma unroll
        for (int k = 0; k < QUAD; ++k)
            if (mine >> k & 1u)
                list[own++] = static_cast<unsigned short>(((warp * EACH + strip) * WARP_SIZE + lane) * QUAD + k);
    }
}

// Draws a region: the plane by strips, then what they leave, 32 pixels at once, with `draw`. `list`: room for all of
// them, which may be that of the grid's values.
template <bool TEXTURED, bool MIPS, bool WHOLE, int IMAGES, int WIDTH, int HEIGHT, class Grid, class Covered,
          class Frame_, class Images_, class Draw>
WARPCAM_DEVICE void draw_by_strips(StripPlan& plan, unsigned short* list, Grid& grid, const Covered& covered,
                                   const Frame_& frame, const Images_& images, const Region& region, unsigned first,
                                   int warp, Pixel& pixel, const Draw& draw)
{
    using Own = Strips<WIDTH, HEIGHT>;
    const bool plain = plan.plain;
    if (plain) {
        const unsigned corner = first + unsigned(region.top * frame.width + region.left);
        const unsigned left =
            TEXTURED && grid.view.count > 0
                ? draw_strips<TEXTURED, MIPS, WHOLE, IMAGES, WIDTH, HEIGHT>(
                      plan, grid, covered, frame, images, region, corner, warp, pixel.lane, pixel.row_of_lanes)
                : draw_strips<false, false, WHOLE, IMAGES, WIDTH, HEIGHT>(plan, grid, covered, frame, images, region,
                                                                          corner, warp, pixel.lane, pixel.row_of_lanes);
        block_sync();  // what is stored may be stored again, and no corner is asked for any more
        if (threadIdx.x == 0)
            grid.shape = -1;
        list_pixels<Own::EACH>(list, plan.count, left, warp, pixel.lane);
        block_sync();
    }
    const int count = plain ? plan.count : WIDTH * HEIGHT;
    pixel.inside = true;
#pragma unroll 1
    while (true) {
        const int start = WARP_SIZE * __shfl_sync(FULL_WARP, pixel.lane == 0 ? draw_next(plan.next) : 0, 0);
        if (start >= count)
            return;
        int column, row;
        if (plain) {
            const int number = list[min(start + pixel.lane, count - 1)], strip = number / (QUAD * WARP_SIZE);
            const int lane = number / QUAD % WARP_SIZE;
            column = Own::column(strip / Own::EACH, lane) + number % QUAD;
            row = Own::row(strip / Own::EACH, lane, strip % Own::EACH);
        } else {
            const int tile = start / WARP_SIZE;
            column = tile % (WIDTH / TILE_WIDTH) * TILE_WIDTH + pixel.lane % TILE_WIDTH;
            row = tile / (WIDTH / TILE_WIDTH) * TILE_HEIGHT + pixel.lane / TILE_WIDTH;
        }
        pixel.column = region.left + column;
        pixel.row = region.top + row;
        pixel.at = first + pixel.row * frame.width + pixel.column;
        if constexpr (!WHOLE) {
            pixel.inside = pixel.column < frame.width && pixel.row < frame.height;
            if (!warp_any(pixel.inside))
                continue;
        }
        draw(pixel);
    }
}

#endif

}  // namespace warpcam
