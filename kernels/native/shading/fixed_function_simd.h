// Light on eight places of one shape, on a CPU: shading/fixed_function.h and shading/plane_vertex_lighting.h, whose
// comments hold here.
#pragma once
#include "shading/plane_vertex_lighting.h"
#include "shading/self_shadow.h"
#include "lights/shadow_extent.h"
#include "shading/surface_simd.h"

namespace warpcam {

using Vertices = LightingVertexOf<Vec3x8>;

struct Arrivals {
    Vec3x8 to_light;
    Float8 facing, along, distance;
    Int8 shone;  // within its cone
};

// `eye`: where rays begin that see the place, if not where the camera is.
template <class... Eye_> inline Arrivals arrivals_of(const Light& light, const Vertices& vertex, const Eye_&... eye)
{
    Arrivals arrival { broadcast(as_vec3(light.place)), {}, {}, {}, (Int8)-1 };
    if (light.ambient.w & SPOT) {
        const Vec3x8 offset = from_vertex(vertex, (arrival.to_light - ... - eye));
        const Float8 square = dot(offset, offset), rate = rsqrt(square);
        arrival.to_light = rate * offset;
        arrival.along = -dot(arrival.to_light, broadcast(as_vec3(light.axis)));
        arrival.distance = square * rate;
        arrival.shone = arrival.along >= as_float(light.axis.w);
    }
    arrival.facing = dot(vertex.normal, arrival.to_light);
    return arrival;
}

inline Float8 strength_of(const Light& light, const Arrivals& arrival)
{
    Float8 strength = 1.0f;
    if (!(light.ambient.w & SPOT))
        return strength;
    const float exponent = as_float(light.falloff.w);
    if (exponent != 0.0f)
        strength = pow(max(arrival.along, (Float8)MIN_NORMAL), exponent);
    if (light.ambient.w & FADES) {
        const Float8 loss = light.falloff.x + arrival.distance * (light.falloff.y + arrival.distance * light.falloff.z);
        strength *= rcp(max(loss, (Float8)1.0e-12f));
    }
    return strength;
}

template <class Material_> inline LightWeights<Float8> shares_of(const Light& light, const Vertices& vertex,
                                                                 const Arrivals& arrival, Float8 strength,
                                                                 const Material_& material)
{
    const Float8 none = 0.0f;
    LightWeights<Float8> share { strength, strength * max(arrival.facing, none), none };
    if (material.gloss.y != 0.0f || of_casting(material).gloss != 0.0f) {
        const float length = light.ambient.w & SPOT ? 2.0f : as_float(light.diffuse.w);
        const Float8 highlight = highlight_of(vertex, arrival.to_light, arrival.facing, length);
        // h^e is at most exp(-e (1 - h)): where that is nothing anywhere, no power is taken.
        if (!(material.gloss.z > 0.0f) || any(material.gloss.z * (1.0f - highlight) < 12.0f)) {
            const Float8 highlight_power = pow(max(highlight, (Float8)MIN_NORMAL), material.gloss.z);
            share.specular = arrival.facing > 0.0f ? strength * highlight_power : none;
        }
    }
    return share;
}

inline void add(Float8& sum, Float8 share, const Float3Int& color) { sum += share * color.x; }

using Lits = LitColorOf<Vec3x8>;

// LINEAR: whether light that is not clipped is asked for.
template <bool SHADOWS, bool LINEAR, class Sum, class Material_, class... Eye_>
static WARPCAM_NOINLINE void illuminate_eight_as(const LightList& list, const GouraudTriangle8& gouraud, int corners,
                                                 const Material_& material, Int8 shadow, Lits& lit, const Eye_&... eye)
{
    const Float8 weights[3] = { 1.0f - gouraud.weight1 - gouraud.weight2, gouraud.weight1, gouraud.weight2 };
    const Float8 none = 0.0f, one = 1.0f;
    const Vec3 base = always_on(list, material);
    lit = { { none, none, none }, { none, none, none } };
    const auto reaches = [&](const Light& light) { return SHADOWS ? (shadow & light.place.w) == 0 : (Int8)-1; };
    for (int k = 0; k < corners; ++k) {
        const Vertices vertex = vertex_at((gouraud.place[k] - ... - eye), gouraud.normal[k]);
        const Float8 weight = corners == 1 ? one : weights[k];
        LightSum<Sum> light_sum {};
        for (int n = 0; n < list.count; ++n) {
            const Light& light = list.lights[n];
            const bool casts = SHADOWS && (light.ambient.w & CASTS);
            const Arrivals arrival = arrivals_of(light, vertex, eye...);
            const Int8 reached = arrival.shone & reaches(light);
            if (!any(light.ambient.w & AMBIENT ? reached : reached & (arrival.facing > none)))
                continue;
            const Float8 strength = reached ? strength_of(light, arrival) : none;
            const LightWeights<Float8> share = shares_of(light, vertex, arrival, strength, material);
            if (!casts) {
                add_share(light_sum, share, light);
            } else {
                LightSum<Sum> own {};
                add_share(own, share, light);
                const Vec3x8 added = reflected<Vec3x8>(own, of_casting(material));
                if (LINEAR)
                    lit.linear = lit.linear + weight * added;
                lit.display = lit.display + weight * clip(added);
            }
        }
        const Vec3x8 steady = reflected<Vec3x8>(light_sum, base, material);
        if (LINEAR)
            lit.linear = lit.linear + weight * steady;
        lit.display = lit.display + weight * clip(steady);
    }
}

// By the light on as many corners of the facet, 1 or 3.
template <bool SHADOWS, bool LINEAR, class Material_, class... Eye_>
inline void illuminate_eight(const LightList& list, const GouraudTriangle8& gouraud, int corners,
                             const Material_& material, Int8 shadow, Lits& lit, const Eye_&... eye)
{
    if (list.colored)
        illuminate_eight_as<SHADOWS, LINEAR, Vec3x8>(list, gouraud, corners, material, shadow, lit, eye...);
    else
        illuminate_eight_as<SHADOWS, LINEAR, Float8>(list, gouraud, corners, material, shadow, lit, eye...);
}

// Lights eight vertices of a plane; results are `stride` numbers apart, and a result's channels `each`.
template <class Sum, bool SHADOWS> inline void light_eight_corners(const LightList& list, Vec3x8 place, Vec3x8 normal,
                                                                   const ResolvedMaterial& material, int each,
                                                                   int stride, int count, float* values)
{
    constexpr int CHANNELS = sizeof(Sum) / sizeof(Float8);
    const auto keep = [&](Vec3x8 color, int slot) {
        for (int k = 0; k < count; ++k) {
            values[k * stride + slot] = color.x[k];
            if (CHANNELS == 3) {
                values[k * stride + slot + each] = color.y[k];
                values[k * stride + slot + 2 * each] = color.z[k];
            }
        }
    };
    const Vertices vertex = vertex_at(place, normal);
    LightSum<Sum> steady {};
    int slot = 1;
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        const Arrivals arrival = arrivals_of(light, vertex);
        const Float8 strength = arrival.shone ? strength_of(light, arrival) : (Float8)0.0f;
        const LightWeights<Float8> share = shares_of(light, vertex, arrival, strength, material);
        if (SHADOWS && (light.ambient.w & CASTS)) {
            LightSum<Sum> own {};
            add_share(own, share, light);
            keep(clip(reflected<Vec3x8>(own, of_casting(material))), slot++);
        } else {
            add_share(steady, share, light);
        }
    }
    keep(clip(reflected<Vec3x8>(steady, always_on(list, material), material)), 0);
}

