// Height fields on a CPU: the walk of accel/heightfield.h for eight rays of a tile at once.
#pragma once
#include "core/simd8.h"
#include "accel/heightfield.h"

namespace warpcam {

struct Planes {
    Float8 height, rise_x, rise_y, fold;
};

inline Planes gather_planes(const float* cells, Int8 at)
{
    const Float8x4 four = gather_float4(cells, at);
    return { four.a, four.b, four.c, four.d };
}

inline Float8 line_of(Int8 code) { return (Float8)code - INDEX_BASE; }

// Axis for a packet of rays.
struct Axes {
    Float8 start, speed, wait, offset, ahead, first;
    Int8 last, flip;

    Axes(Float8 origin, Float8 direction, float cells)
    {
        flip = direction < 0.0f;
        first = flip ? (Float8)-cells : (Float8)0.0f;
        last = (Int8)(first + (cells - 1.0f + INDEX_BASE));
        start = flip ? -origin : origin;
        speed = max(abs(direction), (Float8)1.0e-18f);
        wait = 1.0f / speed;
        offset = fma(-start, wait, wait);
        ahead = start + 5.0e-7f * (abs(start) + cells);
    }
    Float8 leaves(Float8 line) const { return fma(line, wait, offset); }
    Int8 cell(Float8 t) const
    {
        const Int8 code = (Int8)(__builtin_elementwise_floor(fma(t, speed, ahead)) + INDEX_BASE);
        return code < last ? code : last;
    }
    Float8 place(Float8 t, Int8 code) const
    {
        const Float8 along = fma(t, speed, start) - line_of(code);
        return flip ? 1.0f - along : along;
    }
    Float8 direction() const { return flip ? -speed : speed; }
};

struct RayPacket {
    Float8 ox, oy, oz, dx, dy, dz;  // in the field's frame
};

struct PacketHit {
    Float8 depth;
    Int8 met, face;  // met: true where the field was
};

// Walks a height field with a packet of rays; comments in walk_height_field() apply.
template <class HeightFields>
WARPCAM_NOINLINE_CPU inline void walk_packet(const HeightFields& fields, const ShapeRecord& record,
                                             const RayPacket& ray, Float8 near, PacketHit& hit)
{
    const Float3Int scale = load(fields.grids.data, 2 * record.axis_z.w);
    const Float3Int grid = load(fields.grids.data, 2 * record.axis_z.w + 1);
    const int columns = as_int(grid.x), rows = as_int(grid.y), levels = scale.w;
    const float top = scale.z, base = record.size.z;
    const float* const peaks = fields.peaks.data + as_int(grid.z);
    const float* const cells = reinterpret_cast<const float*>(fields.cells.data) + 4 * size_t(unsigned(grid.w));

    const float along_x = float(columns), along_y = float(rows);
    const Axes x(fma(ray.ox, (Float8)scale.x, (Float8)(0.5f * along_x)), ray.dx * scale.x, along_x);
    const Axes y(fma(ray.oy, (Float8)scale.y, (Float8)(0.5f * along_y)), ray.dy * scale.y, along_y);
    const Float8 enter = max(x.leaves(x.first - 1.0f), y.leaves(y.first - 1.0f));
    const Float8 t_far = min(x.leaves(x.first + (along_x - 1.0f)), y.leaves(y.first + (along_y - 1.0f)));
    const Float8 oz = ray.oz, dz = ray.dz;
    const Int8 falls = dz < 0.0f;
    const Float8 rate = 1.0f / (abs(dz) < 1.0e-18f ? (Float8)1.0e-18f : dz);
    const Float8 level_at = -oz * rate;
    const Float8 lid = (top + 2.0e-6f * (abs(oz) + abs(top)) - oz) * rate;
    const Float8 floor = (-base - oz) * rate;
    const Int8 below =
        (dz > 0.0f) & (floor > enter) & (floor <= min(t_far, lid)) & (floor > near) & (floor < hit.depth);
    hit.depth = below ? floor : hit.depth;
    hit.met |= below;
    hit.face = below ? (Int8)-1 : hit.face;

    const Float8 begin = max(max(enter, near), falls ? lid : near);
    const Float8 end = min(min(t_far, hit.depth), falls ? t_far : lid);
    Int8 walks = begin < end;
    if (!any(walks))
        return;

    const int pitch = (columns + 1) >> 1;
    const Int8 row_bits = y.flip ^ 1 << levels;
    const Float8 fall = falls ? rate : (Float8)0.0f, fall_at = falls ? level_at : (Float8)-MISS;
    const Float8 dx = x.direction(), dy = y.direction(), turn = dx - dy, unturn = -1.0f / turn;
    const Int8 over_base = dz > 0.0f ? ~(floor > enter) : (Int8)(fma(begin, dz, oz) >= -base);
    const Int8 by_side = (begin == enter) & (enter > near) & over_base;
    Float8 t = begin;
    Int8 i = x.cell(t), j = y.cell(t);
    Int8 level = (Int8)min(FIRST_LEVEL, ((levels + 1) & ~1) - 1);
    Int8 above = -1;
    while (true) {
        for (Int8 high = walks & (level != CELLS); any(high); high = high & (level != CELLS) & (t < end)) {
            const Int8 shift = level & 31, beyond = ~(~(Int8)0 << shift);
            const Float8 leave_x = x.leaves(line_of(i | beyond)), leave_y = y.leaves(line_of(j | beyond));
            const Float8 next = min(min(leave_x, leave_y), end);
            const Int8 row = ((j ^ row_bits) & INDEX) >> shift, column = ((i ^ x.flip) & INDEX) >> shift;
            const Float8 peak = build_shape_list(peaks, high ? row * pitch + column : 0);
            const Int8 clear = fma(falls ? next : t, dz, oz) > peak;
            const Float8 onto = clear ? next : max(t, min(fma(peak, fall, fall_at), next));
            t = high ? onto : t;
            const Int8 to_x = x.cell(t), to_y = y.cell(t);
            const Int8 left = (((to_x ^ i) | (to_y ^ j)) & ~beyond << LEVEL_STEP) != 0;
            const Int8 higher = left ? level + LEVEL_STEP : level;
            level = high ? (clear ? higher : level - LEVEL_STEP) : level;
            i = to_x;
            j = to_y;
        }
        walks &= t < end;
        if (!any(walks))
            return;
        const Float8 next = min(min(x.leaves(line_of(i)), y.leaves(line_of(j))), end);
        const Int8 cell = walks ? ((j ^ y.flip) & INDEX) * columns + ((i ^ x.flip) & INDEX) : 0;
        const Planes plane = gather_planes(cells, cell);
        const Float8 u = x.place(t, i), v = y.place(t, j), side = u - v;
        const Float8 span = next - t, to_fold = side * unturn;
        const Int8 split = (to_fold > 0.0f) & (to_fold < span);
        const Float8 middle = split ? to_fold : span;
        const Float8 gap = fma(t, dz, oz) - plane.height - u * plane.rise_x - v * plane.rise_y;
        const Float8 closing = dz - dx * plane.rise_x - dy * plane.rise_y;
        const Float8 gap_begin = gap - plane.fold * max(side, (Float8)0.0f);
        const Float8 gap_end = gap + closing * span - plane.fold * max(side + turn * span, (Float8)0.0f);
        const Float8 gap_middle = split ? gap + closing * middle : gap_end;
        const Int8 starts = walks & (t == begin);
        above = starts ? gap_begin > 0.0f : above;
        const Int8 at_side = starts & ~above & by_side;
        const Int8 in_first = above & ~(gap_middle > 0.0f);
        const Int8 in_second = (gap_middle > 0.0f) & ~(gap_end > 0.0f);
        const Int8 ends = walks & (at_side | in_first | in_second);
        if (any(ends)) {
            const Float8 from = in_first ? (Float8)0.0f : middle, length = in_first ? middle : span - middle;
            const Float8 a = in_first ? max(gap_begin, (Float8)0.0f) : gap_middle;
            const Float8 b = in_first ? gap_middle : gap_end;
            const Float8 into = t + from + length * a / max(a - b, (Float8)1.0e-30f);
            const Float8 depth = at_side ? begin : into;
            const Int8 closer = ends & (at_side | (depth < hit.depth));
            const Int8 face = 2 * cell + 1 + (side + turn * (from + 0.5f * length) > 0.0f);
            hit.depth = closer ? depth : hit.depth;
            hit.met |= closer;
            hit.face = closer ? (at_side ? (Int8)-1 : face) : hit.face;
            walks &= ~ends;
        }
        above = gap_end > 0.0f;
        t = walks ? next : t;
        const Int8 to_x = x.cell(t), to_y = y.cell(t);
        const Int8 left = (((to_x ^ i) | (to_y ^ j)) & CELL_BLOCK) != 0;
        level = above & left ? (Int8)(CELLS + LEVEL_STEP) : (Int8)CELLS;
        i = to_x;
        j = to_y;
        walks &= t < end;
    }
}

template <int LENS, class HeightFields, class Near, class Rays>
inline void trace_height_field(const HeightFields& fields, const ShapeRecord& record, const Near& near, Rays& rays)
{
    const Float3Int ax = record.axis_x, ay = record.axis_y, az = record.axis_z, o = record.origin;
    for (int lane = 0; lane < WARP_SIZE; lane += SIMD_WIDTH) {
        Float8 x, y, nears;
        PacketHit hit { {}, 0, 0 };
        Int8 shape, face;
        for (int k = 0; k < SIMD_WIDTH; ++k)
            nears[k] = near.at(lane + k);
        __builtin_memcpy(&x, rays.x + lane, sizeof x);
        __builtin_memcpy(&y, rays.y + lane, sizeof y);
        __builtin_memcpy(&hit.depth, rays.depth + lane, sizeof hit.depth);
        const Float8 across_x = ax.x * x + ax.y * y, across_y = ay.x * x + ay.y * y, across_z = az.x * x + az.y * y;
        RayPacket ray = LENS == ORTHOGRAPHIC
                            ? RayPacket { o.x + across_x, o.y + across_y, o.z + across_z, -ax.z, -ay.z, -az.z }
                            : RayPacket { o.x, o.y, o.z, across_x - ax.z, across_y - ay.z, across_z - az.z };
        if constexpr (LENS == RAYS) {
            const Float8 rate = 2.0f / (1.0f + x * x + y * y), back = 1.0f - rate;
            ray = { o.x,
                    o.y,
                    o.z,
                    rate * across_x + back * ax.z,
                    rate * across_y + back * ay.z,
                    rate * across_z + back * az.z };
        }
        if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
            for (int k = 0; k < SIMD_WIDTH; ++k) {
                const Ray one = CameraRay<LENS> { x[k], y[k] }.local(record);
                ray.ox[k] = one.origin.x;
                ray.oy[k] = one.origin.y;
                ray.oz[k] = one.origin.z;
                ray.dx[k] = one.direction.x;
                ray.dy[k] = one.direction.y;
                ray.dz[k] = one.direction.z;
            }
        walk_packet(fields, record, ray, nears, hit);
        __builtin_memcpy(&shape, rays.shape + lane, sizeof shape);
        __builtin_memcpy(&face, rays.face + lane, sizeof face);
        shape = hit.met ? (Int8)record.axis_y.w : shape;
        face = hit.met ? hit.face : face;
        __builtin_memcpy(rays.depth + lane, &hit.depth, sizeof hit.depth);
        __builtin_memcpy(rays.shape + lane, &shape, sizeof shape);
        __builtin_memcpy(rays.face + lane, &face, sizeof face);
    }
}

}  // namespace warpcam
