// Light on eight places of one shape, on a CPU: shading/fixed_function.h and shading/plane_vertex_lighting.h, whose
// comments hold here.
#pragma once
#include "shading/plane_vertex_lighting.h"
#include "shading/self_shadow.h"
#include "lights/shadow_extent.h"
#include "shading/surface_simd.h"

namespace warpcam {

struct Vertices {
    Vecs to_eye, normal;
    Floats reach, slant;
};

inline Vertices vertices_at(Vecs place, Vecs normal)
{
    const Floats square = dot(place, place), rate = inverse_root(square);
    Vertices vertex { -(rate * place), normal, square * rate, {} };
    vertex.slant = dot(vertex.to_eye, normal);
    return vertex;
}

struct Arrivals {
    Vecs to_light;
    Floats facing, along, distance;
    Ints shone;  // within its cone
};

// `eye`: where rays begin that see the place, if not where the camera is.
template <class... Eye_> inline Arrivals arrivals_of(const Light& light, const Vertices& vertex, const Eye_&... eye)
{
    Arrivals arrival { eight_of(to_vec(light.place)), {}, {}, {}, (Ints)-1 };
    if (light.ambient.w & SPOT) {
        const Vecs offset = (arrival.to_light - ... - eye) + vertex.reach * vertex.to_eye;
        const Floats square = dot(offset, offset), rate = inverse_root(square);
        arrival.to_light = rate * offset;
        arrival.along = -dot(arrival.to_light, eight_of(to_vec(light.axis)));
        arrival.distance = square * rate;
        arrival.shone = arrival.along >= as_float(light.axis.w);
    }
    arrival.facing = dot(vertex.normal, arrival.to_light);
    return arrival;
}

inline Floats strength_of(const Light& light, const Arrivals& arrival)
{
    Floats strength = 1.0f;
    if (!(light.ambient.w & SPOT))
        return strength;
    const float exponent = as_float(light.falloff.w);
    if (exponent != 0.0f)
        strength = power(upper(arrival.along, (Floats)TINY), exponent);
    if (light.ambient.w & FADES) {
        const Floats loss = light.falloff.x + arrival.distance * (light.falloff.y + arrival.distance * light.falloff.z);
        strength *= reciprocal(upper(loss, (Floats)1.0e-12f));
    }
    return strength;
}

struct Shares {
    Floats ambient, diffuse, specular;
};

template <class Finish_>
inline Shares shares_of(const Light& light, const Vertices& vertex, const Arrivals& arrival, Floats strength,
                        const Finish_& finish)
{
    const Floats none = 0.0f;
    Shares share { strength, strength * upper(arrival.facing, none), none };
    if (finish.gloss.y != 0.0f || of_casting(finish).gloss != 0.0f) {
        const float length = light.ambient.w & SPOT ? 2.0f : as_float(light.diffuse.w);
        const Floats halfway = length + 2.0f * dot(arrival.to_light, vertex.to_eye);
        const Floats highlight = saturated((arrival.facing + vertex.slant) * inverse_root(halfway));
        // h^e is at most exp(-e (1 - h)): where that is nothing anywhere, no power is taken.
        if (!(finish.gloss.z > 0.0f) || any_of(finish.gloss.z * (1.0f - highlight) < 12.0f)) {
            const Floats shine = power(upper(highlight, (Floats)TINY), finish.gloss.z);
            share.specular = arrival.facing > 0.0f ? strength * shine : none;
        }
    }
    return share;
}

inline void add(Vecs& sum, Floats share, const Row& color) { sum = sum + share * eight_of(to_vec(color)); }
inline void add(Floats& sum, Floats share, const Row& color) { sum += share * color.x; }
inline Vecs in_channels(Vecs sum) { return sum; }
inline Vecs in_channels(Floats sum) { return { sum, sum, sum }; }

template <class Sum> inline void add_shares(Glow<Sum>& glow, const Shares& share, const Light& light)
{
    add(glow.matt, share.diffuse, light.diffuse);
    add(glow.gloss, share.specular, light.specular);
    if (light.ambient.w & AMBIENT)
        add(glow.matt, share.ambient, light.ambient);
}

template <class Sum> inline Vecs reflected_by(const Glow<Sum>& glow, Vec base, const Finish& finish)
{
    return eight_of(base) + times(in_channels(glow.matt), eight_of(to_vec(finish.color)))
        + finish.gloss.y * in_channels(glow.gloss);
}

// The same of a light that casts shadows alone.
template <class Sum> inline Vecs reflected_by(const Glow<Sum>& glow, const Reflectance& reflectance)
{
    return times(in_channels(glow.matt), eight_of(reflectance.matt)) + reflectance.gloss * in_channels(glow.gloss);
}

struct Lits {
    Vecs linear, display;
};

// LINEAR: whether light that is not clipped is asked for.
template <bool SHADOWS, bool LINEAR, class Sum, class Finish_, class... Eye_>
static WARPCAM_COLD void illuminate_eight_as(const LightList& list, const Facets& facet, int corners,
                                             const Finish_& finish, Ints shadow, Lits& lit, const Eye_&... eye)
{
    const Floats weights[3] = { 1.0f - facet.weight1 - facet.weight2, facet.weight1, facet.weight2 };
    const Floats none = 0.0f, one = 1.0f;
    const Vec base = always_on(list, finish);
    lit = { { none, none, none }, { none, none, none } };
    const auto reaches = [&](const Light& light) { return SHADOWS ? (shadow & light.place.w) == 0 : (Ints)-1; };
    for (int k = 0; k < corners; ++k) {
        const Vertices vertex = vertices_at((facet.place[k] - ... - eye), facet.normal[k]);
        const Floats weight = corners == 1 ? one : weights[k];
        Glow<Sum> glow {};
        for (int n = 0; n < list.count; ++n) {
            const Light& light = list.lights[n];
            const bool casts = SHADOWS && (light.ambient.w & CASTS);
            const Arrivals arrival = arrivals_of(light, vertex, eye...);
            const Ints reached = arrival.shone & reaches(light);
            if (!any_of(light.ambient.w & AMBIENT ? reached : reached & (arrival.facing > none)))
                continue;
            const Floats strength = reached ? strength_of(light, arrival) : none;
            const Shares share = shares_of(light, vertex, arrival, strength, finish);
            if (!casts) {
                add_shares(glow, share, light);
            } else {
                Glow<Sum> own {};
                add_shares(own, share, light);
                const Vecs added = reflected_by(own, of_casting(finish));
                if (LINEAR)
                    lit.linear = lit.linear + weight * added;
                lit.display = lit.display + weight * clip(added);
            }
        }
        const Vecs steady = reflected_by(glow, base, finish);
        if (LINEAR)
            lit.linear = lit.linear + weight * steady;
        lit.display = lit.display + weight * clip(steady);
    }
}

// By the light on as many corners of the facet, 1 or 3.
template <bool SHADOWS, bool LINEAR, class Finish_, class... Eye_>
inline void illuminate_eight(const LightList& list, const Facets& facet, int corners, const Finish_& finish,
                             Ints shadow, Lits& lit, const Eye_&... eye)
{
    if (list.colored)
        illuminate_eight_as<SHADOWS, LINEAR, Vecs>(list, facet, corners, finish, shadow, lit, eye...);
    else
        illuminate_eight_as<SHADOWS, LINEAR, Floats>(list, facet, corners, finish, shadow, lit, eye...);
}

// As own_shadow().
WARPCAM_APART inline Ints own_shadow_of_eight(const LightList& list, const Camera& camera, const Vecs& place,
                                              const Vecs& normal)
{
    Ints shadow = 0;
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        if (!dims(light))
            continue;
        const bool spot = light.ambient.w & SPOT;
        const ShadowMap map = map_of(list, light, camera);
        const Vecs source = eight_of(to_vec(light.place));
        Floats along;
        Ints dark = ~(dot(normal, spot ? source - place : source) > 0.0f);
        if (map.bounded)
            dark &= has_place(map, !spot, place, along);
        shadow |= dark & light.place.w;
    }
    return shadow;
}

