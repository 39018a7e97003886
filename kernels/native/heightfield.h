// Height fields: a column of ground under a grid of heights. Sides and base are a box; the top is walked cell by cell,
// and in large steps where the ray runs above all that is near.
#pragma once
#include "bvh4.h"

namespace warpcam {

// The walk's levels are CELLS, 1, 3, 5, ...; on the others it meets blocks of 2^level cells a side.
constexpr int CELLS = -1, LEVEL_STEP = 2, FIRST_LEVEL = 5;

WARPCAM_FN int upper_int(int a, int b) { return a > b ? a : b; }

WARPCAM_FN int round_down(float a)
{
#if defined(__CUDA_ARCH__)
    return __float2int_rd(a);
#else
    return int(a) - (float(int(a)) > a ? 1 : 0);
#endif
}

// One axis of the grid as a ray meets it: mirrored where the ray runs against it, so that it goes through cells in
// ascending order. Cell i is then cell i ^ flip of the grid.
struct Axis {
    float start, speed;  // of the ray [cells], [cells per t]; speed is not negative
    float wait, offset;  // the ray crosses line i at t = i * wait + offset
    int flip;            // 0 or -1
    int last;            // cell

    WARPCAM_FN Axis(float origin, float direction, int cells)
    {
        flip = direction < 0.0f ? -1 : 0;
        last = flip ? -1 : cells - 1;
        start = flip ? -origin : origin;
        speed = magnitude(direction);
        wait = reciprocal(upper(speed, 1.0e-18f));
        offset = -product(start, wait);
    }
    WARPCAM_FN float crossing(int line) const { return muladd(float(line), wait, offset); }
    // The cell at t, not before one that the ray is known to have reached.
    WARPCAM_FN int cell(float t, int reached) const
    {
        return lower_int(upper_int(round_down(muladd(t, speed, start)), reached), last);
    }
    // Position at t in the unmirrored grid, from the lower line of cell i.
    WARPCAM_FN float place(float t, int i) const
    {
        const float along = muladd(t, speed, start);
        return (flip ? -along : along) - float(i ^ flip);
    }
    WARPCAM_FN float direction() const { return flip ? -speed : speed; }
};

// Nearest front of the ground between `near` and the hit's depth.
//
// The ray takes along from cell to cell whether it is above ground, and hits where it is so no longer: however the
// borders of cells are rounded, it cannot slip through between them.
template <class HeightFields, class RayOf>
WARPCAM_FN void walk_height_field(const HeightFields& fields, const Record& record, const RayOf& source, float near,
                                  Hit& hit)
{
    const Row scale = load(fields.grids.data, 2 * record.axis_z.w);
    const Row grid = load(fields.grids.data, 2 * record.axis_z.w + 1);
    const int columns = as_int(grid.x), rows = as_int(grid.y), levels = scale.w;
    const float top = scale.z, base = record.size.z;

    const Ray ray = source.local(record);
    const Vec o = ray.origin, d = ray.direction;
    const Axis x(muladd(o.x, scale.x, 0.5f * float(columns)), d.x * scale.x, columns);
    const Axis y(muladd(o.y, scale.y, 0.5f * float(rows)), d.y * scale.y, rows);
    const float enter = upper(x.crossing(x.last + 1 - columns), y.crossing(y.last + 1 - rows));
    const float leave = lower(x.crossing(x.last + 1), y.crossing(y.last + 1));
    const bool falls = d.z < 0.0f;
    const float rate = reciprocal(nonzero(d.z)), level_at = -o.z * rate;  // at height h when t = h * rate + level_at
    const float lid = (top + 2.0e-6f * (magnitude(o.z) + magnitude(top)) - o.z) * rate;
    if (d.z > 0.0f) {
        const float t = (-base - o.z) * rate;
        if (t > enter && t <= lower(leave, lid) && t > near && t < hit.depth) {
            hit.depth = t;
            hit.shape = record.axis_y.w;
            hit.face = -1;
        }
    }
    const float begin = upper(upper(enter, near), falls ? lid : near);
    const float end = lower(lower(leave, hit.depth), falls ? leave : lid);
    if (!(begin < end))
        return;

    const float* peaks = fields.peaks.data + as_int(grid.z);
    const int pitch = (columns + 1) / 2, all = 1 << levels;
    const float fall = falls ? rate : 0.0f, fall_at = falls ? level_at : -FAR_AWAY;
    const float dx = x.direction(), dy = y.direction(), turn = dx - dy, unturn = -reciprocal(turn);
    float t = begin;
    int i = x.cell(t, x.last + 1 - columns), j = y.cell(t, y.last + 1 - rows);
    int level = lower_int(FIRST_LEVEL, ((levels + 1) & ~1) - 1);
    const bool at_side = begin == enter && enter > near && muladd(begin, d.z, o.z) >= -base;
    bool above = true;
    while (true) {
        // down to the next cell, so that the lanes of a warp test their cells together
        while (level != CELLS && t < end) {
            const int inner = (1 << level) - 1, edge_x = (i | inner) + 1, edge_y = (j | inner) + 1;
            const float next_x = x.crossing(edge_x), next_y = y.crossing(edge_y);
            const float next = lower(lower(next_x, next_y), end);
            const int row = ((j ^ y.flip) | all) >> level, column = (i ^ x.flip) >> level;
            const float peak = peaks[unsigned(row * pitch + column)];
            const bool clear = muladd(falls ? next : t, d.z, o.z) > peak;
            t = clear ? next : upper(t, lower(muladd(peak, fall, fall_at), next));
            const int to_x = x.cell(t, t >= next_x ? edge_x : i), to_y = y.cell(t, t >= next_y ? edge_y : j);
            const unsigned left = unsigned((to_x ^ i) | (to_y ^ j)) >> (level + LEVEL_STEP);
            level += !clear ? -LEVEL_STEP : left ? LEVEL_STEP : 0;
            i = to_x;
            j = to_y;
        }
        if (!(t < end))
            return;
        const float next_x = x.crossing(i + 1), next_y = y.crossing(j + 1);
        const float next = upper(lower(lower(next_x, next_y), end), t);
        const int cell = (j ^ y.flip) * columns + (i ^ x.flip);
        // The height is h + u * rise_x + v * rise_y, and where u > v also fold * (u - v).
        const Row plane = load(fields.cells.data, unsigned(grid.w + cell));
        const float h = plane.x, rise_x = plane.y, rise_y = plane.z, fold = as_float(plane.w);
        const float u = x.place(t, i), v = y.place(t, j), side = u - v;
        const float span = next - t, to_fold = side * unturn;
        const bool split = to_fold > 0.0f && to_fold < span;
        const float middle = split ? to_fold : span;
        const float gap = muladd(t, d.z, o.z) - h - u * rise_x - v * rise_y;  // above the part of u < v
        const float closing = d.z - dx * rise_x - dy * rise_y;
        const float gap_begin = gap - fold * upper(side, 0.0f);
        const float gap_end = gap + closing * span - fold * upper(side + turn * span, 0.0f);
        const float gap_middle = split ? gap + closing * middle : gap_end;
        if (t == begin) {
            above = gap_begin > 0.0f;
            if (!above && at_side) {
                hit.depth = begin;
                hit.shape = record.axis_y.w;
                hit.face = -1;
                return;
            }
        }
        const bool in_first = above && !(gap_middle > 0.0f), in_second = gap_middle > 0.0f && !(gap_end > 0.0f);
        if (in_first || in_second) {
            const float from = in_first ? 0.0f : middle, length = in_first ? middle : span - middle;
            const float a = in_first ? upper(gap_begin, 0.0f) : gap_middle, b = in_first ? gap_middle : gap_end;
            const float depth = t + from + length * a * reciprocal(upper(a - b, 1.0e-30f));
            if (depth < hit.depth) {
                hit.depth = depth;
                hit.shape = record.axis_y.w;
                hit.face = 2 * cell + (side + turn * (from + 0.5f * length) > 0.0f ? 0 : 1);
            }
            return;
        }
        above = gap_end > 0.0f;
        t = next;
        const int to_x = x.cell(t, t >= next_x ? i + 1 : i), to_y = y.cell(t, t >= next_y ? j + 1 : j);
        const unsigned left = unsigned((to_x ^ i) | (to_y ^ j)) >> (CELLS + LEVEL_STEP);
        level = above && left ? CELLS + LEVEL_STEP : CELLS;
        i = to_x;
        j = to_y;
    }
}

}  // namespace warpcam