// Lights a packet of pixels from cached vertices, as light_from_corners() does for one.
template <class Grid, class Appearances>
WARPCAM_NOINLINE_CPU inline void light_all_corners(Grid& grid, const LightList& list, const Appearances& look)
{
    if (grid.shape < 0)
        return;
    const Vec3 eye = look.pose.eye();
    const Vec3x8 normal = broadcast(look.pose.seen({ 0.0f, 0.0f, 1.0f }));
    const int total = grid.columns * grid.rows;
    for (int first = 0; first < total; first += SIMD_WIDTH) {
        Vec3x8 local;
        for (int k = 0; k < SIMD_WIDTH; ++k) {
            const int i = min(first + k, total - 1), row = int(unsigned(i) / unsigned(grid.columns));
            set_lane(local, k,
                     { corner_of(look.cells.u, float(grid.first_u + i - row * grid.columns)) - eye.x,
                       corner_of(look.cells.v, float(grid.first_v + row)) - eye.y, -eye.z });
        }
        const Vec3x8 place = look.pose.seen(local);
        const int count = min(SIMD_WIDTH, total - first);
        float* const values = grid.values + first * grid.stride;
        if (grid.few)
            for (int k = 0; k < count; ++k)
                for (int n = 1 + grid.casting; n < GREY_VERTEX_LIGHTS; ++n)
                    values[k * grid.stride + n] = 0.0f;
        if (grid.grey)
            light_eight_corners<Float8, Grid::SHADOWS>(list, place, normal, look.material, grid.each, grid.stride,
                                                       count, values);
        else
            light_eight_corners<Vec3x8, Grid::SHADOWS>(list, place, normal, look.material, grid.each, grid.stride,
                                                       count, values);
    }
}

