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
    Float3Int place;  // position of a spot [m], direction to a directional light; w: the light's bit of a shadow mask
    Float3Int axis;  // direction that a spot shines in, position of a directional light; w: bits of the cosine of its
    // cutoff, -2 where it has none
    Float3Int falloff;  // constant, linear, quadratic; w: bits of a spot's exponent
    Float3Int ambient;  // w: LightFlags
    Float3Int diffuse;  // w: bits of 1 + the squared length of a directional light's `place`
    Float3Int specular;  // w: where it `dims`, bits of the width of its MapSize
};

enum LightFlags { SPOT = 1, FADES = 2, CASTS = 4, AMBIENT = 8 };

// The lights of a world that count, and what does not depend on where a surface is.
struct LightList {
    Light lights[MAX_LIGHTS];
    Vec3 ambient;  // all of it but that of spots and of lights that shadows may take
    int count;
    int used;  // 1: some light is on, so that none is everywhere
    int colored;  // 1: some light has a hue
    int dims;  // 1: some light does
    float near;  // of their MapSize
};

// True if the shadow of a light also takes its ambient part from surfaces that face away from it.
WARPCAM_DEVICE bool dims(const Light& light) { return (light.ambient.w & (CASTS | AMBIENT)) == (CASTS | AMBIENT); }

WARPCAM_DEVICE bool has_hue(const Float3Int& color) { return color.x != color.y || color.x != color.z; }

template <bool SHADOWS, class Lights>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE Light load_light(const Lights& lights, const Camera& camera, int world, int index,
                                                     int place)
{
    const Vec3 direction = transform_transposed(camera.rotation, as_vec3(per_world(lights.directions, world, index)));
    const Vec3 position = as_vec3(per_world(lights.positions, world, index));
    const bool spot = per_world(lights.types, world, index) == LIGHT_SPOT;
    const float cutoff = per_world(lights.cutoff, world, index);
    const Vec3 falloff = as_vec3(per_world(lights.attenuation, world, index));
    const bool fades = spot && (falloff.y != 0.0f || falloff.z != 0.0f);
    // Values that OpenGL accepts; any other value leaves a spot without a cone, or without a falloff to its sides.
    const bool wide = !(cutoff >= 0.0f && cutoff <= 90.0f);
    const float exponent = per_world(lights.exponent, world, index);
    const bool even = wide || !(exponent >= 0.0f && exponent <= 128.0f);
    const float strength = spot && !fades ? 1.0f / max(falloff.x, 1.0e-12f) : 1.0f;
    const Vec3 ambient = strength * as_vec3(per_world(lights.ambient, world, index));
    int flags = (spot ? SPOT : 0) | (fades ? FADES : 0);
    if (SHADOWS && per_world(lights.casts_shadow, world, index))
        flags |= CASTS;
    if ((SHADOWS || spot) && (ambient.x != 0.0f || ambient.y != 0.0f || ambient.z != 0.0f))
        flags |= AMBIENT;
    Light light;
    light.place = make_float3_int(spot ? transform_transposed(camera.rotation, position - camera.origin) : -direction,
                                  SHADOWS ? 1 << place : 0);
    light.axis = make_float3_int(spot ? direction : transform_transposed(camera.rotation, position - camera.origin),
                                 as_int(wide ? -2.0f : cos(0.017453292519943295f * cutoff)));
    light.falloff = make_float3_int(falloff, as_int(even ? 0.0f : exponent));
    light.ambient = make_float3_int(ambient, flags);
    light.diffuse = make_float3_int(strength * as_vec3(per_world(lights.diffuse, world, index)),
                                    as_int(1.0f + dot(direction, direction)));
    light.specular = make_float3_int(strength * as_vec3(per_world(lights.specular, world, index)), 0);
    if (SHADOWS && dims(light))
        light.specular.w = as_int(map_size(lights, !spot, cutoff).width);
    return light;
}

constexpr int WARP_OR_ONE = THREADS < WARP_SIZE ? THREADS : WARP_SIZE;  // threads that fill a list of lights: one warp

WARPCAM_DEVICE void team_barrier()
{
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
}

