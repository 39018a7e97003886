// Occluder boxes of a mesh: boxes that its surface closes, so that no path leads from one end to the other. Light that
// enters at one end and would leave at the other hits a face, whichever it is. build/occluder_builder.h computes them.
#pragma once
#include "shadow/casters.h"
#include "shadow/shadow_tile.h"

namespace warpcam {

constexpr int MAX_OCCLUDER_BOXES = 32;  // of a mesh: one for each lane of a warp
constexpr int OCCLUDER_ROWS = 3;
// In Meshes.occluder_boxes row k of box i of mesh m is row m * ALL_OCCLUDER_ROWS + k * MAX_OCCLUDER_BOXES + i; behind a
// mesh's boxes come as many points, some of them perhaps the same, between which all of the mesh lies: its outline.
constexpr int ALL_OCCLUDER_ROWS = (OCCLUDER_ROWS + 1) * MAX_OCCLUDER_BOXES;

// True if meshes have occluder boxes: see accel/meshes.py.
template <class Types> constexpr bool uses_occluder_boxes()
{
    return Types::has(HAS_OCCLUDER_BOXES) && !Types::has(ALPHA_TESTED);
}

// Takes a mesh's own coordinates to those in which the box is from -1 to 1, its ends at z = -1 and 1.
struct OccluderBox {
    Float3Int across, up, along;

    WARPCAM_DEVICE static OccluderBox load_from(const void* rows, int mesh, int number)
    {
        const unsigned first = unsigned(mesh * ALL_OCCLUDER_ROWS + number);
        return { load(rows, first), load(rows, first + MAX_OCCLUDER_BOXES),
                 load(rows, first + 2 * MAX_OCCLUDER_BOXES) };
    }

    // Largest distance from the box's middle at which a ray passes its ends: at most 1 means blocked.
    WARPCAM_DEVICE float aside(const Ray& ray, const Span& span) const
    {
        const auto place = [&](const Float3Int& row) {
            return row.x * ray.origin.x + row.y * ray.origin.y + row.z * ray.origin.z + as_float(row.w);
        };
        const auto way = [&](const Float3Int& row) {
            return row.x * ray.direction.x + row.y * ray.direction.y + row.z * ray.direction.z;
        };
        const float rate = rcp(avoid_zero(way(along))), middle = -place(along) * rate;
        const float x = place(across), y = place(up), dx = way(across), dy = way(up);
        const float half = abs(rate);
        const float enter = middle - half, t_far = middle + half;
        // of a straight line's two ends one is farther aside than its middle by as much as the other is nearer
        const float most = max(abs(x + middle * dx) + abs(half * dx), abs(y + middle * dy) + abs(half * dy));
        return ((enter > span.near) & (t_far < span.reach)) ? most : MISS;
    }
};

#if defined(__CUDA_ARCH__)

constexpr int OCCLUDER_TRIES = 2;  // a second one where the first stopped some

// Finds what a list's mesh covers by its outline, and along diagonals, where all of that lies before the light. Called
// by one warp.
template <class List, class Meshes>
WARPCAM_DEVICE void outline_caster(List& list, int slot, const LightView& light, const Meshes& meshes)
{
    const ShapeRecord& record = list.records[slot];
    const int row = record.axis_z.w * ALL_OCCLUDER_ROWS + OCCLUDER_ROWS * MAX_OCCLUDER_BOXES;
    const Vec3 at =
        as_vec3(load(meshes.occluder_boxes.data, unsigned(row) + threadIdx.x % WARP_SIZE)) - as_vec3(record.origin);
    const Vec3 there = at.x * as_vec3(record.axis_x) + at.y * as_vec3(record.axis_y) + at.z * as_vec3(record.axis_z);
    const Vec3 from = light.distant ? there : there - light.aim;
    const Vec3 p { dot(light.u, from), dot(light.v, from), dot(light.w, from) };
    const auto size = [](const Vec3& v) { return abs(v.x) + abs(v.y) + abs(v.z); };
    const float pad =
        1.0e-5f * (size(at) + size(as_vec3(record.origin)) + size(there) + (light.distant ? 0.0f : size(light.aim)));
    const bool before = p.z > 1.0e-3f * (abs(p.x) + abs(p.y)) + 4.0f * pad;
    if (!__all_sync(FULL_WARP, light.distant | before))
        return;
    const float rate = light.distant ? 1.0f : 1.0f / p.z, x = rate * p.x, y = rate * p.y, aside = abs(x) + abs(y);
    const float by = pad * rate * (2.0f + aside) + 1.0e-5f * aside;
    const auto around = [&](float u, float v) {
        return LightSpaceBounds { warp_min(u - by), -warp_min(-u - by), warp_min(v - by), -warp_min(-v - by) };
    };
    const LightSpaceBounds bounds_uv = around(x, y), diagonals = around(x + y, x - y);
    if (threadIdx.x % WARP_SIZE == 0) {
        list.bounds_uv[slot] = bounds_uv;
        list.diagonals[slot] = diagonals;
    }
}

// Bit mask of the rays of a warp that `ask` and are blocked by occluder boxes of their meshes. Each ray has a mesh, by
// `slot` in a list and by `mesh`, and is in its frame. One ray is tested against all boxes of its mesh; the box that
// blocks it best is tested against all rays.
template <class Meshes> WARPCAM_DEVICE bool blocked_by_boxes(const Meshes& meshes, int slot, int mesh, const Ray& ray,
                                                             const Span& span, bool asks)
{
    const int lane = threadIdx.x % WARP_SIZE;
    bool stopped = false;
#pragma unroll 1
    for (int number = 0; number < OCCLUDER_TRIES; ++number) {
        const unsigned asking = __ballot_sync(FULL_WARP, asks);
        if (!asking)
            break;
        // neither the first nor the last of them: these are more often at an edge of a shadow
        const int before = __popc(asking & ((1u << lane) - 1));
        const int from = ctz(asking & __ballot_sync(FULL_WARP, before == __popc(asking) / 2));
        const auto of = [&](float value) { return __shfl_sync(FULL_WARP, value, from); };
        const Ray its { { of(ray.origin.x), of(ray.origin.y), of(ray.origin.z) },
                        { of(ray.direction.x), of(ray.direction.y), of(ray.direction.z) } };
        const Span its_span { of(span.near), of(span.reach) };
        const int its_mesh = __shfl_sync(FULL_WARP, mesh, from);
        const float aside = OccluderBox::load_from(meshes.occluder_boxes.data, its_mesh, lane).aside(its, its_span);
        const int least = warp_reduce_min((as_int(aside) & ~(WARP_SIZE - 1)) | lane);
        if (lane == from)
            asks = false;
        if (least >= as_int(1.0f))
            break;
        const float own =
            OccluderBox::load_from(meshes.occluder_boxes.data, its_mesh, least & (WARP_SIZE - 1)).aside(ray, span);
        const bool stops = (own < 1.0f) & (slot == __shfl_sync(FULL_WARP, slot, from)) & (asks | (lane == from));
        stopped |= stops;
        asks &= !stops;
    }
    return stopped;
}

#endif
}  // namespace warpcam
