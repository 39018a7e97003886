// Light on a surface: the fixed-function lighting that MuJoCo's renderer uses.
//
// A light gives `attenuation * spot * (ambient * colour + max(n.l, 0) * diffuse * colour + [n.l > 0] * max(n.h, 0)^e *
// specular)`; h is halfway between the directions to the light and to the centre of projection. Emission and the
// light that is everywhere come on top. A textured surface multiplies all of it, highlights included, by its texture.
#pragma once
#include "facet.h"

namespace warpcam {

enum LightType { LIGHT_SPOT, LIGHT_DIRECTIONAL };  // values of types.py

// OpenGL has this many lights, and so has MuJoCo's renderer: the headlight, where it shines, and the first active ones.
constexpr int MAX_LIGHTS = 8;

// One light in the camera's frame. The first three rows are all that light without a hue needs.
struct Light {
    Row place;  // position of a spot [m], direction to a directional light; w: the light's bit of a shadow mask
    Row glow;   // diffuse, specular in red; a spot's exponent, else 1 + the squared length of `place`; w: Nature
    Row axis;   // direction that a spot shines in; w: bits of the cosine of its cutoff, -2 where it has none
    Row falloff;  // constant, linear, quadratic; w unused
    Row ambient, diffuse, specular;  // w unused
};

enum Nature { SPOT = 1, FADES = 2, CASTS = 4, AMBIENT = 8 };

// The lights of a world that count, and what does not depend on where a surface is.
struct LightList {
    Light lights[MAX_LIGHTS];
    Vec ambient;  // all of it but that of spots and of lights that shadows may take
    int count;
    int headlight;  // 1: it shines, and is the first of the lights
    int used;     // 1: some light is on, so that none is everywhere
    int colored;  // 1: some light has a hue
};

WARPCAM_FN bool has_hue(const Row& color) { return color.x != color.y || color.x != color.z; }

template <class Lights> WARPCAM_FN bool gives_light(const Lights& lights, int world, int light)
{
    const int type = row_of(lights.types, world, light);
    return type == LIGHT_SPOT || type == LIGHT_DIRECTIONAL;
}

template <class Lights> WARPCAM_FN bool shines(const Lights& lights, int world, int light)
{
    return row_of(lights.active, world, light);
}

template <bool SHADOWS, class Lights>
WARPCAM_FN Light load_light(const Lights& lights, const Camera& camera, int world, int index)
{
    const Vec direction = turned_back(camera.rotation, to_vec(row_of(lights.directions, world, index)));
    const Vec position = to_vec(row_of(lights.positions, world, index));
    const bool spot = row_of(lights.types, world, index) == LIGHT_SPOT;
    const float cutoff = row_of(lights.cutoff, world, index);
    const Vec falloff = to_vec(row_of(lights.attenuation, world, index));
    const bool fades = spot && (falloff.y != 0.0f || falloff.z != 0.0f);
    const bool wide = !(cutoff < 180.0f);
    const float strength = spot && !fades ? 1.0f / upper(falloff.x, 1.0e-12f) : 1.0f;
    const Vec ambient = strength * to_vec(row_of(lights.ambient, world, index));
    int nature = (spot ? SPOT : 0) | (fades ? FADES : 0);
    if (SHADOWS && row_of(lights.casts_shadow, world, index))
        nature |= CASTS;
    if ((SHADOWS || spot) && (ambient.x != 0.0f || ambient.y != 0.0f || ambient.z != 0.0f))
        nature |= AMBIENT;
    const Vec diffuse = strength * to_vec(row_of(lights.diffuse, world, index));
    const Vec specular = strength * to_vec(row_of(lights.specular, world, index));
    const float exponent = wide ? 0.0f : row_of(lights.exponent, world, index);
    Light light;
    light.place = to_row(spot ? turned_back(camera.rotation, position - camera.origin) : -direction,
                         SHADOWS && index < 32 ? 1 << index : 0);
    light.glow = { diffuse.x, specular.x, spot ? exponent : 1.0f + dot(direction, direction), nature };
    light.axis = to_row(direction, as_int(wide ? -2.0f : cosine(0.017453292519943295f * cutoff)));
    light.falloff = to_row(falloff, 0);
    light.ambient = to_row(ambient, 0);
    light.diffuse = to_row(diffuse, 0);
    light.specular = to_row(specular, 0);
    return light;
}

constexpr int TEAM = THREADS < LANES ? THREADS : LANES;  // threads that fill a list of lights: one warp

WARPCAM_FN void team_barrier()
{
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
}

// Fills the list; all lanes of one warp take part.
template <bool SHADOWS, class Lights>
WARPCAM_FN void gather_lights(const Lights& lights, const Camera& camera, int world, int lane, LightList& list)
{
    const int total = lights.types.shape[1];
    const Vec ambient = to_vec(wp::index(lights.headlight, 0)), diffuse = to_vec(wp::index(lights.headlight, 1)),
              specular = to_vec(wp::index(lights.headlight, 2));
    const Vec sum = ambient + diffuse + specular;
    const bool headlight = dot(sum, sum) > 0.0f;
    const int slots = headlight ? MAX_LIGHTS - 1 : MAX_LIGHTS;
    if (lane == 0) {
        list.lights[0].place = { 0.0f, 0.0f, 1.0f, 0 };
        list.lights[0].glow = { diffuse.x, specular.x, 2.0f, 0 };
        list.lights[0].ambient = to_row(ambient, 0);
        list.lights[0].diffuse = to_row(diffuse, 0);
        list.lights[0].specular = to_row(specular, 0);
        list.count = list.headlight = list.used = headlight;
    }
    team_barrier();
    for (int light = lane; light < total; light += TEAM) {
        if (!shines(lights, world, light) || !gives_light(lights, world, light))
            continue;
        list.used = 1;
        int before = 0, kept = 0;  // lights that take a slot, and those of them that give light
        for (int other = 0; other < light; ++other)
            if (shines(lights, world, other)) {
                kept += gives_light(lights, world, other);
                ++before;
            }
        if (before < slots) {
            list.lights[headlight + kept] = load_light<SHADOWS>(lights, camera, world, light);
#if defined(__CUDA_ARCH__)
            atomicAdd(&list.count, 1);
#else
            ++list.count;
#endif
        }
    }
    team_barrier();
    if (lane == 0) {
        const float everywhere = list.used ? 0.0f : lights.global_ambient;
        list.ambient = { everywhere, everywhere, everywhere };
        list.colored = 0;
        for (int n = 0; n < list.count; ++n) {
            const Light& light = list.lights[n];
            if (!(light.glow.w & AMBIENT))
                list.ambient = list.ambient + to_vec(light.ambient);
            if (has_hue(light.ambient) || has_hue(light.diffuse) || has_hue(light.specular))
                list.colored = 1;
        }
    }
    team_barrier();
}

// What a surface sends to the camera, before its texture: all of it, and what a display has of it, which is clipped to
// [0, 1]. With shadows each light that casts one is drawn on its own: it is clipped, textured and then added to the
// rest, so that the sum can pass 1 where the texture is dark.
struct Lit {
    Vec linear, display;
};

WARPCAM_FN Vec clip(Vec color) { return { saturated(color.x), saturated(color.y), saturated(color.z) }; }

WARPCAM_FN void add(Lit& sum, float weight, const Lit& lit)
{
    sum.linear = sum.linear + weight * lit.linear;
    sum.display = sum.display + weight * lit.display;
}

// A sum of light: in three channels, or in one where no light has a hue.
WARPCAM_FN void add(Vec& sum, float share, const Row& color, float) { sum = sum + share * to_vec(color); }
WARPCAM_FN void add(float& sum, float share, const Row&, float red) { sum += share * red; }
WARPCAM_FN Vec in_channels(Vec sum) { return sum; }
WARPCAM_FN Vec in_channels(float sum) { return { sum, sum, sum }; }

// The light at a vertex: what the surface reflects in its own colour, and its highlights.
template <class Sum> struct Glow {
    Sum matt, gloss;
};

template <class Sum> WARPCAM_FN Vec reflected(const Glow<Sum>& glow, Vec base, const Finish& finish)
{
    return base + times(in_channels(glow.matt), to_vec(finish.color)) + finish.gloss.y * in_channels(glow.gloss);
}

// How a light falls on a vertex: the cosine of its angle to the normal, that to the eye, and how strong it is.
struct Arrival {
    float facing, eyewards, strength;
};

WARPCAM_FN Arrival arrival_of(const Light& light, const Row& glow, const Vertex& vertex, Vec to_eye)
{
    const Vec place = to_vec(light.place);
    if (!(glow.w & SPOT))
        return { dot(vertex.normal, place), dot(to_eye, place), 1.0f };
    const Vec offset = place - vertex.place;
    const float square = dot(offset, offset), rate = inverse_root(square);
    const Row axis = light.axis;
    const float along = -rate * dot(offset, to_vec(axis));
    float strength = along >= as_float(axis.w) ? power(upper(along, TINY), glow.z) : 0.0f;
    if (glow.w & FADES) {
        const float distance = square * rate;
        const Row falloff = light.falloff;
        strength *= reciprocal(upper(falloff.x + distance * (falloff.y + distance * falloff.z), 1.0e-12f));
    }
    return { rate * dot(vertex.normal, offset), rate * dot(to_eye, offset), strength };
}

template <class Sum>
WARPCAM_FN void add_shares(Glow<Sum>& sum, const Light& light, const Row& glow, float ambient, float diffuse,
                           float specular)
{
    add(sum.matt, diffuse, light.diffuse, glow.x);
    add(sum.gloss, specular, light.specular, glow.y);
    if (glow.w & AMBIENT)
        add(sum.matt, ambient, light.ambient, light.ambient.x);
}

// `slant` is the cosine of the angle between the normal and the direction to the eye.
template <bool SHADOWS, class Sum>
WARPCAM_FN void add_light(const Light& light, int shadow, const Vertex& vertex, Vec to_eye, float slant,
                          const Finish& finish, Glow<Sum>& steady, Lit& casting)
{
    const Row glow = light.glow;
    Arrival arrival = arrival_of(light, glow, vertex, to_eye);
    if (SHADOWS && (light.place.w & shadow))
        arrival.strength = 0.0f;
    if (!any_lane(arrival.strength > 0.0f && (arrival.facing > 0.0f || (glow.w & AMBIENT))))
        return;
    // Squared length of the sum of the directions to the light and the eye.
    const float halfway = (glow.w & SPOT ? 2.0f : glow.z) + 2.0f * arrival.eyewards;
    const float highlight = saturated((arrival.facing + slant) * inverse_root(halfway));
    const float shine = power(upper(highlight, TINY), finish.gloss.z);
    const float diffuse = arrival.strength * upper(arrival.facing, 0.0f);
    const float specular = arrival.facing > 0.0f ? arrival.strength * shine : 0.0f;
    if (SHADOWS && (glow.w & CASTS)) {
        Glow<Sum> own {};
        add_shares(own, light, glow, arrival.strength, diffuse, specular);
        const Vec added = reflected(own, Vec { 0.0f, 0.0f, 0.0f }, finish);
        add(casting, 1.0f, { added, clip(added) });
    } else {
        add_shares(steady, light, glow, arrival.strength, diffuse, specular);
    }
}

template <bool SHADOWS, class Sum>
WARPCAM_FN Lit illuminate_as(const LightList& list, const Vertex& vertex, const Finish& finish, int shadow)
{
    const Vec to_eye = -(inverse_root(dot(vertex.place, vertex.place)) * vertex.place);
    const float slant = dot(to_eye, vertex.normal);
    Glow<Sum> steady {};
    Lit lit { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
    if (list.headlight) {  // from the camera's middle: along its z axis
        const Light& light = list.lights[0];
        const Row glow = light.glow;
        const float facing = vertex.normal.z;
        const float highlight = saturated((facing + slant) * inverse_root(2.0f + 2.0f * to_eye.z));
        const float shine = power(upper(highlight, TINY), finish.gloss.z);
        add_shares(steady, light, { glow.x, glow.y, 0.0f, 0 }, 0.0f, upper(facing, 0.0f), facing > 0.0f ? shine : 0.0f);
    }
#pragma unroll 1
    for (int n = list.headlight; n < list.count; ++n)
        add_light<SHADOWS>(list.lights[n], shadow, vertex, to_eye, slant, finish, steady, lit);
    const Vec base = times(to_vec(finish.color), Vec { finish.gloss.x + list.ambient.x, finish.gloss.x + list.ambient.y,
                                                       finish.gloss.x + list.ambient.z });
    const Vec rest = reflected(steady, base, finish);
    add(lit, 1.0f, { rest, clip(rest) });
    return lit;
}

// The light that a vertex sends to the camera. Bit l of `shadow` says that light l, of the first 32, does not reach it.
template <bool SHADOWS>
WARPCAM_FN Lit illuminate(const LightList& list, const Vertex& vertex, const Finish& finish, int shadow)
{
    if (list.colored)
        return illuminate_as<SHADOWS, Vec>(list, vertex, finish, shadow);
    return illuminate_as<SHADOWS, float>(list, vertex, finish, shadow);
}

}  // namespace warpcam
