// Height fields: a column of ground under a grid of heights. Sides and base are a box; the top is walked through a
// quadtree of lowest and highest heights, near blocks first.
#pragma once
#include "bvh4.h"

namespace warpcam {

// A block of the pyramid: its level (0 is the root, 12 at most) and its column and row in that level.
WARPCAM_FN int pack_block(int level, int column, int row) { return level << 26 | row << 13 | column; }

struct Grid {
    int columns, rows;        // cells
    float step_x, step_y;     // of one cell
    float start_x, start_y;   // of the first sample
    const float* heights;
    int stride;
};

WARPCAM_FN Corner grid_corner(const RayFrame& frame, const Grid& grid, int column, int row)
{
    return project(frame, muladd(float(column), grid.step_x, grid.start_x),
                   muladd(float(row), grid.step_y, grid.start_y), grid.heights[row * grid.stride + column]);
}

WARPCAM_FN float grid_height(const Grid& grid, float gx, float gy)
{
    const int column = int(lower(upper(gx, 0.0f), float(grid.columns) - 1.0e-3f));
    const int row = int(lower(upper(gy, 0.0f), float(grid.rows) - 1.0e-3f));
    const float u = gx - float(column), v = gy - float(row);
    const float* h = grid.heights + row * grid.stride + column;
    // the two triangles of a cell meet on the line from (column, row) to (column + 1, row + 1)
    return u > v ? h[0] + u * (h[1] - h[0]) + v * (h[grid.stride + 1] - h[1])
                 : h[0] + v * (h[grid.stride] - h[0]) + u * (h[grid.stride + 1] - h[grid.stride]);
}

// Sides and base, where the ray enters the box of the whole field below the ground.
WARPCAM_FN float enter_ground(const Grid& grid, Vec o, Vec d, float half_x, float half_y, float base, float top)
{
    const float ix = reciprocal(nonzero(d.x)), iy = reciprocal(nonzero(d.y)), iz = reciprocal(nonzero(d.z));
    const float x0 = (-half_x - o.x) * ix, x1 = (half_x - o.x) * ix;
    const float y0 = (-half_y - o.y) * iy, y1 = (half_y - o.y) * iy;
    const float z0 = (-base - o.z) * iz, z1 = (top - o.z) * iz;
    const float enter_xy = upper(lower(x0, x1), lower(y0, y1)), enter_z = lower(z0, z1);
    const float leave = lower(lower(upper(x0, x1), upper(y0, y1)), upper(z0, z1));
    const float enter = upper(enter_xy, enter_z);
    if (enter > leave)
        return FAR_AWAY;
    if (enter_z > enter_xy)
        return d.z > 0.0f ? enter : FAR_AWAY;  // through the base, or down through the box's lid
    const float x = o.x + enter * d.x, y = o.y + enter * d.y, z = o.z + enter * d.z;
    return z <= grid_height(grid, (x - grid.start_x) / grid.step_x, (y - grid.start_y) / grid.step_y) ? enter
                                                                                                    : FAR_AWAY;
}

// The ray over a height field's blocks: times at which it crosses lines of the grid, and heights along it. The grid is
// mirrored where the ray runs against an axis, so that it always meets lower columns and rows first.
struct GridRay {
    float start_x, start_y;  // of the ray [cells]
    float per_x, per_y;      // t per cell, positive
    float pad_x, pad_y;      // t; more than the rounding of a crossing
    float low, high, slope;  // height(t) lies between low and high + t * slope
    bool falls;

