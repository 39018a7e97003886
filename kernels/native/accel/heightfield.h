// Height fields: a column of ground under a grid of heights. Sides and base are a box; the top is walked cell by cell,
// and in large steps where the ray runs above all that is near.
#pragma once
#include "accel/bvh4.h"
#include "core/vec3.h"

namespace warpcam {

// The walk's levels are CELLS, 1, 3, 5, ...; on the others it meets blocks of 2^level cells a side.
constexpr int CELLS = -1, LEVEL_STEP = 2, FIRST_LEVEL = 5;
// From cell to cell the walk stays among cells until it leaves a block of 8 a side: next to the ground more cells are.
constexpr int CELL_BLOCK = ~7;

// A cell's index along an axis is kept as the bits of the float INDEX_BASE + index, which costs no conversion either
// way: the integer pipe is the narrow one here.
constexpr float INDEX_BASE = 12582912.0f;  // 1.5 * 2^23
constexpr int INDEX = 0x3fffff;       // the bits of an index, also of a negative one that was inverted

WARPCAM_DEVICE int whole_below(float a)
{
#if defined(__CUDA_ARCH__)
    return __float_as_int(__fadd_rd(a, INDEX_BASE));
#else
    return as_int(INDEX_BASE) + int(a) - (float(int(a)) > a ? 1 : 0);
#endif
}

WARPCAM_DEVICE float line_of(int code) { return as_float(code) - INDEX_BASE; }

// One axis of the grid as a ray meets it: mirrored where the ray runs against it, so that it goes through cells in
// ascending order. Cell i is then cell i ^ flip of the grid.
struct Axis {
    float start, speed;  // of the ray [cells], [cells per t]; speed is positive
    float wait, offset;  // the ray leaves cell i at t = i * wait + offset
    float ahead;         // start, and more than the rounding of a place on the ray [cells]
    float first, last;   // cells
    int flip;            // 0 or -1

