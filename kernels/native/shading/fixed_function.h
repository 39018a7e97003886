// Light on a surface: the fixed-function lighting that MuJoCo's renderer uses.
//
// A light gives `attenuation * spot * (ambient * colour + max(n.l, 0) * diffuse * colour + [n.l > 0] * max(n.h, 0)^e *
// specular)`; h is halfway between the directions to the light and to the centre of projection. Emission and the
// light that is everywhere come on top. A textured surface multiplies all of it, highlights included, by its texture.
#pragma once
#include "shading/gouraud.h"
#include "lights/active_lights.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// One light in the camera's frame.
struct Light {
    Row place;     // position of a spot [m], direction to a directional light; w: the light's bit of a shadow mask
    Row axis;      // direction that a spot shines in, position of a directional light; w: bits of the cosine of its
                   // cutoff, -2 where it has none
    Row falloff;   // constant, linear, quadratic; w: bits of a spot's exponent
    Row ambient;   // w: Nature
    Row diffuse;   // w: bits of 1 + the squared length of a directional light's `place`
    Row specular;  // w: where it `dims`, bits of the width of its MapSize
};

enum Nature { SPOT = 1, FADES = 2, CASTS = 4, AMBIENT = 8 };

// The lights of a world that count, and what does not depend on where a surface is.
struct LightList {
    Light lights[MAX_LIGHTS];
    Vec ambient;  // all of it but that of spots and of lights that shadows may take
    int count;
    int used;     // 1: some light is on, so that none is everywhere
    int colored;  // 1: some light has a hue
    int dims;     // 1: some light does
    float near;   // of their MapSize
};

// Whether the shadow of a light takes its ambient part from what is turned away from it.
WARPCAM_FN bool dims(const Light& light) { return (light.ambient.w & (CASTS | AMBIENT)) == (CASTS | AMBIENT); }

WARPCAM_FN bool has_hue(const Row& color) { return color.x != color.y || color.x != color.z; }

template <bool SHADOWS, class Lights>
WARPCAM_APART WARPCAM_FN Light load_light(const Lights& lights, const Camera& camera, int world, int index, int place)
{
    const Vec direction = turned_back(camera.rotation, to_vec(row_of(lights.directions, world, index)));
    const Vec position = to_vec(row_of(lights.positions, world, index));
    const bool spot = row_of(lights.types, world, index) == LIGHT_SPOT;
    const float cutoff = row_of(lights.cutoff, world, index);
    const Vec falloff = to_vec(row_of(lights.attenuation, world, index));
    const bool fades = spot && (falloff.y != 0.0f || falloff.z != 0.0f);
    // What OpenGL takes; anything else leaves a spot without a cone, or without a falloff to its sides.
    const bool wide = !(cutoff >= 0.0f && cutoff <= 90.0f);
    const float exponent = row_of(lights.exponent, world, index);
    const bool even = wide || !(exponent >= 0.0f && exponent <= 128.0f);
    const float strength = spot && !fades ? 1.0f / upper(falloff.x, 1.0e-12f) : 1.0f;
    const Vec ambient = strength * to_vec(row_of(lights.ambient, world, index));
    int nature = (spot ? SPOT : 0) | (fades ? FADES : 0);
    if (SHADOWS && row_of(lights.casts_shadow, world, index))
        nature |= CASTS;
    if ((SHADOWS || spot) && (ambient.x != 0.0f || ambient.y != 0.0f || ambient.z != 0.0f))
        nature |= AMBIENT;
    Light light;
    light.place = to_row(spot ? turned_back(camera.rotation, position - camera.origin) : -direction,
                         SHADOWS ? 1 << place : 0);
    light.axis = to_row(spot ? direction : turned_back(camera.rotation, position - camera.origin),
                        as_int(wide ? -2.0f : cosine(0.017453292519943295f * cutoff)));
    light.falloff = to_row(falloff, as_int(even ? 0.0f : exponent));
    light.ambient = to_row(ambient, nature);
    light.diffuse = to_row(strength * to_vec(row_of(lights.diffuse, world, index)),
                           as_int(1.0f + dot(direction, direction)));
    light.specular = to_row(strength * to_vec(row_of(lights.specular, world, index)), 0);
    if (SHADOWS && dims(light))
        light.specular.w = as_int(map_size(lights, !spot, cutoff).width);
    return light;
}

constexpr int TEAM = THREADS < LANES ? THREADS : LANES;  // threads that fill a list of lights: one warp

WARPCAM_FN void team_barrier()
{
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
}