    // Does the ray between two times come near heights between low and high?
    WARPCAM_FN bool meets(Pair bound, float enter, float leave) const
    {
        const float bottom = low + (falls ? leave : enter) * slope, top = high + (falls ? enter : leave) * slope;
        return enter <= leave && bottom <= bound.y && top >= bound.x;
    }
};

// Blocks above a level: (4^level - 1) / 3.
WARPCAM_FN int blocks_above(int level) { return 0x55555555 & ((1 << 2 * level) - 1); }

template <class HeightFields, class RayOf>
WARPCAM_FN void walk_height_field(const HeightFields& fields, const Record& record, const RayOf& source, float near,
                                  Hit& hit)
{
    const int asset = record.axis_z.w;
    const int levels = wp::index(fields.levels, asset);
    const Pair* bounds = reinterpret_cast<const Pair*>(fields.bounds.data) + wp::index(fields.bound_start, asset);
    const float half_x = record.size.x, half_y = record.size.y, base = record.size.z;
    Grid grid;
    grid.stride = wp::index(fields.columns, asset);
    grid.columns = grid.stride - 1;
    grid.rows = wp::index(fields.rows, asset) - 1;
    const float cells_x = float(grid.columns), cells_y = float(grid.rows);
    grid.step_x = 2.0f * half_x * reciprocal(cells_x);
    grid.step_y = 2.0f * half_y * reciprocal(cells_y);
    grid.start_x = -half_x;
    grid.start_y = -half_y;
    grid.heights = fields.heights.data + wp::index(fields.height_start, asset);

    const Ray ray = source.local(record);
    const Vec o = ray.origin, d = ray.direction;
    const Pair whole = bounds[0];
    const float ground = enter_ground(grid, o, d, half_x, half_y, base, whole.y);
    if (ground > near && ground < hit.depth) {
        hit.depth = ground;
        hit.shape = record.axis_y.w;
        hit.face = -1;
    }

    const bool flip_x = d.x < 0.0f, flip_y = d.y < 0.0f;
    const float cells = float(1 << (levels - 1));
    GridRay g;
    g.start_x = (o.x + half_x) * reciprocal(grid.step_x);
    g.start_y = (o.y + half_y) * reciprocal(grid.step_y);
    g.start_x = flip_x ? cells - g.start_x : g.start_x;
    g.start_y = flip_y ? cells - g.start_y : g.start_y;
    g.per_x = grid.step_x * reciprocal(upper(magnitude(d.x), 1.0e-18f));
    g.per_y = grid.step_y * reciprocal(upper(magnitude(d.y), 1.0e-18f));
    g.pad_x = 4.0e-6f * (magnitude(g.start_x) + cells) * g.per_x;
    g.pad_y = 4.0e-6f * (magnitude(g.start_y) + cells) * g.per_y;
    const float pad_z = 2.0e-6f * (magnitude(o.z) + magnitude(whole.y) + base);
    g.low = o.z - pad_z;
    g.high = o.z + pad_z;
    g.slope = d.z;
    g.falls = d.z < 0.0f;

    int stack[STACK];
    int height = 0, block = pack_block(0, 0, 0);
    const int cell = pack_block(levels - 1, 0, 0);  // codes from here on are cells
    while (block >= 0) {
        // down to the next cell, so that the lanes of a warp test their cells together
        while (block >= 0 && block < cell) {
            const int level = block >> 26, column = block & 0x1fff, row = block >> 13 & 0x1fff;
            const float span = float(1 << (levels - 1 - level));  // cells a side
            const float x0 = (float(column) * span - g.start_x) * g.per_x, x1 = x0 + span * g.per_x;
            const float y0 = (float(row) * span - g.start_y) * g.per_y, y1 = y0 + span * g.per_y;
            const float enter = upper(upper(x0 - g.pad_x, y0 - g.pad_y), near);
            const float leave = lower(lower(x1 + g.pad_x, y1 + g.pad_y), hit.depth);
            // the ray crosses the block's two middle lines, and so at most three of its quarters
            const float mx = 0.5f * (x0 + x1), my = 0.5f * (y0 + y1);
            const int side = 2 << level;
            const int first = pack_block(level + 1, 2 * column, 2 * row);
            const Pair* quarter = bounds + blocks_above(level + 1)
                + ((2 * row) ^ (flip_y ? side - 1 : 0)) * side + ((2 * column) ^ (flip_x ? side - 1 : 0));
            const int next_x = flip_x ? -1 : 1, next_y = flip_y ? -side : side;
            block = -1;
            const auto visit = [&](int dx, int dy, float from, float to) {
                const bool met = g.meets(quarter[dy * next_y + dx * next_x], upper(enter, from), lower(leave, to));
                if (met && block >= 0)
                    stack[height++] = block;
                block = met ? first + dx + (dy << 13) : block;
            };
            visit(1, 1, upper(mx - g.pad_x, my - g.pad_y), leave);
            visit(1, 0, mx - g.pad_x, my + g.pad_y);
            visit(0, 1, my - g.pad_y, mx + g.pad_x);
            visit(0, 0, enter, lower(mx + g.pad_x, my + g.pad_y));
            if (block < 0 && height > 0)
                block = stack[--height];
        }
        if (block >= 0) {
            const int last = (1 << (levels - 1)) - 1;
            const int column = flip_x ? last - (block & 0x1fff) : block & 0x1fff;
            const int row = flip_y ? last - (block >> 13 & 0x1fff) : block >> 13 & 0x1fff;
            const RayFrame frame = source.frame(record);
            const Corner p00 = grid_corner(frame, grid, column, row), p10 = grid_corner(frame, grid, column + 1, row);
            const Corner p11 = grid_corner(frame, grid, column + 1, row + 1);
            const Corner p01 = grid_corner(frame, grid, column, row + 1);
            const float below = enter_triangle(frame, p00, p10, p11), above = enter_triangle(frame, p00, p11, p01);
            const float t = lower(below > near ? below : FAR_AWAY, above > near ? above : FAR_AWAY);
            if (t < hit.depth) {
                hit.depth = t;
                hit.shape = record.axis_y.w;
                hit.face = 2 * (row * grid.columns + column) + (below > near && below <= above ? 0 : 1);
            }
        }
        block = height > 0 ? stack[--height] : -1;
    }
}

}  // namespace warpcam
