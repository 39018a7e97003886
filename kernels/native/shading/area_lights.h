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
struct Lamp {
    Row place;     // position [m], direction to a distant light; w: the light's bit of a shadow mask
    Row axis;      // direction that it shines in; w: bits of the cosine of its cutoff, -2 where it has none
    Row across;    // unit, of a rectangle along its width, of a cylinder along itself; w: Form
    Row size;      // as in types.py: PhysicalLights.sizes; w unused
    Row falloff;   // of a point: constant, linear, quadratic; w: bits of a spot's exponent
    Row diffuse;   // w: Nature
    Row specular;  // w unused
    Row ambient;   // w unused
};

// The lights of a world that count.
struct LampList {
    Lamp lamps[MAX_LIGHTS];
    Sky sky;
    int count;
};

template <bool SHADOWS, class Physical>
WARPCAM_FN Lamp load_lamp(const Physical& physical, const Camera& camera, int world, int index, int place)
{
    const auto& lights = physical.plain;
    const Vec direction = turned_back(camera.rotation, to_vec(row_of(lights.directions, world, index)));
    const Vec position = to_vec(row_of(lights.positions, world, index));
    const bool local = row_of(lights.types, world, index) == LIGHT_SPOT;
    const float cutoff = row_of(lights.cutoff, world, index);
    const Vec ambient = to_vec(row_of(lights.ambient, world, index));
    const auto turn = wp::index(physical.rotations, world, index);
    const bool wide = !local || !(cutoff < 180.0f);
    int nature = local ? SPOT : 0;
    if (SHADOWS && row_of(lights.casts_shadow, world, index))
        nature |= CASTS;
    if (ambient.x != 0.0f || ambient.y != 0.0f || ambient.z != 0.0f)
        nature |= AMBIENT;
    Lamp lamp;
    lamp.place = to_row(local ? turned_back(camera.rotation, position - camera.origin) : -normalized(direction),
                        SHADOWS ? 1 << place : 0);
    lamp.axis = to_row(direction, as_int(wide ? -2.0f : cosine(0.017453292519943295f * cutoff)));
    lamp.across = to_row(turned_back(camera.rotation, { turn.data[0][0], turn.data[1][0], turn.data[2][0] }),
                         row_of(physical.forms, world, index));
    lamp.size = to_row(to_vec(row_of(physical.sizes, world, index)), 0);
    lamp.falloff = to_row(to_vec(row_of(lights.attenuation, world, index)),
                          as_int(wide ? 0.0f : row_of(lights.exponent, world, index)));
    lamp.diffuse = to_row(to_vec(row_of(lights.diffuse, world, index)), nature);
    lamp.specular = to_row(to_vec(row_of(lights.specular, world, index)), 0);
    lamp.ambient = to_row(ambient, 0);
    return lamp;
}

template <class Physical> WARPCAM_FN void gather_sky(const Physical& physical, int world, int first, Sky& sky)
{
    sky.uneven = 0;
    for (int term = 0; term < SKY_TERMS; ++term) {
        sky.terms[term] = to_vec(row_of(physical.sky, world, term));
        if (term > 0 && dot(sky.terms[term], sky.terms[term]) > 0.0f)
            sky.uneven = 1;
    }
    sky.gain = to_vec(row_of(physical.sky, world, SKY_TERMS));
    sky.terms[0] = sky.terms[0] + to_vec(wp::index(physical.plain.headlight, first));
}

// Fills the list; all lanes of one warp take part. `first` is where the headlight's colours begin.
template <bool SHADOWS, class Physical> WARPCAM_APART WARPCAM_FN void gather_lights(const Physical& physical,
                                                                                    const Camera& camera, int world,
                                                                                    int first, int lane, LampList& list)
{
    const auto& lights = physical.plain;
    const bool headlight = headlight_shines(lights);
    if (lane == 0) {
        list.lamps[0] = {};
        list.lamps[0].place = { 0.0f, 0.0f, 1.0f, 0 };
        list.lamps[0].diffuse = to_row(to_vec(wp::index(lights.headlight, first + 1)), 0);
        list.lamps[0].specular = to_row(to_vec(wp::index(lights.headlight, first + 2)), 0);
        list.count = headlight;
        gather_sky(physical, world, first, list.sky);
    }
    team_barrier();
    for (int light = lane; light < lights.types.shape[1]; light += TEAM) {
        KeptLights lights_before = kept_lights(lights);
        for (int other = 0; other < light; ++other)
            lights_before.next(lights, world, other);
        const int place = lights_before.next(lights, world, light);
        if (place >= 0) {
            list.lamps[headlight + place] = load_lamp<SHADOWS>(physical, camera, world, light, place);
            claimed(list.count);
        }
    }
    team_barrier();
}

// Light at a place: from where, how much of the lamp's colours if it falls straight, and its spread.
template <class Vector> struct AreaLightSample {
    Vector to_light;
    NumberOf<Vector> share, spread;
};

