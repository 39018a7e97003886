// The points of one tile against the casters that may stand between them and a light.
#pragma once
#include "casters.h"

namespace warpcam {

// A ray from a hit point to the light runs from t = 0 to 1, or to infinity if the light is distant. It counts from
// `near` on, past the rounding of its own starting point, to `reach`.
struct Span {
    float near, reach;
};

WARPCAM_FN Vec ray_to(const Light& light, Vec p)
{
    return light.distant ? light.aim : Vec { light.aim.x - p.x, light.aim.y - p.y, light.aim.z - p.z };
}

WARPCAM_FN Span span_of(const Light& light, const Camera& camera, Vec p, float depth)
{
    const Vec o = camera.origin, d = ray_to(light, p);
    const float rounding = 2.0e-6f
        * (magnitude(o.x + p.x) + magnitude(o.y + p.y) + magnitude(o.z + p.z) + depth);
    const float near = rounding / root(upper(dot(d, d), 1.0e-30f));
    return { near, light.distant ? FAR_AWAY : 1.0f - near };
}

// The ray of an analytic shape's test, in the shape's frame.
WARPCAM_FN Ray look_back(const Record& record, const Row& aim, Vec p, bool distant)
{
    const Row o = record.origin;
    const Vec origin = WorldRay::turned(record, p, { o.x, o.y, o.z });
    const float s = distant ? 0.0f : 1.0f;
    return { origin, { aim.x - s * origin.x, aim.y - s * origin.y, aim.z - s * origin.z } };
}

#if defined(__CUDA_ARCH__)

WARPCAM_FN float warp_min(float value)
{
    for (int step = LANES / 2; step > 0; step /= 2)
        value = lower(value, __shfl_xor_sync(0xffffffffu, value, step));
    return value;
}

// Whether the lane's point is in the shadow of a caster in the list. Lanes that do not ask have `open` false.
template <int TYPES, int CAPACITY, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN bool shade_tile(const CasterList<CAPACITY>& list, const Light& light, const Camera& camera, Vec p,
                           float depth, bool open, bool backs, int world, int id, int face, const Shapes& shapes,
                           const Meshes& meshes, const HeightFields& fields)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    const int lane = threadIdx.x % LANES, words = (list.count + 31) / 32;
    const Place place = place_of(light, p);
    const bool asked = open;
    const Window tile { warp_min(open ? place.beside ? -FAR_AWAY : place.u : FAR_AWAY),
                        -warp_min(open ? place.beside ? -FAR_AWAY : -place.u : FAR_AWAY),
                        warp_min(open ? place.beside ? -FAR_AWAY : place.v : FAR_AWAY),
                        -warp_min(open ? place.beside ? -FAR_AWAY : -place.v : FAR_AWAY) };
    const float height = warp_min(open ? place.height : FAR_AWAY);
    const Span span = span_of(light, camera, p, depth);
    unsigned met[(CAPACITY + 31) / 32];
    bool any = false;
    for (int word = 0; word < words; ++word) {
        const int slot = word * 32 + lane;
        const bool mine = slot < list.count && list.heights[slot] > height && overlap(list.windows[slot], tile);
        unsigned mask = __ballot_sync(0xffffffffu, mine), mesh_bits = 0;
        for (; mask; mask &= mask - 1) {
            const int bit = lowest_bit(mask), caster = word * 32 + bit;
            const Record& record = list.records[caster];
            const int type = record.axis_x.w;
            if (HAS_MESH && type == MESH) {
                if (may_shade(list.windows[caster], list.heights[caster], place))
                    mesh_bits |= 1u << bit;
            } else if (HAS_FIELD && type == HEIGHT_FIELD) {
                if (open && may_shade(list.windows[caster], list.heights[caster], place)) {
                    Hit hit { span.reach, -1, -1 };
                    walk_height_field(fields, record, WorldRay { p, ray_to(light, p) }, span.near, hit);
                    open = hit.shape < 0;
                }
                __syncwarp();
            } else {
                const float t = enter_any<analytic_types(TYPES)>(record,
                                                                 look_back(record, list.aims[caster], p, light.distant));
                open = open && !(t > span.near && t < span.reach);
                if (!__any_sync(0xffffffffu, open))
                    return asked;
            }
        }
        if (HAS_MESH) {
            met[word] = mesh_bits;
            any |= mesh_bits != 0;
        }
    }
    if (HAS_MESH) {
        if (open && any && (backs || faces_light<TYPES>(shapes, meshes, world, id, face, light, camera))) {
            Hit hit { span.reach, -1, -1 };
            walk_meshes<true>(meshes, list.records, list.order, met, words, WorldRay { p, ray_to(light, p) }, span.near,
                              hit);
            open = hit.shape < 0;
        }
        __syncwarp();
    }
    return asked && !open;
}