// What eight corners of a plane show; `stride` numbers apart.
template <class Sum, bool SHADOWS>
inline void light_eight_corners(const LightList& list, Vecs place, Vecs normal, const Finish& finish, int stride,
                                int count, float* values)
{
    constexpr int CHANNELS = sizeof(Sum) / sizeof(Floats);
    const auto keep = [&](Vecs color, int slot) {
        for (int k = 0; k < count; ++k) {
            values[k * stride + slot] = color.x[k];
            if (CHANNELS == 3) {
                values[k * stride + slot + 1] = color.y[k];
                values[k * stride + slot + 2] = color.z[k];
            }
        }
    };
    const Vertices vertex = vertices_at(place, normal);
    Glow<Sum> steady {};
    int slot = CHANNELS;
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        const Arrivals arrival = arrivals_of(light, vertex);
        const Floats strength = arrival.shone ? strength_of(light, arrival) : (Floats)0.0f;
        const Shares share = shares_of(light, vertex, arrival, strength, finish);
        if (SHADOWS && (light.ambient.w & CASTS)) {
            Glow<Sum> own {};
            add_shares(own, share, light);
            keep(clip(reflected_by(own, of_casting(finish))), slot);
            slot += CHANNELS;
        } else {
            add_shares(steady, share, light);
        }
    }
    keep(clip(reflected_by(steady, always_on(list, finish), finish)), 0);
}