// Fills the list; all lanes of one warp take part. `first` is where the headlight's colours begin.
template <bool SHADOWS, class Lights>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE void gather_lights(const Lights& lights, const Camera& camera, int world, int first,
                                                       int lane, LightList& list)
{
    const int total = lights.types.shape[1];
    const Vec3 ambient = as_vec3(wp::index(lights.headlight, first)),
               diffuse = as_vec3(wp::index(lights.headlight, first + 1)),
               specular = as_vec3(wp::index(lights.headlight, first + 2));
    const bool headlight = headlight_shines(lights);
    if (lane == 0) {
        list.lights[0].place = { 0.0f, 0.0f, 1.0f, 0 };
        list.lights[0].ambient = make_float3_int(ambient, 0);
        list.lights[0].diffuse = make_float3_int(diffuse, as_int(2.0f));
        list.lights[0].specular = make_float3_int(specular, 0);
        list.count = list.used = headlight;
    }
    team_barrier();
    for (int light = lane; light < total; light += WARP_OR_ONE) {
        ActiveLights lights_before = active_lights(lights);
        for (int other = 0; other < light; ++other)
            lights_before.next(lights, world, other);
        const int place = lights_before.next(lights, world, light);
        if (lights_before.given > 0)
            list.used = 1;
        if (place >= 0) {
            list.lights[headlight + place] = load_light<SHADOWS>(lights, camera, world, light, place);
            atomic_append(list.count);
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
                list.ambient = list.ambient + as_vec3(light.ambient);
            if (has_hue(light.ambient) || has_hue(light.diffuse) || has_hue(light.specular))
                list.colored = 1;
            if (SHADOWS && dims(light))
                list.dims = 1;
        }
    }
    team_barrier();
}

// Vertex of a facet as all lights need it: the unit direction to the centre of projection and its length [m], and the
// product of that direction with the normal.
template <class Vector> struct LightingVertexOf {
    Vector to_eye, normal;
    NumberOf<Vector> reach, slant;
};

using LightingVertex = LightingVertexOf<Vec3>;

template <class Vector> WARPCAM_DEVICE LightingVertexOf<Vector> vertex_at(Vector place, Vector normal)
{
    using Number = NumberOf<Vector>;
    const Number square = dot(place, place), rate = rsqrt(square), none = 0.0f;
    LightingVertexOf<Vector> vertex { -(rate * place), normal, square * rate, none };
    vertex.slant = dot(vertex.to_eye, normal);
    return vertex;
}

// Vertex as seen by a ray that starts at `eye` instead of the centre of projection.
struct OffsetRayVertex : LightingVertex {
    Vec3 place;
};

WARPCAM_DEVICE OffsetRayVertex vertex_at(Vec3 place, Vec3 normal, Vec3 eye)
{
    return { vertex_at(place - eye, normal), place };
}

// From a corner to a place.
template <class Vector> WARPCAM_DEVICE Vector from_vertex(const LightingVertexOf<Vector>& vertex, Vector place)
{
    return place + vertex.reach * vertex.to_eye;
}
WARPCAM_DEVICE Vec3 from_vertex(const OffsetRayVertex& vertex, Vec3 place) { return place - vertex.place; }

// A spot's strength at a corner, before its cone.
template <class Vertex_> WARPCAM_DEVICE float faded(const Light& light, const Vertex_& vertex)
{
    const Vec3 offset = from_vertex(vertex, as_vec3(light.place));
    const float distance = sqrt(dot(offset, offset));
    return rcp(max(light.falloff.x + distance * (light.falloff.y + distance * light.falloff.z), 1.0e-12f));
}

// Weights of a light's ambient, diffuse and specular colours at a vertex.
template <class Number> struct LightWeights {
    Number ambient, diffuse, specular;
};

// Direction of a light from a vertex, its strength there, and its cosine.
struct LightDirection {
    Vec3 to_light;  // unit but for directional lights, whose length is theirs
    float strength, facing;
};