// The mean direction of what a rectangle sends, as long as its share: Lambert's formula for polygons, over pi.
template <class Vector> WARPCAM_FN Vector from_rectangle(Vector middle, Vec across, Vec up)
{
    using Number = NumberOf<Vector>;
    const Vector right = broadcast<Vector>(across), above = broadcast<Vector>(up);
    const Vector corners[4] = { middle - right - above, middle + right - above, middle + right + above,
                                middle - right + above };
    const Number none = 0.0f, one = 1.0f, rate = 0.5f / PI;
    Vector sum { none, none, none };
    for (int k = 0; k < 4; ++k) {
        const Vector a = corners[k], b = corners[(k + 1) & 3], normal = cross(a, b);
        const Number sine = root(dot(normal, normal));
        const MaskOf<Vector> some = sine > 1.0e-20f;
        if (any_of(some))
            sum = sum + (some ? atan2(sine, dot(a, b)) / (some ? sine : one) : none) * normal;
    }
    return (dot(sum, middle) < 0.0f ? -rate : rate) * sum;
}

// The same of a thin cylinder about `axis`: the integral over its length of 2 radius sin(angle) / distance^2, over pi.
template <class Vector> WARPCAM_FN Vector from_cylinder(Vector middle, Vec axis, float radius, float half)
{
    using Number = NumberOf<Vector>;
    const Vector axes = broadcast<Vector>(axis);
    const Number along = dot(middle, axes), first = along - half, last = along + half;
    const Vector aside = middle - along * axes;
    const Number h = upper(root(dot(aside, aside)), upper(radius, 1.0e-6f)), h2 = h * h;
    const Number near = first * first + h2, far = last * last + h2;
    const Number lengthwise = 0.5f / near - 0.5f / far;
    const Number sideways = 0.5f * (last / far - first / near + (atan2(last, h) - atan2(first, h)) / h) / h2;
    return 2.0f * radius * h / PI * (lengthwise * axes + sideways * h * normalized(aside));
}

template <class Vector> WARPCAM_FN AreaLightSample<Vector> shine_at(const Lamp& lamp, Vector place)
{
    using Number = NumberOf<Vector>;
    const Number none = 0.0f, one = 1.0f;
    if (!(lamp.diffuse.w & SPOT))
        return { broadcast<Vector>(to_vec(lamp.place)), one, lamp.size.x };
    const Vector offset = broadcast<Vector>(to_vec(lamp.place)) - place;
    const Number square = upper(dot(offset, offset), 1.0e-12f), distance = root(square);
    AreaLightSample<Vector> shine { 1.0f / distance * offset, none, none };
    const Number along = -dot(shine.to_light, broadcast<Vector>(to_vec(lamp.axis)));
    const MaskOf<Vector> dark = along < as_float(lamp.axis.w);
    if (!any_of(!dark))
        return shine;
    const int form = lamp.across.w;
    if (form == FORM_POINT) {
        shine.share
            = 1.0f / upper(lamp.falloff.x + distance * (lamp.falloff.y + distance * lamp.falloff.z), 1.0e-12f);
    } else if (form == FORM_SPHERE) {
        shine.share = shine.spread = lower(lamp.size.x * lamp.size.x / square, 1.0f);
    } else if (form == FORM_DISK) {
        const float radius = lamp.size.x * lamp.size.x;
        shine.share = shine.spread = upper(along, 0.0f) * radius / (radius + square);
    } else {
        const Vec across = to_vec(lamp.across);
        const Vector sum = form == FORM_RECTANGLE
            ? from_rectangle(offset, lamp.size.x * across, lamp.size.y * cross(to_vec(lamp.axis), across))
            : from_cylinder(offset, across, lamp.size.x, lamp.size.y);
        shine.share = root(dot(sum, sum));
        shine.spread = lower(shine.share, 1.0f);
        const MaskOf<Vector> some = shine.share > 1.0e-20f;
        shine.to_light = chosen(some, 1.0f / (some ? shine.share : one) * sum, shine.to_light);
    }
    const float exponent = as_float(lamp.falloff.w);
    if (exponent != 0.0f)
        shine.share *= power(upper(along, TINY), exponent);
    shine.share = dark ? none : shine.share;
    return shine;
}

// The cosine of a light over a surface, or its mean over what the horizon leaves of it.
template <class Number> WARPCAM_FN Number cosine_over(Number middle, Number spread)
{
    const Number none = 0.0f, one = 1.0f, whole = upper(middle, none);
    const auto cut = !((middle * middle >= spread) | (spread < 1.0e-6f));
    if (!any_of(cut))
        return whole;
    spread = lower(spread, 0.9999f);
    const Number sine = root(upper(1.0f - middle * middle, 1.0e-8f)), x = root(1.0f / spread - 1.0f);
    const Number y = between(-x * middle / sine, -one, one), part = sine * root(upper(1.0f - y * y, 0.0f));
    const Number sum = (middle * acos(y) - x * part) * spread + atan2(part, x);
    return cut ? upper(sum / (PI * spread), 0.0f) : whole;
}

}  // namespace warpcam
