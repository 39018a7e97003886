// Lights of physically based scenes: how much of each arrives at a place, from where, and how wide it is.
//
// Any light is to a surface what a sphere would be: a direction, and the squared sine of the angle from its middle to
// its edge, its spread. For a sphere, a disk on its axis, a rectangle and a thin cylinder whose whole the surface sees,
// what arrives is exact; where the horizon cuts a light, it is cut as a sphere is (Lagarde and de Rousiers, "Moving
// Frostbite to Physically Based Rendering", 2014, section 4.7).
#pragma once
#include "lights/active_lights.h"
#include "camera/shape_setup.h"
#include "shading/fixed_function.h"
#include "shading/environment.h"

namespace warpcam {

enum Form { FORM_POINT, FORM_SPHERE, FORM_DISK, FORM_RECTANGLE, FORM_CYLINDER };  // values of types.py

// One light in the camera's frame. Its colours are what a white surface that faces it shows: of a distant light
// anywhere, of a point as its falloff has it, of all else its radiance.
struct AreaLight {
    Float3Int place;  // position [m], direction to a distant light; w: the light's bit of a shadow mask
    Float3Int axis;  // direction that it shines in; w: bits of the cosine of its cutoff, -2 where it has none
    Float3Int across;  // unit, of a rectangle along its width, of a cylinder along itself; w: Form
    Float3Int size;  // as in types.py: PhysicalLights.sizes; w unused
    Float3Int falloff;  // of a point: constant, linear, quadratic; w: bits of a spot's exponent
    Float3Int diffuse;  // w: LightFlags
    Float3Int specular;  // w unused
    Float3Int ambient;  // w unused
};

// The lights of a world that count.
struct AreaLights {
    AreaLight area_lights[MAX_LIGHTS];
    Sky sky;
    int count;
};

template <bool SHADOWS, class Physical> WARPCAM_DEVICE AreaLight load_area_light(const Physical& physical,
                                                                                 const Camera& camera, int world,
                                                                                 int index, int place)
{
    const auto& lights = physical.plain;
    const Vec3 direction = transform_transposed(camera.rotation, as_vec3(per_world(lights.directions, world, index)));
    const Vec3 position = as_vec3(per_world(lights.positions, world, index));
    const bool local = per_world(lights.types, world, index) == LIGHT_SPOT;
    const float cutoff = per_world(lights.cutoff, world, index);
    const Vec3 ambient = as_vec3(per_world(lights.ambient, world, index));
    const auto turn = wp::index(physical.rotations, world, index);
    const bool wide = !local || !(cutoff < 180.0f);
    int flags = local ? SPOT : 0;
    if (SHADOWS && per_world(lights.casts_shadow, world, index))
        flags |= CASTS;
    if (ambient.x != 0.0f || ambient.y != 0.0f || ambient.z != 0.0f)
        flags |= AMBIENT;
    AreaLight area_light;
    area_light.place = make_float3_int(local ? transform_transposed(camera.rotation, position - camera.origin)
                                             : -normalized(direction),
                                       SHADOWS ? 1 << place : 0);
    area_light.axis = make_float3_int(direction, as_int(wide ? -2.0f : cos(0.017453292519943295f * cutoff)));
    area_light.across =
        make_float3_int(transform_transposed(camera.rotation, { turn.data[0][0], turn.data[1][0], turn.data[2][0] }),
                        per_world(physical.forms, world, index));
    area_light.size = make_float3_int(as_vec3(per_world(physical.sizes, world, index)), 0);
    area_light.falloff = make_float3_int(as_vec3(per_world(lights.attenuation, world, index)),
                                         as_int(wide ? 0.0f : per_world(lights.exponent, world, index)));
    area_light.diffuse = make_float3_int(as_vec3(per_world(lights.diffuse, world, index)), flags);
    area_light.specular = make_float3_int(as_vec3(per_world(lights.specular, world, index)), 0);
    area_light.ambient = make_float3_int(ambient, 0);
    return area_light;
}

template <class Physical> WARPCAM_DEVICE void gather_sky(const Physical& physical, int world, int first, Sky& sky)
{
    sky.world = world;
    sky.uneven = 0;
    for (int term = 0; term < SKY_TERMS; ++term) {
        sky.terms[term] = as_vec3(per_world(physical.sky, world, term));
        if (term > 0 && dot(sky.terms[term], sky.terms[term]) > 0.0f)
            sky.uneven = 1;
    }
    sky.gain = as_vec3(per_world(physical.sky, world, SKY_TERMS));
    sky.terms[0] = sky.terms[0] + as_vec3(wp::index(physical.plain.headlight, first));
}

// Fills the list; all lanes of one warp take part. `first` is where the headlight's colours begin.
template <bool SHADOWS, class Physical>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE void gather_lights(const Physical& physical, const Camera& camera, int world,
                                                       int first, int lane, AreaLights& list)
{
    const auto& lights = physical.plain;
    const bool headlight = headlight_shines(lights);
    if (lane == 0) {
        list.area_lights[0] = {};
        list.area_lights[0].place = { 0.0f, 0.0f, 1.0f, 0 };
        list.area_lights[0].diffuse = make_float3_int(as_vec3(wp::index(lights.headlight, first + 1)), 0);
        list.area_lights[0].specular = make_float3_int(as_vec3(wp::index(lights.headlight, first + 2)), 0);
        list.count = headlight;
        gather_sky(physical, world, first, list.sky);
    }
    team_barrier();
    for (int light = lane; light < lights.types.shape[1]; light += WARP_OR_ONE) {
        ActiveLights lights_before = active_lights(lights);
        for (int other = 0; other < light; ++other)
            lights_before.next(lights, world, other);
        const int place = lights_before.next(lights, world, light);
        if (place >= 0) {
            list.area_lights[headlight + place] = load_area_light<SHADOWS>(physical, camera, world, light, place);
            atomic_append(list.count);
        }
    }
    team_barrier();
}

// Light at a place: from where, how much of its colours if it falls straight, and how wide it seems.
template <class Vector> struct AreaLightSample {
    Vector to_light;
    NumberOf<Vector> share, sine_squared;
};

// The mean direction of what a rectangle sends, as long as its share: Lambert's formula for polygons, over pi.
template <class Vector> WARPCAM_DEVICE Vector from_rectangle(Vector middle, Vec3 across, Vec3 up)
{
    using Number = NumberOf<Vector>;
    const Vector right = broadcast<Vector>(across), above = broadcast<Vector>(up);
    const Vector corners[4] = { middle - right - above, middle + right - above, middle + right + above,
                                middle - right + above };
    const Number none = 0.0f, one = 1.0f, rate = 0.5f / PI;
    Vector sum { none, none, none };
    for (int k = 0; k < 4; ++k) {
        const Vector a = corners[k], b = corners[(k + 1) & 3], normal = cross(a, b);
        const Number sine = sqrt(dot(normal, normal));
        const MaskOf<Vector> some = sine > 1.0e-20f;
        if (any(some))
            sum = sum + (some ? atan2(sine, dot(a, b)) / (some ? sine : one) : none) * normal;
    }
    return (dot(sum, middle) < 0.0f ? -rate : rate) * sum;
}

// Light of a thin cylinder about `axis`: the integral over its length of 2 radius sin(angle) / distance^2, over pi.
template <class Vector> WARPCAM_DEVICE Vector from_cylinder(Vector middle, Vec3 axis, float radius, float half)
{
    using Number = NumberOf<Vector>;
    const Vector axes = broadcast<Vector>(axis);
    const Number along = dot(middle, axes), first = along - half, last = along + half;
    const Vector aside = middle - along * axes;
    const Number h = max(sqrt(dot(aside, aside)), max(radius, 1.0e-6f)), h2 = h * h;
    const Number near = first * first + h2, far = last * last + h2;
    const Number lengthwise = 0.5f / near - 0.5f / far;
    const Number sideways = 0.5f * (last / far - first / near + (atan2(last, h) - atan2(first, h)) / h) / h2;
    return 2.0f * radius * h / PI * (lengthwise * axes + sideways * h * normalized(aside));
}

template <class Vector> WARPCAM_DEVICE AreaLightSample<Vector> sample_light(const AreaLight& area_light, Vector place)
{
    using Number = NumberOf<Vector>;
    const Number none = 0.0f, one = 1.0f;
    if (!(area_light.diffuse.w & SPOT))
        return { broadcast<Vector>(as_vec3(area_light.place)), one, area_light.size.x };
    const Vector offset = broadcast<Vector>(as_vec3(area_light.place)) - place;
    const Number square = max(dot(offset, offset), 1.0e-12f), distance = sqrt(square);
    AreaLightSample<Vector> light_sample { 1.0f / distance * offset, none, none };
    const Number along = -dot(light_sample.to_light, broadcast<Vector>(as_vec3(area_light.axis)));
    const MaskOf<Vector> dark = along < as_float(area_light.axis.w);
    if (!any(!dark))
        return light_sample;
    const int form = area_light.across.w;
    if (form == FORM_POINT) {
        light_sample.share =
            1.0f
            / max(area_light.falloff.x + distance * (area_light.falloff.y + distance * area_light.falloff.z), 1.0e-12f);
    } else if (form == FORM_SPHERE) {
        light_sample.share = light_sample.sine_squared = min(area_light.size.x * area_light.size.x / square, 1.0f);
    } else if (form == FORM_DISK) {
        const float radius = area_light.size.x * area_light.size.x;
        light_sample.share = light_sample.sine_squared = max(along, 0.0f) * radius / (radius + square);
    } else {
        const Vec3 across = as_vec3(area_light.across);
        const Vector sum = form == FORM_RECTANGLE
                               ? from_rectangle(offset, area_light.size.x * across,
                                                area_light.size.y * cross(as_vec3(area_light.axis), across))
                               : from_cylinder(offset, across, area_light.size.x, area_light.size.y);
        light_sample.share = sqrt(dot(sum, sum));
        light_sample.sine_squared = min(light_sample.share, 1.0f);
        const MaskOf<Vector> some = light_sample.share > 1.0e-20f;
        light_sample.to_light = select(some, 1.0f / (some ? light_sample.share : one) * sum, light_sample.to_light);
    }
    const float exponent = as_float(area_light.falloff.w);
    if (exponent != 0.0f)
        light_sample.share *= pow(max(along, MIN_NORMAL), exponent);
    light_sample.share = dark ? none : light_sample.share;
    return light_sample;
}

// The cosine of a light over a surface, or its mean over what the horizon leaves of it.
template <class Number> WARPCAM_DEVICE Number clipped_cosine(Number middle, Number sine_squared)
{
    const Number none = 0.0f, one = 1.0f, whole = max(middle, none);
    const auto cut = !((middle * middle >= sine_squared) | (sine_squared < 1.0e-6f));
    if (!any(cut))
        return whole;
    sine_squared = min(sine_squared, 0.9999f);
    const Number sine = sqrt(max(1.0f - middle * middle, 1.0e-8f)), x = sqrt(1.0f / sine_squared - 1.0f);
    const Number y = clamp(-x * middle / sine, -one, one), part = sine * sqrt(max(1.0f - y * y, 0.0f));
    const Number sum = (middle * acos(y) - x * part) * sine_squared + atan2(part, x);
    return cut ? max(sum / (PI * sine_squared), 0.0f) : whole;
}

}  // namespace warpcam