template <bool IS_SPOT, class Vertex_>
WARPCAM_DEVICE LightDirection arrival_of(const Light& light, const Vertex_& vertex, float strength)
{
    LightDirection arrival { as_vec3(light.place), strength, 0.0f };
    if (IS_SPOT) {
        const Vec3 offset = from_vertex(vertex, arrival.to_light);
        arrival.to_light = rsqrt(dot(offset, offset)) * offset;
        const float along = -dot(arrival.to_light, as_vec3(light.axis));
        arrival.strength =
            along >= as_float(light.axis.w) ? strength * pow(max(along, MIN_NORMAL), as_float(light.falloff.w)) : 0.0f;
    }
    arrival.facing = dot(vertex.normal, arrival.to_light);
    return arrival;
}

// The cosine between a normal and halfway between the directions to the light and to the eye, not below zero. `length`
// is that to the light, squared, and 1.
template <class Vector> WARPCAM_DEVICE NumberOf<Vector> highlight_of(const LightingVertexOf<Vector>& vertex,
                                                                     Vector to_light, NumberOf<Vector> facing,
                                                                     float length)
{
    const NumberOf<Vector> halfway = length + 2.0f * dot(to_light, vertex.to_eye);  // the squared length of their sum
    return saturate((facing + vertex.slant) * rsqrt(halfway));
}

template <bool IS_SPOT> WARPCAM_DEVICE LightWeights<float> share_of(const Light& light, const LightingVertex& vertex,
                                                                    const LightDirection& arrival, float exponent)
{
    const float highlight =
        highlight_of(vertex, arrival.to_light, arrival.facing, IS_SPOT ? 2.0f : as_float(light.diffuse.w));
    const float highlight_power = pow(max(highlight, MIN_NORMAL), exponent);
    return { arrival.strength, arrival.strength * max(arrival.facing, 0.0f),
             arrival.facing > 0.0f ? arrival.strength * highlight_power : 0.0f };
}

// Light that a surface sends to the camera, before its texture: all of it, and the part that a display shows, clipped to
// [0, 1]. With shadows each light that casts one is drawn on its own: it is clipped, textured and then added to the
// rest, so that the sum can pass 1 where the texture is dark.
template <class Vector> struct LitColorOf {
    Vector linear, display;
};

using LitColor = LitColorOf<Vec3>;

WARPCAM_DEVICE Vec3 clip(Vec3 color) { return { saturate(color.x), saturate(color.y), saturate(color.z) }; }

// A sum of light: in three channels, or in one where no light has a hue.
template <class Vector> WARPCAM_DEVICE void add(Vector& sum, NumberOf<Vector> share, const Float3Int& color)
{
    sum = sum + share * broadcast<Vector>(as_vec3(color));
}
WARPCAM_DEVICE void add(float& sum, float share, const Float3Int& color) { sum += share * color.x; }
template <class Vector> WARPCAM_DEVICE Vector in_channels(Vector sum) { return sum; }
template <class Vector> WARPCAM_DEVICE Vector in_channels(NumberOf<Vector> sum) { return { sum, sum, sum }; }

// The light at a corner: what the surface reflects in its own colour, and its highlights.
template <class Sum> struct LightSum {
    Sum matt, gloss;
};

template <class Sum, class Number>
WARPCAM_DEVICE void add_share(LightSum<Sum>& light_sum, const LightWeights<Number>& share, const Light& light)
{
    add(light_sum.matt, share.diffuse, light.diffuse);
    add(light_sum.gloss, share.specular, light.specular);
    if (light.ambient.w & AMBIENT)
        add(light_sum.matt, share.ambient, light.ambient);
}

template <class Vector, class Sum>
WARPCAM_DEVICE Vector reflected(const LightSum<Sum>& light_sum, Vec3 base, const ResolvedMaterial& material)
{
    return broadcast<Vector>(base)
           + mul(in_channels<Vector>(light_sum.matt), broadcast<Vector>(as_vec3(material.color)))
           + material.gloss.y * in_channels<Vector>(light_sum.gloss);
}

// The light of one light that casts shadows, reflected.
template <class Vector, class Sum>
WARPCAM_DEVICE Vector reflected(const LightSum<Sum>& light_sum, const Reflectance& reflectance)
{
    return mul(in_channels<Vector>(light_sum.matt), broadcast<Vector>(reflectance.matt))
           + reflectance.gloss * in_channels<Vector>(light_sum.gloss);
}