// As light_corners().
template <class Grid, class Looks>
WARPCAM_APART inline void light_all_corners(Grid& grid, const LightList& list, const Looks& look)
{
    if (grid.shape < 0)
        return;
    const Vec eye = look.pose.eye();
    const Vecs normal = eight_of(look.pose.seen({ 0.0f, 0.0f, 1.0f }));
    const int total = grid.columns * grid.rows;
    for (int first = 0; first < total; first += PACKET) {
        Vecs local;
        for (int k = 0; k < PACKET; ++k) {
            const int i = lower_int(first + k, total - 1), row = int(unsigned(i) / unsigned(grid.columns));
            put_one(local, k, { corner_of(look.cells.u, float(grid.first_u + i - row * grid.columns)) - eye.x,
                                corner_of(look.cells.v, float(grid.first_v + row)) - eye.y, -eye.z });
        }
        const Vecs place = look.pose.seen(local);
        const int count = lower_int(PACKET, total - first);
        float* const values = grid.values + first * grid.stride;
        if (grid.few)
            for (int k = 0; k < count; ++k)
                for (int n = 1 + grid.casting; n < FEW; ++n)
                    values[k * grid.stride + n] = 0.0f;
        if (grid.grey)
            light_eight_corners<Floats, Grid::SHADOWS>(list, place, normal, look.finish, grid.stride, count, values);
        else
            light_eight_corners<Vecs, Grid::SHADOWS>(list, place, normal, look.finish, grid.stride, count, values);
    }
}

// As OnCorners.
struct OnCornersOfEight {
    Ints first, second, third, inside;
    Floats weight1, weight2, weight3;
    bool together;  // all in one triangle

    // Rows of FEW numbers.
    Columns few(const float* values) const
    {
        if (together)
            return { of_one(values), of_one(values + 1), of_one(values + 2), of_one(values + 3) };
        const Columns a = gather_rows(values, first >> 2), b = gather_rows(values, second >> 2);
        const Columns c = gather_rows(values, third >> 2);
        return { weight1 * a.a + weight2 * b.a + weight3 * c.a, weight1 * a.b + weight2 * b.b + weight3 * c.b,
                 weight1 * a.c + weight2 * b.c + weight3 * c.c, weight1 * a.d + weight2 * b.d + weight3 * c.d };
    }

    Floats of_one(const float* values) const
    {
        return weight1 * values[first[0]] + weight2 * values[second[0]] + weight3 * values[third[0]];
    }

    Floats shown(const float* values) const
    {
        if (together)
            return of_one(values);
        return weight1 * gather(values, first) + weight2 * gather(values, second) + weight3 * gather(values, third);
    }
};

inline Floats on_axis(const CellAxis& axis, Floats x)
{
    const Floats cell = axis.rate * x + axis.start;
    return cell + axis.stretch * (cell - between(cell, (Floats)axis.low, (Floats)axis.high));
}

template <class Grid> inline OnCornersOfEight on_corners(const Grid& grid, Vecs local)
{
    const Floats u = on_axis(grid.u, local.x), v = on_axis(grid.v, local.y);
    const Floats whole_u = round_down(u), whole_v = round_down(v), none = 0.0f;
    const Floats a = u - whole_u, b = v - whole_v;
    const Ints high = a + b > 1.0f;
    OnCornersOfEight on;
    on.inside = (whole_u >= none) & (whole_v >= none) & (whole_u < float(grid.columns - 1))
        & (whole_v < float(grid.rows - 1));
    const Ints row = to_whole(on.inside ? whole_v : none), column = to_whole(on.inside ? whole_u : none);
    const Ints corner = on.inside & (row * grid.columns + column);
    const Ints beyond = on.inside & (Ints)-1;
    on.first = (corner + (high & beyond & (grid.columns + 1))) * grid.stride;
    on.second = (corner + (beyond & 1)) * grid.stride;
    on.third = (corner + (beyond & grid.columns)) * grid.stride;
    on.together = !any_of((on.first != on.first[0]) | (on.second != on.second[0]));
    on.weight2 = high ? 1.0f - b : a;
    on.weight3 = high ? 1.0f - a : b;
    on.weight1 = 1.0f - on.weight2 - on.weight3;
    return on;
}

template <class Grid> inline Vecs light_from_corners(const Grid& grid, const OnCornersOfEight& on, Ints shadow)
{
    const float* const values = grid.values;
    const Floats none = 0.0f;
    const int casting = Grid::SHADOWS ? grid.casting : 0;
    if (Grid::SHADOWS && grid.few) {
        static_assert(FEW == 4);
        const Columns lights = on.few(values);
        const auto lit = [&](int n, Floats light) { return (shadow & grid.bits[n]) != 0 ? none : light; };
        const Floats sum = lights.a + lit(0, lights.b) + lit(1, lights.c) + lit(2, lights.d);
        return { sum, sum, sum };
    }
    if (grid.grey) {
        Floats sum = on.shown(values);
        for (int n = 0; n < casting; ++n)
            sum += (shadow & grid.bits[n]) != 0 ? none : on.shown(values + 1 + n);
        return { sum, sum, sum };
    }
    Vecs sum { on.shown(values), on.shown(values + 1), on.shown(values + 2) };
    for (int n = 0; n < casting; ++n) {
        const float* const own = values + 3 + 3 * n;
        const Ints dark = (shadow & grid.bits[n]) != 0;
        sum = sum + chosen(dark, { none, none, none }, { on.shown(own), on.shown(own + 1), on.shown(own + 2) });
    }
    return sum;
}

}  // namespace warpcam