// Fills the list; all lanes of one warp take part. `first` is where the headlight's colours begin.
template <bool SHADOWS, class Lights>
WARPCAM_APART WARPCAM_FN void gather_lights(const Lights& lights, const Camera& camera, int world, int first, int lane,
                              LightList& list)
{
    const int total = lights.types.shape[1];
    const Vec ambient = to_vec(wp::index(lights.headlight, first)),
              diffuse = to_vec(wp::index(lights.headlight, first + 1)),
              specular = to_vec(wp::index(lights.headlight, first + 2));
    const bool headlight = headlight_shines(lights);
    if (lane == 0) {
        list.lights[0].place = { 0.0f, 0.0f, 1.0f, 0 };
        list.lights[0].ambient = to_row(ambient, 0);
        list.lights[0].diffuse = to_row(diffuse, as_int(2.0f));
        list.lights[0].specular = to_row(specular, 0);
        list.count = list.used = headlight;
    }
    team_barrier();
    for (int light = lane; light < total; light += TEAM) {
        KeptLights lights_before = kept_lights(lights);
        for (int other = 0; other < light; ++other)
            lights_before.next(lights, world, other);
        const int place = lights_before.next(lights, world, light);
        if (lights_before.given > 0)
            list.used = 1;
        if (place >= 0) {
            list.lights[headlight + place] = load_light<SHADOWS>(lights, camera, world, light, place);
            claimed(list.count);
        }
    }
    team_barrier();
    if (lane == 0) {
        const float everywhere = list.used ? 0.0f : lights.global_ambient;
        list.ambient = { everywhere, everywhere, everywhere };
        list.colored = list.dims = 0;
        list.near = lights.shadow_near;
        for (int n = 0; n < list.count; ++n) {
            const Light& light = list.lights[n];
            if (!(light.ambient.w & AMBIENT))
                list.ambient = list.ambient + to_vec(light.ambient);
            if (has_hue(light.ambient) || has_hue(light.diffuse) || has_hue(light.specular))
                list.colored = 1;
            if (SHADOWS && dims(light))
                list.dims = 1;
        }
    }
    team_barrier();
}

// What a facet's corner is to all lights: the unit direction to the centre of projection and its length [m], and the
// product of that direction with the normal.
struct Vertex {
    Vec to_eye, normal;
    float reach, slant;
};

WARPCAM_FN Vertex vertex_at(Vec place, Vec normal)
{
    const float square = dot(place, place), rate = inverse_root(square);
    Vertex vertex { -(rate * place), normal, square * rate, 0.0f };
    vertex.slant = dot(vertex.to_eye, normal);
    return vertex;
}

// The same as a ray sees it that does not begin there, but at `eye`.
struct SpreadVertex: Vertex {
    Vec place;
};

WARPCAM_FN SpreadVertex vertex_at(Vec place, Vec normal, Vec eye) { return { vertex_at(place - eye, normal), place }; }

// From a corner to a place.
WARPCAM_FN Vec from_vertex(const Vertex& vertex, Vec place) { return place + vertex.reach * vertex.to_eye; }
WARPCAM_FN Vec from_vertex(const SpreadVertex& vertex, Vec place) { return place - vertex.place; }

// A spot's strength at a corner, before its cone.
template <class Vertex_> WARPCAM_FN float faded(const Light& light, const Vertex_& vertex)
{
    const Vec offset = from_vertex(vertex, to_vec(light.place));
    const float distance = root(dot(offset, offset));
    return reciprocal(upper(light.falloff.x + distance * (light.falloff.y + distance * light.falloff.z), 1.0e-12f));
}

// How much a light adds to a corner: of its ambient, diffuse and specular colours.
struct Share {
    float ambient, diffuse, specular;
};

// Where a light is from a corner, and how it falls on it.
struct Arrival {
    Vec to_light;  // unit but for directional lights, whose length is theirs
    float strength, facing;
};

template <bool IS_SPOT, class Vertex_>
WARPCAM_FN Arrival arrival_of(const Light& light, const Vertex_& vertex, float strength)
{
    Arrival arrival { to_vec(light.place), strength, 0.0f };
    if (IS_SPOT) {
        const Vec offset = from_vertex(vertex, arrival.to_light);
        arrival.to_light = inverse_root(dot(offset, offset)) * offset;
        const float along = -dot(arrival.to_light, to_vec(light.axis));
        arrival.strength = along >= as_float(light.axis.w)
            ? strength * power(upper(along, TINY), as_float(light.falloff.w))
            : 0.0f;
    }
    arrival.facing = dot(vertex.normal, arrival.to_light);
    return arrival;
}

template <bool IS_SPOT>
WARPCAM_FN Share share_of(const Light& light, const Vertex& vertex, const Arrival& arrival, float exponent)
{
    // Squared length of the sum of the directions to the light and the eye.
    const float halfway = (IS_SPOT ? 2.0f : as_float(light.diffuse.w)) + 2.0f * dot(arrival.to_light, vertex.to_eye);
    const float highlight = saturated((arrival.facing + vertex.slant) * inverse_root(halfway));
    const float shine = power(upper(highlight, TINY), exponent);
    return { arrival.strength, arrival.strength * upper(arrival.facing, 0.0f),
             arrival.facing > 0.0f ? arrival.strength * shine : 0.0f };
}

// What a surface sends to the camera, before its texture: all of it, and what a display has of it, which is clipped to
// [0, 1]. With shadows each light that casts one is drawn on its own: it is clipped, textured and then added to the
// rest, so that the sum can pass 1 where the texture is dark.
struct Lit {
    Vec linear, display;
};

WARPCAM_FN Vec clip(Vec color) { return { saturated(color.x), saturated(color.y), saturated(color.z) }; }