// GridInterpolation for a packet.
struct OnCornersOfEight {
    Int8 first, second, third, inside;
    Float8 weight1, weight2, weight3;
    bool together;  // all in one triangle

    // Rows of GREY_VERTEX_LIGHTS numbers.
    Float8x4 few(const float* values) const
    {
        if (together)
            return { of_one(values), of_one(values + 1), of_one(values + 2), of_one(values + 3) };
        const Float8x4 a = gather_float4(values, first >> 2), b = gather_float4(values, second >> 2);
        const Float8x4 c = gather_float4(values, third >> 2);
        return { weight1 * a.a + weight2 * b.a + weight3 * c.a, weight1 * a.b + weight2 * b.b + weight3 * c.b,
                 weight1 * a.c + weight2 * b.c + weight3 * c.c, weight1 * a.d + weight2 * b.d + weight3 * c.d };
    }

    Float8 of_one(const float* values) const
    {
        return weight1 * values[first[0]] + weight2 * values[second[0]] + weight3 * values[third[0]];
    }

    Float8 shown(const float* values) const
    {
        if (together)
            return of_one(values);
        return weight1 * build_shape_list(values, first) + weight2 * build_shape_list(values, second)
               + weight3 * build_shape_list(values, third);
    }
};

template <class Grid> inline OnCornersOfEight on_corners(const Grid& grid, Vec3x8 local)
{
    const Float8 u = grid.u.at(local.x), v = grid.v.at(local.y);
    const Float8 whole_u = round_down(u), whole_v = round_down(v), none = 0.0f;
    const Float8 a = u - whole_u, b = v - whole_v;
    const Int8 high = a + b > 1.0f;
    OnCornersOfEight on;
    on.inside =
        (whole_u >= none) & (whole_v >= none) & (whole_u < float(grid.columns - 1)) & (whole_v < float(grid.rows - 1));
    const Int8 row = to_int(on.inside ? whole_v : none), column = to_int(on.inside ? whole_u : none);
    const Int8 corner = on.inside & (row * grid.columns + column);
    const Int8 beyond = on.inside & (Int8)-1;
    on.first = (corner + (high & beyond & (grid.columns + 1))) * grid.stride;
    on.second = (corner + (beyond & 1)) * grid.stride;
    on.third = (corner + (beyond & grid.columns)) * grid.stride;
    on.together = !any((on.first != on.first[0]) | (on.second != on.second[0]));
    on.weight2 = high ? 1.0f - b : a;
    on.weight3 = high ? 1.0f - a : b;
    on.weight1 = 1.0f - on.weight2 - on.weight3;
    return on;
}

template <class Grid> inline Vec3x8 light_from_corners(const Grid& grid, const OnCornersOfEight& on, Int8 shadow)
{
    const float* const values = grid.values;
    const Float8 none = 0.0f;
    const int casting = Grid::SHADOWS ? grid.casting : 0;
    if (Grid::SHADOWS && grid.few) {
        static_assert(GREY_VERTEX_LIGHTS == 4);
        const Float8x4 lights = on.few(values);
        const auto lit = [&](int n, Float8 light) { return (shadow & grid.bits[1 + n]) != 0 ? none : light; };
        const Float8 sum = lights.a + lit(0, lights.b) + lit(1, lights.c) + lit(2, lights.d);
        return { sum, sum, sum };
    }
    const auto channel = [&](const float* own) {
        Float8 sum = on.shown(own);
        for (int n = 0; n < casting; ++n)
            sum += (shadow & grid.bits[1 + n]) != 0 ? none : on.shown(own + 1 + n);
        return sum;
    };
    const Float8 first = channel(values);
    if (grid.grey)
        return { first, first, first };
    return { first, channel(values + grid.each), channel(values + 2 * grid.each) };
}

}  // namespace warpcam
