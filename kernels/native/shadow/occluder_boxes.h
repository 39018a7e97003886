// Where a mesh surely stops light: boxes that its surface shuts, so that no way leads from one end to the other. Light
// that comes in at one end and would go out at the other meets a face, whichever it is. Found by
// build/occluder_builder.h.
#pragma once
#include "shadow/casters.h"
#include "shadow/shadow_tile.h"

namespace warpcam {

constexpr int SHUTTERS = 32;  // of a mesh: one for each lane of a warp
constexpr int SHUTTER_ROWS = 3;
// In Meshes.shutters row k of shutter i of mesh m is row m * ALL_SHUTTER_ROWS + k * SHUTTERS + i; behind a mesh's
// shutters come as many points, some of them perhaps the same, between which all of the mesh lies: its outline.
constexpr int ALL_SHUTTER_ROWS = (SHUTTER_ROWS + 1) * SHUTTERS;

// Whether meshes have them: see accel/meshes.py.
constexpr bool has_shutters(int types) { return (types >> SHUTTERED & 1) && !(types >> MASKED & 1); }

// Takes a mesh's own coordinates to those in which the box is from -1 to 1, its ends at z = -1 and 1.
struct Shutter {
    Row across, up, along;

    WARPCAM_FN static Shutter load_from(const void* rows, int mesh, int number)
    {
        const unsigned first = unsigned(mesh * ALL_SHUTTER_ROWS + number);
        return { load(rows, first), load(rows, first + SHUTTERS), load(rows, first + 2 * SHUTTERS) };
    }

    // How far from its middle a ray goes through the ends: it is stopped if that is at most 1.
    WARPCAM_FN float aside(const Ray& ray, const Span& span) const
    {
        const auto place = [&](const Row& row) {
            return row.x * ray.origin.x + row.y * ray.origin.y + row.z * ray.origin.z + as_float(row.w);
        };
        const auto way = [&](const Row& row) {
            return row.x * ray.direction.x + row.y * ray.direction.y + row.z * ray.direction.z;
        };
        const float rate = reciprocal(nonzero(way(along))), middle = -place(along) * rate;
        const float x = place(across), y = place(up), dx = way(across), dy = way(up);
        const float half = magnitude(rate);
        const float enter = middle - half, leave = middle + half;
        // of a straight line's two ends one is farther aside than its middle by as much as the other is nearer
        const float most = upper(magnitude(x + middle * dx) + magnitude(half * dx),
                                 magnitude(y + middle * dy) + magnitude(half * dy));
        return ((enter > span.near) & (leave < span.reach)) ? most : FAR_AWAY;
    }
};

#if defined(__CUDA_ARCH__)

constexpr int SHUTTER_TRIES = 2;  // a second one where the first stopped some

// Finds what a list's mesh covers by its outline, and along diagonals, where all of that lies before the light. Called
// by one warp.
template <class List, class Meshes>
WARPCAM_FN void outline_caster(List& list, int slot, const LightView& light, const Meshes& meshes)
{
    const Record& record = list.records[slot];
    const int row = record.axis_z.w * ALL_SHUTTER_ROWS + SHUTTER_ROWS * SHUTTERS;
    const Vec at = to_vec(load(meshes.shutters.data, unsigned(row) + threadIdx.x % LANES)) - to_vec(record.origin);
    const Vec there = at.x * to_vec(record.axis_x) + at.y * to_vec(record.axis_y) + at.z * to_vec(record.axis_z);
    const Vec from = light.distant ? there : there - light.aim;
    const Vec p { dot(light.u, from), dot(light.v, from), dot(light.w, from) };
    const auto size = [](const Vec& v) { return magnitude(v.x) + magnitude(v.y) + magnitude(v.z); };
    const float pad = 1.0e-5f
        * (size(at) + size(to_vec(record.origin)) + size(there) + (light.distant ? 0.0f : size(light.aim)));
    const bool before = p.z > 1.0e-3f * (magnitude(p.x) + magnitude(p.y)) + 4.0f * pad;
    if (!__all_sync(ALL, light.distant | before))
        return;
    const float rate = light.distant ? 1.0f : 1.0f / p.z, x = rate * p.x, y = rate * p.y,
                aside = magnitude(x) + magnitude(y);
    const float by = pad * rate * (2.0f + aside) + 1.0e-5f * aside;
    const auto around = [&](float u, float v) {
        return Window { warp_min(u - by), -warp_min(-u - by), warp_min(v - by), -warp_min(-v - by) };
    };
    const Window window = around(x, y), diagonals = around(x + y, x - y);
    if (threadIdx.x % LANES == 0) {
        list.windows[slot] = window;
        list.diagonals[slot] = diagonals;
    }
}

// Which of the rays of a warp that `ask` are stopped by shutters of their meshes: each has one, by `slot` in a list and
// by `mesh`, and is in its frame. One of them is tried with all shutters of its mesh; that which stops it best is tried
// with all.
template <class Meshes>
WARPCAM_FN bool meets_shutters(const Meshes& meshes, int slot, int mesh, const Ray& ray, const Span& span, bool asks)
{
    const int lane = threadIdx.x % LANES;
    bool stopped = false;
#pragma unroll 1
    for (int number = 0; number < SHUTTER_TRIES; ++number) {
        const unsigned asking = __ballot_sync(ALL, asks);
        if (!asking)
            break;
        // neither the first nor the last of them: these are more often at an edge of a shadow
        const int before = __popc(asking & ((1u << lane) - 1));
        const int from = lowest_bit(asking & __ballot_sync(ALL, before == __popc(asking) / 2));
        const auto of = [&](float value) { return __shfl_sync(ALL, value, from); };
        const Ray its { { of(ray.origin.x), of(ray.origin.y), of(ray.origin.z) },
                        { of(ray.direction.x), of(ray.direction.y), of(ray.direction.z) } };
        const Span its_span { of(span.near), of(span.reach) };
        const int its_mesh = __shfl_sync(ALL, mesh, from);
        const float aside = Shutter::load_from(meshes.shutters.data, its_mesh, lane).aside(its, its_span);
        const int least = least_of_all((as_int(aside) & ~(LANES - 1)) | lane);
        if (lane == from)
            asks = false;
        if (least >= as_int(1.0f))
            break;
        const float own = Shutter::load_from(meshes.shutters.data, its_mesh, least & (LANES - 1)).aside(ray, span);
        const bool stops = (own < 1.0f) & (slot == __shfl_sync(ALL, slot, from)) & (asks | (lane == from));
        stopped |= stops;
        asks &= !stops;
    }
    return stopped;
}

#endif
}  // namespace warpcam