// A sum of light: in three channels, or in one where no light has a hue.
WARPCAM_FN void add(Vec& sum, float share, const Row& color) { sum = sum + share * to_vec(color); }
WARPCAM_FN void add(float& sum, float share, const Row& color) { sum += share * color.x; }
WARPCAM_FN Vec in_channels(Vec sum) { return sum; }
WARPCAM_FN Vec in_channels(float sum) { return { sum, sum, sum }; }

// The light at a corner: what the surface reflects in its own colour, and its highlights.
template <class Sum> struct Glow {
    Sum matt, gloss;
};

template <class Sum> WARPCAM_FN void add_share(Glow<Sum>& glow, const Share& share, const Light& light)
{
    add(glow.matt, share.diffuse, light.diffuse);
    add(glow.gloss, share.specular, light.specular);
    if (light.ambient.w & AMBIENT)
        add(glow.matt, share.ambient, light.ambient);
}

template <class Sum> WARPCAM_FN Vec reflected(const Glow<Sum>& glow, Vec base, const Finish& finish)
{
    return base + times(in_channels(glow.matt), to_vec(finish.color)) + finish.gloss.y * in_channels(glow.gloss);
}

// The same of a light that casts shadows alone.
template <class Sum> WARPCAM_FN Vec reflected(const Glow<Sum>& glow, const Reflectance& reflectance)
{
    return times(in_channels(glow.matt), reflectance.matt) + reflectance.gloss * in_channels(glow.gloss);
}

// What a surface sends wherever lights are.
WARPCAM_FN Vec always_on(const LightList& list, const Finish& finish)
{
    return times(to_vec(finish.color), Vec { finish.gloss.x + list.ambient.x, finish.gloss.x + list.ambient.y,
                                             finish.gloss.x + list.ambient.z });
}

template <bool IS_SPOT, int CORNERS, bool SHADOWS, class Vertex_, class Finish_, class Sum>
WARPCAM_FN void add_light(const Light& light, float strength, const Vertex_* corners, const float* weights,
                          const Finish_& finish, Glow<Sum>* glows, Lit& casting)
{
    Arrival arrivals[CORNERS];
    bool lit = false;
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        arrivals[k] = arrival_of<IS_SPOT>(light, corners[k], strength);
        lit |= arrivals[k].strength > 0.0f && (arrivals[k].facing > 0.0f || (light.ambient.w & AMBIENT));
    }
    if (!any_lane(lit))
        return;
    if (IS_SPOT && (light.ambient.w & FADES))
        for (int k = 0; k < CORNERS; ++k)
            arrivals[k].strength *= faded(light, corners[k]);
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        const Share share = share_of<IS_SPOT>(light, corners[k], arrivals[k], finish.gloss.z);
        if (!SHADOWS || !(light.ambient.w & CASTS)) {
            add_share(glows[k], share, light);
        } else {
            Glow<Sum> own {};
            add_share(own, share, light);
            const Vec added = reflected(own, of_casting(finish));
            casting.linear = casting.linear + weights[k] * added;
            casting.display = casting.display + weights[k] * clip(added);
        }
    }
}

template <int CORNERS, bool SHADOWS, class Sum, class Finish_, class... Eye_>
WARPCAM_FN Lit illuminate_as(const LightList& list, const Facet& facet, const Finish_& finish, int shadow, Eye_... eye)
{
    const float weights[3] = { 1.0f - facet.weight1 - facet.weight2, facet.weight1, facet.weight2 };
    decltype(vertex_at(facet.place[0], facet.normal[0], eye...)) corners[CORNERS];
    Glow<Sum> glows[CORNERS];
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        corners[k] = vertex_at(facet.place[k], facet.normal[k], eye...);
        glows[k] = {};
    }
    Lit lit { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        const float strength = SHADOWS && (light.place.w & shadow) ? 0.0f : 1.0f;
        if (light.ambient.w & SPOT)
            add_light<true, CORNERS, SHADOWS>(light, strength, corners, weights, finish, glows, lit);
        else
            add_light<false, CORNERS, SHADOWS>(light, strength, corners, weights, finish, glows, lit);
    }
    const Vec base = always_on(list, finish);
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        const Vec steady = reflected(glows[k], base, finish);
        lit.linear = lit.linear + weights[k] * steady;
        lit.display = lit.display + weights[k] * clip(steady);
    }
    return lit;
}

// The light of a facet's corners, or with CORNERS == 1 of its place. Bit l of `shadow` says that light l, of
// those that are kept, does not reach it. `eye`: where the ray begins that sees it, if not where the camera is.
template <int CORNERS, bool SHADOWS, class Finish_, class... Eye_>
WARPCAM_FN Lit illuminate(const LightList& list, const Facet& facet, const Finish_& finish, int shadow, Eye_... eye)
{
    if (list.colored)
        return illuminate_as<CORNERS, SHADOWS, Vec>(list, facet, finish, shadow, eye...);
    return illuminate_as<CORNERS, SHADOWS, float>(list, facet, finish, shadow, eye...);
}

}  // namespace warpcam
