// Physically based shading of eight hits of one shape, on a CPU: shading/pbr.h, shading/pbr_material.h, shading/ggx.h,
// shading/area_lights.h, shading/environment.h and core/srgb.h, whose comments hold here.
#pragma once
#include "shading/pbr.h"
#include "shading/surface_simd.h"
#include "shading/texture_simd.h"

namespace warpcam {

inline Floats decoded(Floats value)
{
    const Floats above = power(upper((value + 0.055f) * (1.0f / 1.055f), (Floats)TINY), 2.4f);
    return value <= 0.04045f ? value * (1.0f / 12.92f) : above;
}
inline Floats encoded(Floats light)
{
    light = saturated(light);
    const Floats above = 1.055f * power(upper(light, (Floats)TINY), 1.0f / 2.4f) - 0.055f;
    return light <= 0.0031308f ? 12.92f * light : above;
}
inline Vecs decoded(const Vecs& color) { return { decoded(color.x), decoded(color.y), decoded(color.z) }; }
inline Vecs encoded(const Vecs& light) { return { encoded(light.x), encoded(light.y), encoded(light.z) }; }

inline Vecs turned_eight(const Matrix& m, const Vecs& v)
{
    const auto row = [&](int i) { return m.at[i][0] * v.x + m.at[i][1] * v.y + m.at[i][2] * v.z; };
    return { row(0), row(1), row(2) };
}

inline Vecs not_below_zero(const Vecs& v)
{
    const Floats none = 0.0f;
    return { upper(v.x, none), upper(v.y, none), upper(v.z, none) };
}

struct Skins {
    Vecs matt, straight;
    Floats grazing, roughness, square;
};

inline void skins_of(const Vecs& color, Floats roughness, Floats metallic, float reflectance, Skins& skin)
{
    roughness = between(roughness, (Floats)SMOOTHEST, (Floats)1.0f);
    metallic = saturated(metallic);
    const Vecs dielectric = eight_of({ reflectance, reflectance, reflectance });
    skin.straight = dielectric + metallic * (color - dielectric);
    skin.matt = (1.0f - metallic) * color;
    skin.grazing = saturated(17.0f * (skin.straight.x + skin.straight.y + skin.straight.z));
    skin.roughness = roughness;
    skin.square = (roughness * roughness) * (roughness * roughness);
}

struct Reflections {
    Vecs matt, gloss;
};

inline Floats facing_facets(const Vecs& normal, const Vecs& half, Floats square)
{
    const Floats along = dot(normal, half), none = 0.0f;
    const Vecs aside = cross(normal, half);
    const Floats sum = along * along * square + dot(aside, aside);
    return along > none ? square / (PI * sum * sum) : none;
}

inline Floats open_facets(Floats to_light, Floats to_eye, Floats square)
{
    const Floats masked = to_light * root(to_eye * to_eye * (1.0f - square) + square);
    const Floats shadowed = to_eye * root(to_light * to_light * (1.0f - square) + square);
    return 0.5f / upper(masked + shadowed, (Floats)1.0e-7f);
}

inline void reflections_of(const Skins& skin, const Vecs& normal, const Vecs& to_light, const Vecs& to_eye,
                           Floats eye_cosine, Floats spread, Reflections& back)
{
    const Vecs half = normalized(to_light + to_eye), one = eight_of({ 1.0f, 1.0f, 1.0f });
    const Floats light_cosine = saturated(dot(normal, to_light));
    const Floats rest = 1.0f - saturated(dot(to_eye, half)), rest2 = rest * rest, rest5 = rest2 * rest2 * rest;
    const Vecs mirrored = skin.straight + rest5 * (skin.grazing * one - skin.straight);
    const Floats wide = lower(skin.square + 0.25f * spread, (Floats)1.0f);
    const Floats gloss = PI * light_cosine * facing_facets(normal, half, wide)
        * open_facets(light_cosine, eye_cosine, skin.square);
    back = { times(skin.matt, one - mirrored), gloss * mirrored };
}

inline Vecs reflected_around(const Skins& skin, Floats eye_cosine, const Vecs& even, const Vecs& mirrored)
{
    const Floats r = skin.roughness, x = 1.0f - r, y = 0.0425f - 0.0275f * r, none = 0.0f, one = 1.0f;
    const Floats fade = lower(x * x, power_of_two(-9.28f * eye_cosine)) * x + y;
    const Floats scale = upper(-1.04f * fade + 1.04f - 0.572f * r, none);
    const Floats offset = upper(1.04f * fade - 0.04f + 0.022f * r, none);
    const Floats lost = upper(1.0f - scale - offset, none), edge = offset * skin.grazing;
    const Vecs white { one, one, one };
    const Vecs single = scale * skin.straight + Vecs { edge, edge, edge };
    const Vecs mean = skin.straight + (Floats)(1.0f / 21.0f) * (white - skin.straight);
    const Vecs again = lost * divided(times(single, mean), white - lost * mean);
    return times(single, mirrored) + times(again + times(skin.matt, white - single - again), even);
}

// The arc tangent of up / along, from 0 to pi; `up` is not below zero. Abramowitz and Stegun 4.4.49, to 2e-8 of its
// tangent.
inline Floats angle_of(Floats up, Floats along)
{
    constexpr float SERIES[] = { -0.3333314528f, 0.1999355085f, -0.1420889944f, 0.1065626393f,
                                 -0.0752896400f, 0.0429096138f, -0.0161657367f, 0.0028662257f };
    const Floats side = magnitude(along), most = upper(up, side), rate = lower(up, side) / upper(most, (Floats)TINY);
    const Floats square = rate * rate;
    Floats sum = 0.0f;
    for (int n = 7; n >= 0; --n)
        sum = square * (SERIES[n] + sum);
    Floats angle = rate + rate * sum;
    angle = up > side ? 0.5f * PI - angle : angle;
    return along < 0.0f ? PI - angle : angle;
}

inline Vecs from_rectangles(const Vecs& middle, Vec across, Vec up)
{
    const Vecs right = eight_of(across), above = eight_of(up);
    const Vecs corners[4] = { middle - right - above, middle + right - above, middle + right + above,
                              middle - right + above };
    const Floats none = 0.0f, one = 1.0f;
    Vecs sum { none, none, none };
    for (int k = 0; k < 4; ++k) {
        const Vecs a = corners[k], b = corners[(k + 1) & 3], normal = cross(a, b);
        const Floats sine = root(dot(normal, normal));
        const Ints some = sine > 1.0e-20f;
        sum = sum + (some ? angle_of(sine, dot(a, b)) / (some ? sine : one) : none) * normal;
    }
    return (dot(sum, middle) < none ? (Floats)(-0.5f / PI) : (Floats)(0.5f / PI)) * sum;
}

inline Vecs from_cylinders(const Vecs& middle, Vec axis, float radius, float half)
{
    const Floats along = dot(middle, eight_of(axis)), first = along - half, last = along + half;
    const Vecs aside = middle - along * eight_of(axis);
    const Floats h = upper(root(dot(aside, aside)), (Floats)upper(radius, 1.0e-6f)), h2 = h * h;
    const Floats near = first * first + h2, far = last * last + h2, lengthwise = 0.5f / near - 0.5f / far;
    const auto slope = [&](Floats x) { return sign(x) * angle_of(magnitude(x), h); };
    const Floats sideways = 0.5f * (last / far - first / near + (slope(last) - slope(first)) / h) / h2;
    return 2.0f * radius * h / PI * (lengthwise * eight_of(axis) + sideways * h * normalized(aside));
}

struct Shines {
    Vecs to_light;
    Floats share, spread;
};

inline void shines_at(const Lamp& lamp, const Vecs& place, Shines& shine)
{
    const Floats none = 0.0f, one = 1.0f;
    if (!(lamp.diffuse.w & SPOT)) {
        shine = { eight_of(to_vec(lamp.place)), one, (Floats)lamp.size.x };
        return;
    }
    const int form = lamp.across.w;
    const Vecs offset = eight_of(to_vec(lamp.place)) - place;
    const Floats square = upper(dot(offset, offset), (Floats)1.0e-12f), distance = root(square);
    shine.to_light = reciprocal(distance) * offset;
    const Floats along = -dot(shine.to_light, eight_of(to_vec(lamp.axis)));
    if (form == FORM_POINT) {
        const Floats loss = lamp.falloff.x + distance * (lamp.falloff.y + distance * lamp.falloff.z);
        shine.share = reciprocal(upper(loss, (Floats)1.0e-12f));
        shine.spread = none;
    } else if (form == FORM_SPHERE || form == FORM_DISK) {
        const float radius = lamp.size.x * lamp.size.x;
        shine.share =
            form == FORM_SPHERE ? lower(radius / square, one) : upper(along, none) * radius / (radius + square);
        shine.spread = shine.share;
    } else {
        const Vec across = to_vec(lamp.across);
        const Vecs sum = form == FORM_RECTANGLE
            ? from_rectangles(offset, lamp.size.x * across, lamp.size.y * cross(to_vec(lamp.axis), across))
            : from_cylinders(offset, across, lamp.size.x, lamp.size.y);
        shine.share = root(dot(sum, sum));
        shine.spread = lower(shine.share, one);
        const Ints some = shine.share > 1.0e-20f;
        shine.to_light = chosen(some, reciprocal(some ? shine.share : one) * sum, shine.to_light);
    }
    const float exponent = as_float(lamp.falloff.w);
    if (exponent != 0.0f)
        shine.share *= power(upper(along, (Floats)TINY), exponent);
    shine.share = along < as_float(lamp.axis.w) ? none : shine.share;
}

inline Floats cosines_over(Floats middle, Floats spread)
{
    const Floats none = 0.0f, one = 1.0f, whole = upper(middle, none);
    const Ints cut = ~((middle * middle >= spread) | (spread < 1.0e-6f));
    if (!any_of(cut))
        return whole;
    spread = between(spread, (Floats)1.0e-6f, (Floats)0.9999f);
    const Floats sine = root(upper(one - middle * middle, (Floats)1.0e-8f)), x = root(one / spread - one);
    const Floats y = between(-x * middle / sine, -one, one), rest = root(upper(one - y * y, none)), part = sine * rest;
    const Floats sum = (middle * angle_of(rest, y) - x * part) * spread + angle_of(part, x);
    return cut ? upper(sum / (PI * spread), none) : whole;
}

inline Vecs sky_through(const Sky& sky, const Vecs& d, Floats first, Floats second)
{
    const auto term = [&](int n) { return eight_of(sky.terms[n]); };
    Vecs light = term(0);
    if (sky.uneven) {
        light = light + first * (d.x * term(1) + d.y * term(2) + d.z * term(3));
        light = light + second * ((d.x * d.y) * term(4) + (d.y * d.z) * term(5) + (3.0f * d.z * d.z - 1.0f) * term(6)
                                  + (d.x * d.z) * term(7) + (d.x * d.x - d.y * d.y) * term(8));
    }
    return not_below_zero(light);
}

template <bool IMAGE, class Textures, class Background>
inline Vecs sky_along(const Sky& sky, const Textures& textures, const Background& background, const Vecs& direction,
                      Floats roughness)
{
    const Floats alpha = roughness * roughness, blur = saturated(2.0f * alpha), none = 0.0f, one = 1.0f;
    const Vecs wide = sky_through(sky, direction, 1.0f - alpha / 3.0f, 1.0f - 0.75f * alpha);
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        if (image.levels > 0 && any_of(blur < one)) {
            const Vecs d { direction.x, direction.z, -direction.y };
            const Vecs across = chosen(magnitude(d.x) < 0.6f, { one, none, none }, { none, one, none });
            const Vecs aside = normalized(cross(d, across));
            Vecs read;
            sample_cubes(textures.texels.data, Levels(image, 6), d, (1.5f * alpha) * aside,
                         (1.5f * alpha) * cross(d, aside), read);
            const Vecs sharp = times(eight_of(sky.gain), decoded(read));
            return chosen(blur < one, sharp + blur * (wide - sharp), wide);
        }
    }
    return wide;
}

