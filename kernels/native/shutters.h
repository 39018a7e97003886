// Where a mesh surely stops light: boxes that its surface shuts, so that no way leads from one end to the other. Light that
// comes in at one end and would go out at the other meets a face, whichever it is. Found by shutter_build.h.
#pragma once
#include "casters.h"
#include "shade_tile.h"

namespace warpcam {

constexpr int SHUTTERS = 32;  // of a mesh: one for each lane of a warp
constexpr int SHUTTER_ROWS = 3;  // row k of shutter i of mesh m is row (m * SHUTTER_ROWS + k) * SHUTTERS + i of Meshes.shutters

// Whether meshes have them: where any face stops light, from whichever side.
constexpr bool has_shutters(int types)
{
    return (types >> MESH & 1) && (types >> SHADING_BACKS & 1) && has_horizons(types) && !(types >> MASKED & 1);
}

// Takes a mesh's own coordinates to those in which the box is from -1 to 1, its ends at z = -1 and 1.
struct Shutter {
    Row across, up, along;

    WARPCAM_FN static Shutter load_from(const void* rows, int mesh, int number)
    {
        const unsigned first = unsigned(mesh * (SHUTTER_ROWS * SHUTTERS) + number);
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

constexpr int SHUTTER_TRIES = 2;

// Which of the rays of a warp that `ask`, each from its lane's point, are stopped by shutters of meshes that are `met`. One of
// them is tried with all shutters of a mesh; that which stops it best is tried with all of them.
template <class List, class Meshes>
WARPCAM_FN bool meets_shutters(const List& list, const Light& light, const Meshes& meshes, const unsigned (&met)[List::WORDS],
                               Vec point, const Span& span, bool asks)
{
    const int lane = threadIdx.x % LANES;
    bool stopped = false, tried = false;
#pragma unroll 1
    for (int number = 0; number < SHUTTER_TRIES; ++number) {
        const unsigned asking = __ballot_sync(ALL, asks & !stopped & !tried);
        if (!asking)
            break;
        // neither the first nor the last of them: these are more often at an edge of a shadow
        const int before = __popc(asking & ((1u << lane) - 1));
        const int from = lowest_bit(asking & __ballot_sync(ALL, before == __popc(asking) / 2));
        int slot = 0;
#pragma unroll
        for (int word = List::WORDS - 1; word >= 0; --word)
            slot = met[word] ? word * 32 + lowest_bit(met[word]) : slot;
        slot = __shfl_sync(ALL, slot, from);
        const Record& record = list.records[slot];
        const Ray ray = WorldRay { point, ray_to(light, point) }.local(record);
        const auto of = [&](float value) { return __shfl_sync(ALL, value, from); };
        const Ray its { { of(ray.origin.x), of(ray.origin.y), of(ray.origin.z) },
                        { of(ray.direction.x), of(ray.direction.y), of(ray.direction.z) } };
        const Span its_span { of(span.near), of(span.reach) };
        const int mesh = record.axis_z.w;
        const float aside = Shutter::load_from(meshes.shutters.data, mesh, lane).aside(its, its_span);
        const int least = least_of_all((as_int(aside) & ~(LANES - 1)) | lane);
        tried |= lane == from;
        if (least >= as_int(1.0f))
            continue;
        unsigned word = 0;
#pragma unroll
        for (int k = 0; k < List::WORDS; ++k)
            word = slot / 32 == k ? met[k] : word;
        const float own = Shutter::load_from(meshes.shutters.data, mesh, least & (LANES - 1)).aside(ray, span);
        stopped |= asks & (word >> slot % 32 & 1) & (own < 1.0f);
    }
    return stopped;
}

#endif
}  // namespace warpcam
