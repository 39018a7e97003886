// Height fields on a CPU: the walk of accel/heightfield.h for eight rays of a tile at once.
#pragma once
#include "core/simd8.h"
#include "accel/heightfield.h"

namespace warpcam {

struct Planes {
    Floats height, rise_x, rise_y, fold;
};

inline Planes gather_planes(const float* cells, Ints at)
{
    const Columns four = gather_rows(cells, at);
    return { four.a, four.b, four.c, four.d };
}

inline Floats line_of(Ints code) { return (Floats)code - INDEX_BASE; }

// As Axis.
struct Axes {
    Floats start, speed, wait, offset, ahead, first;
    Ints last, flip;

    Axes(Floats origin, Floats direction, float cells)
    {
        flip = direction < 0.0f;
        first = flip ? (Floats)-cells : (Floats)0.0f;
        last = (Ints)(first + (cells - 1.0f + INDEX_BASE));
        start = flip ? -origin : origin;
        speed = upper(magnitude(direction), (Floats)1.0e-18f);
        wait = 1.0f / speed;
        offset = muladd(-start, wait, wait);
        ahead = start + 5.0e-7f * (magnitude(start) + cells);
    }
    Floats leaves(Floats line) const { return muladd(line, wait, offset); }
    Ints cell(Floats t) const
    {
        const Ints code = (Ints)(__builtin_elementwise_floor(muladd(t, speed, ahead)) + INDEX_BASE);
        return code < last ? code : last;
    }
    Floats place(Floats t, Ints code) const
    {
        const Floats along = muladd(t, speed, start) - line_of(code);
        return flip ? 1.0f - along : along;
    }
    Floats direction() const { return flip ? -speed : speed; }
};

struct RayPacket {
    Floats ox, oy, oz, dx, dy, dz;  // in the field's frame
};

struct PacketHit {
    Floats depth;
    Ints met, face;  // met: true where the field was
};

// As walk_height_field(), whose comments hold here.
template <class HeightFields> WARPCAM_APART inline void walk_packet(const HeightFields& fields, const Record& record,
                                                                    const RayPacket& ray, Floats near, PacketHit& hit)
{
    const Row scale = load(fields.grids.data, 2 * record.axis_z.w);
    const Row grid = load(fields.grids.data, 2 * record.axis_z.w + 1);
    const int columns = as_int(grid.x), rows = as_int(grid.y), levels = scale.w;
    const float top = scale.z, base = record.size.z;
    const float* const peaks = fields.peaks.data + as_int(grid.z);
    const float* const cells = reinterpret_cast<const float*>(fields.cells.data) + 4 * size_t(unsigned(grid.w));

    const float along_x = float(columns), along_y = float(rows);
    const Axes x(muladd(ray.ox, (Floats)scale.x, (Floats)(0.5f * along_x)), ray.dx * scale.x, along_x);
    const Axes y(muladd(ray.oy, (Floats)scale.y, (Floats)(0.5f * along_y)), ray.dy * scale.y, along_y);
    const Floats enter = upper(x.leaves(x.first - 1.0f), y.leaves(y.first - 1.0f));
    const Floats leave = lower(x.leaves(x.first + (along_x - 1.0f)), y.leaves(y.first + (along_y - 1.0f)));
    const Floats oz = ray.oz, dz = ray.dz;
    const Ints falls = dz < 0.0f;
    const Floats rate = 1.0f / (magnitude(dz) < 1.0e-18f ? (Floats)1.0e-18f : dz);
    const Floats level_at = -oz * rate;
    const Floats lid = (top + 2.0e-6f * (magnitude(oz) + magnitude(top)) - oz) * rate;
    const Floats floor = (-base - oz) * rate;
    const Ints below =
        (dz > 0.0f) & (floor > enter) & (floor <= lower(leave, lid)) & (floor > near) & (floor < hit.depth);
    hit.depth = below ? floor : hit.depth;
    hit.met |= below;
    hit.face = below ? (Ints)-1 : hit.face;

    const Floats begin = upper(upper(enter, near), falls ? lid : near);
    const Floats end = lower(lower(leave, hit.depth), falls ? leave : lid);
    Ints walks = begin < end;
    if (!any_of(walks))
        return;

    const int pitch = (columns + 1) >> 1;
    const Ints row_bits = y.flip ^ 1 << levels;
    const Floats fall = falls ? rate : (Floats)0.0f, fall_at = falls ? level_at : (Floats)-FAR_AWAY;
    const Floats dx = x.direction(), dy = y.direction(), turn = dx - dy, unturn = -1.0f / turn;
    const Ints over_base = dz > 0.0f ? ~(floor > enter) : (Ints)(muladd(begin, dz, oz) >= -base);
    const Ints by_side = (begin == enter) & (enter > near) & over_base;
    Floats t = begin;
    Ints i = x.cell(t), j = y.cell(t);
    Ints level = (Ints)lower_int(FIRST_LEVEL, ((levels + 1) & ~1) - 1);
    Ints above = -1;
    while (true) {
        for (Ints high = walks & (level != CELLS); any_of(high); high = high & (level != CELLS) & (t < end)) {
            const Ints shift = level & 31, beyond = ~(~(Ints)0 << shift);
            const Floats leave_x = x.leaves(line_of(i | beyond)), leave_y = y.leaves(line_of(j | beyond));
            const Floats next = lower(lower(leave_x, leave_y), end);
            const Ints row = ((j ^ row_bits) & INDEX) >> shift, column = ((i ^ x.flip) & INDEX) >> shift;
            const Floats peak = gather(peaks, high ? row * pitch + column : 0);
            const Ints clear = muladd(falls ? next : t, dz, oz) > peak;
            const Floats onto = clear ? next : upper(t, lower(muladd(peak, fall, fall_at), next));
            t = high ? onto : t;
            const Ints to_x = x.cell(t), to_y = y.cell(t);
            const Ints left = (((to_x ^ i) | (to_y ^ j)) & ~beyond << LEVEL_STEP) != 0;
            const Ints higher = left ? level + LEVEL_STEP : level;
            level = high ? (clear ? higher : level - LEVEL_STEP) : level;
            i = to_x;
            j = to_y;
        }
        walks &= t < end;
        if (!any_of(walks))
            return;
        const Floats next = lower(lower(x.leaves(line_of(i)), y.leaves(line_of(j))), end);
        const Ints cell = walks ? ((j ^ y.flip) & INDEX) * columns + ((i ^ x.flip) & INDEX) : 0;
        const Planes plane = gather_planes(cells, cell);
        const Floats u = x.place(t, i), v = y.place(t, j), side = u - v;
        const Floats span = next - t, to_fold = side * unturn;
        const Ints split = (to_fold > 0.0f) & (to_fold < span);
        const Floats middle = split ? to_fold : span;
        const Floats gap = muladd(t, dz, oz) - plane.height - u * plane.rise_x - v * plane.rise_y;
        const Floats closing = dz - dx * plane.rise_x - dy * plane.rise_y;
        const Floats gap_begin = gap - plane.fold * upper(side, (Floats)0.0f);
        const Floats gap_end = gap + closing * span - plane.fold * upper(side + turn * span, (Floats)0.0f);
        const Floats gap_middle = split ? gap + closing * middle : gap_end;
        const Ints starts = walks & (t == begin);
        above = starts ? gap_begin > 0.0f : above;
        const Ints at_side = starts & ~above & by_side;
        const Ints in_first = above & ~(gap_middle > 0.0f);
        const Ints in_second = (gap_middle > 0.0f) & ~(gap_end > 0.0f);
        const Ints ends = walks & (at_side | in_first | in_second);
        if (any_of(ends)) {
            const Floats from = in_first ? (Floats)0.0f : middle, length = in_first ? middle : span - middle;
            const Floats a = in_first ? upper(gap_begin, (Floats)0.0f) : gap_middle;
            const Floats b = in_first ? gap_middle : gap_end;
            const Floats into = t + from + length * a / upper(a - b, (Floats)1.0e-30f);
            const Floats depth = at_side ? begin : into;
            const Ints closer = ends & (at_side | (depth < hit.depth));
            const Ints face = 2 * cell + 1 + (side + turn * (from + 0.5f * length) > 0.0f);
            hit.depth = closer ? depth : hit.depth;
            hit.met |= closer;
            hit.face = closer ? (at_side ? (Ints)-1 : face) : hit.face;
            walks &= ~ends;
        }
        above = gap_end > 0.0f;
        t = walks ? next : t;
        const Ints to_x = x.cell(t), to_y = y.cell(t);
        const Ints left = (((to_x ^ i) | (to_y ^ j)) & CELL_BLOCK) != 0;
        level = above & left ? (Ints)(CELLS + LEVEL_STEP) : (Ints)CELLS;
        i = to_x;
        j = to_y;
        walks &= t < end;
    }
}

template <int LENS, class HeightFields, class Near, class Rays>
inline void trace_height_field(const HeightFields& fields, const Record& record, const Near& near, Rays& rays)
{
    const Row ax = record.axis_x, ay = record.axis_y, az = record.axis_z, o = record.origin;
    for (int lane = 0; lane < LANES; lane += PACKET) {
        Floats x, y, nears;
        PacketHit hit { {}, 0, 0 };
        Ints shape, face;
        for (int k = 0; k < PACKET; ++k)
            nears[k] = near.at(lane + k);
        __builtin_memcpy(&x, rays.x + lane, sizeof x);
        __builtin_memcpy(&y, rays.y + lane, sizeof y);
        __builtin_memcpy(&hit.depth, rays.depth + lane, sizeof hit.depth);
        const Floats across_x = ax.x * x + ax.y * y, across_y = ay.x * x + ay.y * y, across_z = az.x * x + az.y * y;
        RayPacket ray = LENS == ORTHOGRAPHIC
            ? RayPacket { o.x + across_x, o.y + across_y, o.z + across_z, -ax.z, -ay.z, -az.z }
            : RayPacket { o.x, o.y, o.z, across_x - ax.z, across_y - ay.z, across_z - az.z };
        if constexpr (LENS == RAYS) {
            const Floats rate = 2.0f / (1.0f + x * x + y * y), back = 1.0f - rate;
            ray = { o.x, o.y, o.z, rate * across_x + back * ax.z, rate * across_y + back * ay.z,
                    rate * across_z + back * az.z };
        }
        if constexpr (LENS == SPREAD)
            for (int k = 0; k < PACKET; ++k) {
                const Ray one = ViewRay<LENS> { x[k], y[k] }.local(record);
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
        shape = hit.met ? (Ints)record.axis_y.w : shape;
        face = hit.met ? hit.face : face;
        __builtin_memcpy(rays.depth + lane, &hit.depth, sizeof hit.depth);
        __builtin_memcpy(rays.shape + lane, &shape, sizeof shape);
        __builtin_memcpy(rays.face + lane, &face, sizeof face);
    }
}

}  // namespace warpcam