// Light that a surface emits or reflects wherever lights are.
WARPCAM_DEVICE Vec3 always_on(const LightList& list, const ResolvedMaterial& material)
{
    return mul(as_vec3(material.color), Vec3 { material.gloss.x + list.ambient.x, material.gloss.x + list.ambient.y,
                                               material.gloss.x + list.ambient.z });
}

template <bool IS_SPOT, int CORNERS, bool SHADOWS, class Vertex_, class Material_, class Sum>
WARPCAM_DEVICE void add_light(const Light& light, float strength, const Vertex_* corners, const float* weights,
                              const Material_& material, LightSum<Sum>* light_sums, LitColor& casting)
{
    LightDirection arrivals[CORNERS];
    bool lit = false;
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        arrivals[k] = arrival_of<IS_SPOT>(light, corners[k], strength);
        lit |= arrivals[k].strength > 0.0f && (arrivals[k].facing > 0.0f || (light.ambient.w & AMBIENT));
    }
    if (!warp_any(lit))
        return;
    if (IS_SPOT && (light.ambient.w & FADES))
        for (int k = 0; k < CORNERS; ++k)
            arrivals[k].strength *= faded(light, corners[k]);
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        const LightWeights<float> share = share_of<IS_SPOT>(light, corners[k], arrivals[k], material.gloss.z);
        if (!SHADOWS || !(light.ambient.w & CASTS)) {
            add_share(light_sums[k], share, light);
        } else {
            LightSum<Sum> own {};
            add_share(own, share, light);
            const Vec3 added = reflected<Vec3>(own, of_casting(material));
            casting.linear = casting.linear + weights[k] * added;
            casting.display = casting.display + weights[k] * clip(added);
        }
    }
}

template <int CORNERS, bool SHADOWS, class Sum, class Material_, class... Eye_>
WARPCAM_DEVICE LitColor illuminate_as(const LightList& list, const GouraudTriangle& gouraud, const Material_& material,
                                      int shadow, Eye_... eye)
{
    const float weights[3] = { 1.0f - gouraud.weight1 - gouraud.weight2, gouraud.weight1, gouraud.weight2 };
    decltype(vertex_at(gouraud.place[0], gouraud.normal[0], eye...)) corners[CORNERS];
    LightSum<Sum> light_sums[CORNERS];
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        corners[k] = vertex_at(gouraud.place[k], gouraud.normal[k], eye...);
        light_sums[k] = {};
    }
    LitColor lit { { 0.0f, 0.0f, 0.0f }, { 0.0f, 0.0f, 0.0f } };
#pragma unroll 1
    for (int n = 0; n < list.count; ++n) {
        const Light& light = list.lights[n];
        const float strength = SHADOWS && (light.place.w & shadow) ? 0.0f : 1.0f;
        if (light.ambient.w & SPOT)
            add_light<true, CORNERS, SHADOWS>(light, strength, corners, weights, material, light_sums, lit);
        else
            add_light<false, CORNERS, SHADOWS>(light, strength, corners, weights, material, light_sums, lit);
    }
    const Vec3 base = always_on(list, material);
#pragma unroll
    for (int k = 0; k < CORNERS; ++k) {
        const Vec3 steady = reflected<Vec3>(light_sums[k], base, material);
        lit.linear = lit.linear + weights[k] * steady;
        lit.display = lit.display + weights[k] * clip(steady);
    }
    return lit;
}

// The light of a facet's corners, or with CORNERS == 1 of its place. Bit l of `shadow` says that light l, of
// those that are kept, does not reach it. `eye`: where the ray begins that sees it, if not where the camera is.
template <int CORNERS, bool SHADOWS, class Material_, class... Eye_>
WARPCAM_DEVICE LitColor light_vertices(const LightList& list, const GouraudTriangle& gouraud, const Material_& material,
                                       int shadow, Eye_... eye)
{
    if (list.colored)
        return illuminate_as<CORNERS, SHADOWS, Vec3>(list, gouraud, material, shadow, eye...);
    return illuminate_as<CORNERS, SHADOWS, float>(list, gouraud, material, shadow, eye...);
}

}  // namespace warpcam