    WARPCAM_DEVICE Axis(float origin, float direction, float cells)
    {
        flip = direction < 0.0f ? -1 : 0;
        first = flip ? -cells : 0.0f;
        last = first + (cells - 1.0f);
        start = flip ? -origin : origin;
        speed = max(abs(direction), 1.0e-18f);
        wait = rcp(speed);
        offset = fma(-start, wait, wait);
        ahead = start + 5.0e-7f * (abs(start) + cells);
    }
    WARPCAM_DEVICE float leaves(float line) const { return fma(line, wait, offset); }
    // The cell at t; past every cell that the ray has left by then.
    WARPCAM_DEVICE int cell(float t) const { return min(whole_below(fma(t, speed, ahead)), as_int(INDEX_BASE + last)); }
    // Place at t in the unmirrored cell, from 0 to 1.
    WARPCAM_DEVICE float place(float t, int code) const
    {
        const float along = fma(t, speed, start) - line_of(code);
        return flip ? 1.0f - along : along;
    }
    WARPCAM_DEVICE float direction() const { return flip ? -speed : speed; }
};

// Nearest front of the ground between `near` and the hit's depth.
//
// The ray takes along from cell to cell whether it is above ground, and hits where it is so no longer: however the
// borders of cells are rounded, it cannot slip through between them.
template <class HeightFields, class RayOf>
WARPCAM_DEVICE void walk_height_field(const HeightFields& fields, const ShapeRecord& record, const RayOf& source,
                                      float near, Hit& hit)
{
    const Float3Int scale = load(fields.grids.data, 2 * record.axis_z.w);
    const Float3Int grid = load(fields.grids.data, 2 * record.axis_z.w + 1);
    const int columns = as_int(grid.x), rows = as_int(grid.y), levels = scale.w, first_peak = as_int(grid.z);
    const float top = scale.z, base = record.size.z;

    const Ray ray = source.local(record);
    const Vec3 o = ray.origin, d = ray.direction;
    const float along_x = float(columns), along_y = float(rows);
    const Axis x(fma(o.x, scale.x, 0.5f * along_x), d.x * scale.x, along_x);
    const Axis y(fma(o.y, scale.y, 0.5f * along_y), d.y * scale.y, along_y);
    const float enter = max(x.leaves(x.first - 1.0f), y.leaves(y.first - 1.0f));
    const float t_far = min(x.leaves(x.last), y.leaves(y.last));
    const bool falls = d.z < 0.0f;
    const float rate = rcp(avoid_zero(d.z)), level_at = -o.z * rate;  // at height h when t = h * rate + level_at
    const float lid = (top + 2.0e-6f * (abs(o.z) + abs(top)) - o.z) * rate;
    if (d.z > 0.0f) {
        const float t = (-base - o.z) * rate;
        if (t > enter && t <= min(t_far, lid) && t > near && t < hit.depth) {
            hit.depth = t;
            hit.shape = record.axis_y.w;
            hit.face = -1;
        }
    }
    const float begin = max(max(enter, near), falls ? lid : near);
    const float end = min(min(t_far, hit.depth), falls ? t_far : lid);
    if (!(begin < end))
        return;

    const int pitch = (columns + 1) >> 1, row_bits = y.flip ^ 1 << levels;
    const float fall = falls ? rate : 0.0f, fall_at = falls ? level_at : -MISS;
    const float dx = x.direction(), dy = y.direction(), turn = dx - dy, unturn = -rcp(turn);
    float t = begin;
    int i = x.cell(t), j = y.cell(t);
    int level = min(FIRST_LEVEL, ((levels + 1) & ~1) - 1);
    bool above = true;
    while (true) {
        // down to the next cell, so that the lanes of a warp test their cells together
#pragma unroll 2
        while (level != CELLS && t < end) {
            const int block = int(~0u << level);
            const float leave_x = x.leaves(line_of(i | ~block)), leave_y = y.leaves(line_of(j | ~block));
            const float next = min(min(leave_x, leave_y), end);
            const int row = ((j ^ row_bits) & INDEX) >> level, column = ((i ^ x.flip) & INDEX) >> level;
            const float peak = fields.peaks.data[unsigned(row * pitch + column + first_peak)];
            const bool clear = fma(falls ? next : t, d.z, o.z) > peak;
            t = clear ? next : max(t, min(fma(peak, fall, fall_at), next));
            const int to_x = x.cell(t), to_y = y.cell(t);
            const bool left = ((to_x ^ i) | (to_y ^ j)) & block << LEVEL_STEP;
            if (!clear)
                level -= LEVEL_STEP;
            else if (left)
                level += LEVEL_STEP;
            i = to_x;
            j = to_y;
        }
        if (!(t < end))
            return;
        const float next = min(min(x.leaves(line_of(i)), y.leaves(line_of(j))), end);
        const int cell = ((j ^ y.flip) & INDEX) * columns + ((i ^ x.flip) & INDEX);
        // The height is h + u * rise_x + v * rise_y, and where u > v also fold * (u - v).
        const Float3Int plane = load(fields.cells.data, unsigned(grid.w + cell));
        const float h = plane.x, rise_x = plane.y, rise_y = plane.z, fold = as_float(plane.w);
        const float u = x.place(t, i), v = y.place(t, j), side = u - v;
        const float span = next - t, to_fold = side * unturn;
        const bool split = to_fold > 0.0f && to_fold < span;
        const float middle = split ? to_fold : span;
        const float gap = fma(t, d.z, o.z) - h - u * rise_x - v * rise_y;  // above the part of u < v
        const float closing = d.z - dx * rise_x - dy * rise_y;
        const float gap_begin = gap - fold * max(side, 0.0f);
        const float gap_end = gap + closing * span - fold * max(side + turn * span, 0.0f);
        const float gap_middle = split ? gap + closing * middle : gap_end;
        if (t == begin) {
            above = gap_begin > 0.0f;
            // Entry through the base is asked by the same expression as above, so that no ray is lost between base and
            // side.
            const bool over_base =
                d.z > 0.0f ? !((-base - o.z) * rcp(avoid_zero(d.z)) > enter) : fma(begin, d.z, o.z) >= -base;
            if (!above && begin == enter && enter > near && over_base) {  // at a side
                hit.depth = begin;
                hit.shape = record.axis_y.w;
                hit.face = -1;
                return;
            }
        }
        const bool in_first = above && !(gap_middle > 0.0f), in_second = gap_middle > 0.0f && !(gap_end > 0.0f);
        if (in_first || in_second) {
            const float from = in_first ? 0.0f : middle, length = in_first ? middle : span - middle;
            const float a = in_first ? max(gap_begin, 0.0f) : gap_middle, b = in_first ? gap_middle : gap_end;
            const float depth = t + from + length * a * rcp(max(a - b, 1.0e-30f));
            if (depth < hit.depth) {
                hit.depth = depth;
                hit.shape = record.axis_y.w;
                hit.face = 2 * cell + (side + turn * (from + 0.5f * length) > 0.0f ? 0 : 1);
            }
            return;
        }
        above = gap_end > 0.0f;
        t = next;
        const int to_x = x.cell(t), to_y = y.cell(t);
        const bool left = ((to_x ^ i) | (to_y ^ j)) & CELL_BLOCK;
        level = above && left ? CELLS + LEVEL_STEP : CELLS;
        i = to_x;
        j = to_y;
    }
}

// Tests whether a point, in the field's frame, is inside the ground: not above its top, beside it, or below its base.
template <class HeightFields>
WARPCAM_DEVICE bool in_ground(const HeightFields& fields, const ShapeRecord& record, Vec3 place)
{
    const Float3Int scale = load(fields.grids.data, 2 * record.axis_z.w);
    const Float3Int grid = load(fields.grids.data, 2 * record.axis_z.w + 1);
    const int columns = as_int(grid.x), rows = as_int(grid.y);
    const float x = fma(place.x, scale.x, 0.5f * float(columns)), y = fma(place.y, scale.y, 0.5f * float(rows));
    if (!(x >= 0.0f && x <= float(columns) && y >= 0.0f && y <= float(rows)))
        return false;
    if (!(place.z >= -record.size.z && place.z <= scale.z))
        return false;
    const int i = min(int(x), columns - 1), j = min(int(y), rows - 1);
    const Float3Int plane = load(fields.cells.data, unsigned(grid.w + j * columns + i));
    const float u = x - float(i), v = y - float(j);
    return place.z <= plane.x + u * plane.y + v * plane.z + as_float(plane.w) * max(u - v, 0.0f);
}

// Tests whether a ray that starts inside the ground, at `near`, leaves it before `far`. The walk finds front faces
// only.
template <class HeightFields> WARPCAM_DEVICE bool comes_out(const HeightFields& fields, const ShapeRecord& record,
                                                            const Ray& ray, float near, float far)
{
    return in_ground(fields, record, ray.origin + near * ray.direction)
           && !in_ground(fields, record, ray.origin + far * ray.direction);
}

}  // namespace warpcam