struct Paints {
    Skins skin;
    Vecs glow;
    Floats open;
};

// `steps(right, down)` says how far it is to what the next pixels show.
template <int TYPES, bool MAPS, class Looks, class Meshes, class Textures, class Steps>
inline void paints_at(const Looks& look, const Meshes& meshes, const Textures& textures, const Steps& steps,
                      const Surfaces& surface, const Vecs& ray, const Vecs& color, Vecs& normal, Paints& paint)
{
    const Coat& coat = look.finish;
    const Pose& pose = look.pose;
    Floats roughness = coat.gloss.x, metallic = coat.gloss.y;
    paint.glow = eight_of(to_vec(coat.glow));
    paint.open = 1.0f;
    if constexpr (MAPS) {
        const int normals = coat.normals, packed = coat.gloss.w, glowing = coat.glow.w;
        if ((normals >= 0 || packed >= 0 || glowing >= 0) && !((TYPES >> PLANE & 1) && pose.type() == PLANE)) {
            Vecs right, down;
            steps(right, down);
            Footprints at;
            footprints_2d<TYPES>(pose, look.layout, meshes, surface, ray, right, down, at);
            if constexpr (Looks::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            const auto read = [&](int texture) {
                return sample_2d(textures.texels.data, Levels(load_image(textures, texture), 1), at);
            };
            if (is_texture(textures, packed)) {
                const Vecs map = read(packed);
                paint.open = map.x;
                roughness *= map.y;
                metallic *= map.z;
            }
            if (is_texture(textures, glowing))
                paint.glow = times(paint.glow, decoded(read(glowing)));
            if (is_texture(textures, normals)) {
                const Vecs map = (Floats)2.0f * read(normals) - eight_of({ 1.0f, 1.0f, 1.0f });
                for (int k = 0; k < PACKET; ++k) {
                    const Mapping on = map_2d<TYPES>(pose, look.layout, meshes, surface.one(k));
                    put_one(normal, k, tilted(one_of(normal, k), one_of(map, k), on.du, -on.dv));
                }
            }
        }
    }
    skins_of(times(eight_of(to_vec(coat.color)), color), roughness, metallic, coat.gloss.z, paint.skin);
}

// What the surfaces send to the camera, linear. `color` is their texture's, linear.
template <int TYPES, int FACTS, class Looks, class Scene_, class Steps>
WARPCAM_APART inline void shade_eight_physically(const Looks& look, const LampList& list, const Scene_& scene,
                                                 const Matrix& rotation, const Steps& steps, const Surfaces& surface,
                                                 const Vecs& place, const Vecs& to_eye, const Vecs& ray,
                                                 const Vecs& color, Ints shadow, Vecs& light)
{
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS, MAPS = FACTS & HAS_MAPS, IMAGE = FACTS & HAS_SKYBOX;
    Vecs normal = smooth_normals<TYPES>(look.pose, scene.meshes, surface);
    Paints paint;
    paints_at<TYPES, MAPS>(look, scene.meshes, scene.textures, steps, surface, ray, color, normal, paint);
    normal = seen_of(look.pose, normal);
    const Floats none = 0.0f, slant = dot(normal, to_eye), eye_cosine = upper(magnitude(slant), (Floats)1.0e-4f);
    Vecs around { none, none, none };
    light = paint.glow;
    for (int n = 0; n < list.count; ++n) {
        const Lamp& lamp = list.lamps[n];
        const Ints reached = SHADOWS ? (shadow & lamp.place.w) == 0 : (Ints)-1;
        if (!any_of(reached))
            continue;
        Shines shine;
        shines_at(lamp, place, shine);
        const Floats share = reached ? shine.share : none;
        if (lamp.diffuse.w & AMBIENT)
            around = around + share * eight_of(to_vec(lamp.ambient));
        const Floats cosine = cosines_over(dot(normal, shine.to_light), shine.spread);
        const Ints lit = share * cosine > none;
        if (!any_of(lit))
            continue;
        Reflections back;
        reflections_of(paint.skin, normal, shine.to_light, to_eye, eye_cosine, shine.spread, back);
        const Vecs own = share * (cosine * times(back.matt, eight_of(to_vec(lamp.diffuse)))
                                  + times(back.gloss, eight_of(to_vec(lamp.specular))));
        light = chosen(lit, light + own, light);
    }
    const Vecs even =
        around + sky_through(list.sky, turned_eight(rotation, normal), (Floats)(2.0f / 3.0f), (Floats)0.25f);
    const Vecs mirror = turned_eight(rotation, 2.0f * slant * normal - to_eye);
    const Vecs mirrored
        = around + sky_along<IMAGE>(list.sky, scene.textures, scene.background, mirror, paint.skin.roughness);
    light = light + paint.open * reflected_around(paint.skin, eye_cosine, even, mirrored);
}

}  // namespace warpcam