#else

// The points of a tile that ask.
struct Points {
    Vec at[LANES];
    float near[LANES], reach[LANES];
    int open[LANES];  // 1: asks and is not shaded yet
    int ids[LANES], faces[LANES];
};

template <int TYPE> inline void shade_points(const Record& record, const Row& aim, bool distant, Points& points)
{
    const Record r = record;
    const Row a = aim;
    for (int lane = 0; lane < LANES; ++lane) {
        const float t = enter<TYPE>(r, look_back(r, a, points.at[lane], distant));
        points.open[lane] &= !((t > points.near[lane]) & (t < points.reach[lane]));
    }
}

// Clears `open` of the points that lie in the shadow of a caster in the list.
template <int TYPES, int CAPACITY, class Shapes, class Meshes, class HeightFields>
inline void shade_tile(const CasterList<CAPACITY>& list, const Light& light, const Camera& camera, bool backs, int world,
                       const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, Points& points)
{
    constexpr bool HAS_MESH = TYPES >> MESH & 1, HAS_FIELD = TYPES >> HEIGHT_FIELD & 1;
    const int words = (list.count + 31) / 32;
    Place places[LANES];
    Window tile { FAR_AWAY, -FAR_AWAY, FAR_AWAY, -FAR_AWAY };
    float height = FAR_AWAY;
    for (int lane = 0; lane < LANES; ++lane) {
        if (!points.open[lane])
            continue;
        const Place place = places[lane] = place_of(light, points.at[lane]);
        tile.left = lower(tile.left, place.beside ? -FAR_AWAY : place.u);
        tile.right = upper(tile.right, place.beside ? FAR_AWAY : place.u);
        tile.bottom = lower(tile.bottom, place.beside ? -FAR_AWAY : place.v);
        tile.top = upper(tile.top, place.beside ? FAR_AWAY : place.v);
        height = lower(height, place.height);
    }
    unsigned behind[(CAPACITY + 31) / 32] = {};  // casters that are walked, point by point
    bool any = false;
    for (int slot = 0; slot < list.count; ++slot) {
        if (!(list.heights[slot] > height && overlap(list.windows[slot], tile)))
            continue;
        const Record& record = list.records[slot];
        switch (record.axis_x.w) {
#define WARPCAM_CASE(TYPE) \
    case TYPE: \
        if (TYPES >> TYPE & 1) \
            shade_points<TYPE>(record, list.aims[slot], light.distant, points); \
        break;
            WARPCAM_CASE(PLANE)
            WARPCAM_CASE(SPHERE)
            WARPCAM_CASE(CAPSULE)
            WARPCAM_CASE(ELLIPSOID)
            WARPCAM_CASE(CYLINDER)
            WARPCAM_CASE(BOX)
#undef WARPCAM_CASE
        default:
            behind[slot / 32] |= 1u << slot % 32;
            any = true;
        }
    }
    for (int lane = 0; (HAS_MESH || HAS_FIELD) && any && lane < LANES; ++lane) {
        if (!points.open[lane])
            continue;
        const WorldRay ray { points.at[lane], ray_to(light, points.at[lane]) };
        unsigned met[(CAPACITY + 31) / 32];
        bool walk = false;
        Hit hit { points.reach[lane], -1, -1 };
        for (int word = 0; word < words; ++word) {
            met[word] = 0;
            for (unsigned left = behind[word]; left; left &= left - 1) {
                const int slot = word * 32 + lowest_bit(left);
                if (!may_shade(list.windows[slot], list.heights[slot], places[lane]))
                    continue;
                if (HAS_FIELD && list.records[slot].axis_x.w == HEIGHT_FIELD)
                    walk_height_field(fields, list.records[slot], ray, points.near[lane], hit);
                else
                    met[word] |= 1u << slot % 32;
            }
            walk |= met[word] != 0;
        }
        if (HAS_MESH && walk && hit.shape < 0
            && (backs || faces_light<TYPES>(shapes, meshes, world, points.ids[lane], points.faces[lane], light, camera)))
            walk_meshes<true>(meshes, list.records, list.order, met, words, ray, points.near[lane], hit);
        points.open[lane] = hit.shape < 0;
    }
}

#endif

}  // namespace warpcam
