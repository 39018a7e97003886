// Physically based shading of eight hits of one shape, on a CPU: shading/pbr.h, shading/pbr_material.h, shading/ggx.h,
// shading/area_lights.h, shading/environment.h and core/srgb.h, whose comments hold here.
#pragma once
#include "shading/pbr.h"
#include "shading/surface_simd.h"
#include "shading/texture_simd.h"

namespace warpcam {

inline Float8 srgb_to_linear(Float8 value)
{
    const Float8 above = pow(max((value + 0.055f) * (1.0f / 1.055f), (Float8)MIN_NORMAL), 2.4f);
    return value <= 0.04045f ? value * (1.0f / 12.92f) : above;
}
inline Float8 linear_to_srgb(Float8 light)
{
    light = saturate(light);
    const Float8 above = 1.055f * pow(max(light, (Float8)MIN_NORMAL), 1.0f / 2.4f) - 0.055f;
    return light <= 0.0031308f ? 12.92f * light : above;
}
inline Vec3x8 srgb_to_linear(const Vec3x8& color) { return { srgb_to_linear(color.x), srgb_to_linear(color.y), srgb_to_linear(color.z) }; }
inline Vec3x8 linear_to_srgb(const Vec3x8& light) { return { linear_to_srgb(light.x), linear_to_srgb(light.y), linear_to_srgb(light.z) }; }

inline Vec3x8 turned_eight(const Mat3& m, const Vec3x8& v)
{
    const auto row = [&](int i) { return m.at[i][0] * v.x + m.at[i][1] * v.y + m.at[i][2] * v.z; };
    return { row(0), row(1), row(2) };
}

inline Vec3x8 not_below_zero(const Vec3x8& v)
{
    const Float8 none = 0.0f;
    return { max(v.x, none), max(v.y, none), max(v.z, none) };
}

struct Skins {
    Vec3x8 matt, straight;
    Float8 grazing, roughness, square;
};

inline void skins_of(const Vec3x8& color, Float8 roughness, Float8 metallic, float reflectance, Skins& skin)
{
    roughness = clamp(roughness, (Float8)MIN_ROUGHNESS, (Float8)1.0f);
    metallic = saturate(metallic);
    const Vec3x8 dielectric = broadcast({ reflectance, reflectance, reflectance });
    skin.straight = dielectric + metallic * (color - dielectric);
    skin.matt = (1.0f - metallic) * color;
    skin.grazing = saturate(17.0f * (skin.straight.x + skin.straight.y + skin.straight.z));
    skin.roughness = roughness;
    skin.square = (roughness * roughness) * (roughness * roughness);
}

struct Reflections {
    Vec3x8 matt, gloss;
};

inline Float8 ggx_ndf(const Vec3x8& normal, const Vec3x8& half, Float8 square)
{
    const Float8 along = dot(normal, half), none = 0.0f;
    const Vec3x8 aside = cross(normal, half);
    const Float8 sum = along * along * square + dot(aside, aside);
    return along > none ? square / (PI * sum * sum) : none;
}

inline Float8 smith_visibility(Float8 to_light, Float8 to_eye, Float8 square)
{
    const Float8 masked = to_light * sqrt(to_eye * to_eye * (1.0f - square) + square);
    const Float8 shadowed = to_eye * sqrt(to_light * to_light * (1.0f - square) + square);
    return 0.5f / max(masked + shadowed, (Float8)1.0e-7f);
}

inline void reflections_of(const Skins& skin, const Vec3x8& normal, const Vec3x8& to_light, const Vec3x8& to_eye,
                           Float8 eye_cosine, Float8 spread, Reflections& back)
{
    const Vec3x8 half = normalized(to_light + to_eye), one = broadcast({ 1.0f, 1.0f, 1.0f });
    const Float8 light_cosine = saturate(dot(normal, to_light));
    const Float8 rest = 1.0f - saturate(dot(to_eye, half)), rest2 = rest * rest, rest5 = rest2 * rest2 * rest;
    const Vec3x8 mirrored = skin.straight + rest5 * (skin.grazing * one - skin.straight);
    const Float8 wide = min(skin.square + 0.25f * spread, (Float8)1.0f);
    const Float8 gloss = PI * light_cosine * ggx_ndf(normal, half, wide)
        * smith_visibility(light_cosine, eye_cosine, skin.square);
    back = { mul(skin.matt, one - mirrored), gloss * mirrored };
}

inline Vec3x8 environment_brdf(const Skins& skin, Float8 eye_cosine, const Vec3x8& even, const Vec3x8& mirrored)
{
    const Float8 r = skin.roughness, x = 1.0f - r, y = 0.0425f - 0.0275f * r, none = 0.0f, one = 1.0f;
    const Float8 fade = min(x * x, exp2(-9.28f * eye_cosine)) * x + y;
    const Float8 scale = max(-1.04f * fade + 1.04f - 0.572f * r, none);
    const Float8 offset = max(1.04f * fade - 0.04f + 0.022f * r, none);
    const Float8 lost = max(1.0f - scale - offset, none), edge = offset * skin.grazing;
    const Vec3x8 white { one, one, one };
    const Vec3x8 single = scale * skin.straight + Vec3x8 { edge, edge, edge };
    const Vec3x8 mean = skin.straight + (Float8)(1.0f / 21.0f) * (white - skin.straight);
    const Vec3x8 again = lost * div(mul(single, mean), white - lost * mean);
    return mul(single, mirrored) + mul(again + mul(skin.matt, white - single - again), even);
}

// The arc tangent of up / along, from 0 to pi; `up` is not below zero. Abramowitz and Stegun 4.4.49, to 2e-8 of its
// tangent.
inline Float8 angle_of(Float8 up, Float8 along)
{
    constexpr float SERIES[] = { -0.3333314528f, 0.1999355085f, -0.1420889944f, 0.1065626393f,
                                 -0.0752896400f, 0.0429096138f, -0.0161657367f, 0.0028662257f };
    const Float8 side = abs(along), most = max(up, side), rate = min(up, side) / max(most, (Float8)MIN_NORMAL);
    const Float8 square = rate * rate;
    Float8 sum = 0.0f;
    for (int n = 7; n >= 0; --n)
        sum = square * (SERIES[n] + sum);
    Float8 angle = rate + rate * sum;
    angle = up > side ? 0.5f * PI - angle : angle;
    return along < 0.0f ? PI - angle : angle;
}

inline Vec3x8 from_rectangles(const Vec3x8& middle, Vec3 across, Vec3 up)
{
    const Vec3x8 right = broadcast(across), above = broadcast(up);
    const Vec3x8 corners[4] = { middle - right - above, middle + right - above, middle + right + above,
                              middle - right + above };
    const Float8 none = 0.0f, one = 1.0f;
    Vec3x8 sum { none, none, none };
    for (int k = 0; k < 4; ++k) {
        const Vec3x8 a = corners[k], b = corners[(k + 1) & 3], normal = cross(a, b);
        const Float8 sine = sqrt(dot(normal, normal));
        const Int8 some = sine > 1.0e-20f;
        sum = sum + (some ? angle_of(sine, dot(a, b)) / (some ? sine : one) : none) * normal;
    }
    return (dot(sum, middle) < none ? (Float8)(-0.5f / PI) : (Float8)(0.5f / PI)) * sum;
}

inline Vec3x8 from_cylinders(const Vec3x8& middle, Vec3 axis, float radius, float half)
{
    const Float8 along = dot(middle, broadcast(axis)), first = along - half, last = along + half;
    const Vec3x8 aside = middle - along * broadcast(axis);
    const Float8 h = max(sqrt(dot(aside, aside)), (Float8)max(radius, 1.0e-6f)), h2 = h * h;
    const Float8 near = first * first + h2, far = last * last + h2, lengthwise = 0.5f / near - 0.5f / far;
    const auto slope = [&](Float8 x) { return sign(x) * angle_of(abs(x), h); };
    const Float8 sideways = 0.5f * (last / far - first / near + (slope(last) - slope(first)) / h) / h2;
    return 2.0f * radius * h / PI * (lengthwise * broadcast(axis) + sideways * h * normalized(aside));
}

struct Shines {
    Vec3x8 to_light;
    Float8 share, spread;
};

inline void shines_at(const AreaLight& lamp, const Vec3x8& place, Shines& shine)
{
    const Float8 none = 0.0f, one = 1.0f;
    if (!(lamp.diffuse.w & SPOT)) {
        shine = { broadcast(as_vec3(lamp.place)), one, (Float8)lamp.size.x };
        return;
    }
    const int form = lamp.across.w;
    const Vec3x8 offset = broadcast(as_vec3(lamp.place)) - place;
    const Float8 square = max(dot(offset, offset), (Float8)1.0e-12f), distance = sqrt(square);
    shine.to_light = rcp(distance) * offset;
    const Float8 along = -dot(shine.to_light, broadcast(as_vec3(lamp.axis)));
    if (form == FORM_POINT) {
        const Float8 loss = lamp.falloff.x + distance * (lamp.falloff.y + distance * lamp.falloff.z);
        shine.share = rcp(max(loss, (Float8)1.0e-12f));
        shine.spread = none;
    } else if (form == FORM_SPHERE || form == FORM_DISK) {
        const float radius = lamp.size.x * lamp.size.x;
        shine.share =
            form == FORM_SPHERE ? min(radius / square, one) : max(along, none) * radius / (radius + square);
        shine.spread = shine.share;
    } else {
        const Vec3 across = as_vec3(lamp.across);
        const Vec3x8 sum = form == FORM_RECTANGLE
            ? from_rectangles(offset, lamp.size.x * across, lamp.size.y * cross(as_vec3(lamp.axis), across))
            : from_cylinders(offset, across, lamp.size.x, lamp.size.y);
        shine.share = sqrt(dot(sum, sum));
        shine.spread = min(shine.share, one);
        const Int8 some = shine.share > 1.0e-20f;
        shine.to_light = select(some, rcp(some ? shine.share : one) * sum, shine.to_light);
    }
    const float exponent = as_float(lamp.falloff.w);
    if (exponent != 0.0f)
        shine.share *= pow(max(along, (Float8)MIN_NORMAL), exponent);
    shine.share = along < as_float(lamp.axis.w) ? none : shine.share;
}

inline Float8 cosines_over(Float8 middle, Float8 spread)
{
    const Float8 none = 0.0f, one = 1.0f, whole = max(middle, none);
    const Int8 cut = ~((middle * middle >= spread) | (spread < 1.0e-6f));
    if (!any(cut))
        return whole;
    spread = clamp(spread, (Float8)1.0e-6f, (Float8)0.9999f);
    const Float8 sine = sqrt(max(one - middle * middle, (Float8)1.0e-8f)), x = sqrt(one / spread - one);
    const Float8 y = clamp(-x * middle / sine, -one, one), rest = sqrt(max(one - y * y, none)), part = sine * rest;
    const Float8 sum = (middle * angle_of(rest, y) - x * part) * spread + angle_of(part, x);
    return cut ? max(sum / (PI * spread), none) : whole;
}

inline Vec3x8 irradiance_sh(const Sky& sky, const Vec3x8& d, Float8 first, Float8 second)
{
    const auto term = [&](int n) { return broadcast(sky.terms[n]); };
    Vec3x8 light = term(0);
    if (sky.uneven) {
        light = light + first * (d.x * term(1) + d.y * term(2) + d.z * term(3));
        light = light + second * ((d.x * d.y) * term(4) + (d.y * d.z) * term(5) + (3.0f * d.z * d.z - 1.0f) * term(6)
                                  + (d.x * d.z) * term(7) + (d.x * d.x - d.y * d.y) * term(8));
    }
    return not_below_zero(light);
}

template <bool IMAGE, class Textures, class Background>
inline Vec3x8 sky_along(const Sky& sky, const Textures& textures, const Background& background, const Vec3x8& direction,
                      Float8 roughness)
{
    const Float8 alpha = roughness * roughness, blur = saturate(2.0f * alpha), none = 0.0f, one = 1.0f;
    const Vec3x8 wide = irradiance_sh(sky, direction, 1.0f - alpha / 3.0f, 1.0f - 0.75f * alpha);
    if constexpr (IMAGE) {
        const Image image = load_image(textures, background.skybox);
        if (image.levels > 0 && any(blur < one)) {
            const Vec3x8 d { direction.x, direction.z, -direction.y };
            const Vec3x8 across = select(abs(d.x) < 0.6f, { one, none, none }, { none, one, none });
            const Vec3x8 aside = normalized(cross(d, across));
            Vec3x8 read;
            sample_cubes(textures.texels.data, Levels(image, 6), d, (1.5f * alpha) * aside,
                         (1.5f * alpha) * cross(d, aside), read);
            const Vec3x8 sharp = mul(broadcast(sky.gain), srgb_to_linear(read));
            return select(blur < one, sharp + blur * (wide - sharp), wide);
        }
    }
    return wide;
}

struct Paints {
    Skins skin;
    Vec3x8 glow;
    Float8 open;
};

// `steps(right, down)` says how far it is to what the next pixels show.
template <int TYPES, bool MAPS, class Appearances, class Meshes, class Textures, class Steps>
inline void paints_at(const Appearances& look, const Meshes& meshes, const Textures& textures, const Steps& steps,
                      const SurfaceInteraction8& surface, const Vec3x8& ray, const Vec3x8& color, Vec3x8& normal, Paints& paint)
{
    const PbrMaterial& coat = look.finish;
    const ShapeFromCamera& pose = look.pose;
    Float8 roughness = coat.gloss.x, metallic = coat.gloss.y;
    paint.glow = broadcast(as_vec3(coat.glow));
    paint.open = 1.0f;
    if constexpr (MAPS) {
        const int normals = coat.normals, packed = coat.gloss.w, glowing = coat.glow.w;
        if ((normals >= 0 || packed >= 0 || glowing >= 0) && !((TYPES >> PLANE & 1) && pose.type() == PLANE)) {
            Vec3x8 right, down;
            steps(right, down);
            Footprints at;
            footprints_2d<TYPES>(pose, look.layout, meshes, surface, ray, right, down, at);
            if constexpr (Appearances::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            const auto read = [&](int texture) {
                return sample_2d(textures.texels.data, Levels(load_image(textures, texture), 1), at);
            };
            if (is_texture(textures, packed)) {
                const Vec3x8 map = read(packed);
                paint.open = map.x;
                roughness *= map.y;
                metallic *= map.z;
            }
            if (is_texture(textures, glowing))
                paint.glow = mul(paint.glow, srgb_to_linear(read(glowing)));
            if (is_texture(textures, normals)) {
                const Vec3x8 map = (Float8)2.0f * read(normals) - broadcast({ 1.0f, 1.0f, 1.0f });
                for (int k = 0; k < SIMD_WIDTH; ++k) {
                    const Mapping on = map_2d<TYPES>(pose, look.layout, meshes, surface.one(k));
                    set_lane(normal, k, tilted(get_lane(normal, k), get_lane(map, k), on.du, -on.dv));
                }
            }
        }
    }
    skins_of(mul(broadcast(as_vec3(coat.color)), color), roughness, metallic, coat.gloss.z, paint.skin);
}

// What the surfaces send to the camera, linear. `color` is their texture's, linear.
template <int TYPES, int FACTS, class Appearances, class Scene_, class Steps>
WARPCAM_NOINLINE_CPU inline void shade_eight_physically(const Appearances& look, const AreaLights& list, const Scene_& scene,
                                                 const Mat3& rotation, const Steps& steps, const SurfaceInteraction8& surface,
                                                 const Vec3x8& place, const Vec3x8& to_eye, const Vec3x8& ray,
                                                 const Vec3x8& color, Int8 shadow, Vec3x8& light)
{
    constexpr bool SHADOWS = FACTS & HAS_SHADOWS, MAPS = FACTS & HAS_MAPS, IMAGE = FACTS & HAS_SKYBOX;
    Vec3x8 normal = smooth_normals<TYPES>(look.pose, scene.meshes, surface);
    Paints paint;
    paints_at<TYPES, MAPS>(look, scene.meshes, scene.textures, steps, surface, ray, color, normal, paint);
    normal = seen_of(look.pose, normal);
    const Float8 none = 0.0f, slant = dot(normal, to_eye), eye_cosine = max(abs(slant), (Float8)1.0e-4f);
    Vec3x8 around { none, none, none };
    light = paint.glow;
    for (int n = 0; n < list.count; ++n) {
        const AreaLight& lamp = list.lamps[n];
        const Int8 reached = SHADOWS ? (shadow & lamp.place.w) == 0 : (Int8)-1;
        if (!any(reached))
            continue;
        Shines shine;
        shines_at(lamp, place, shine);
        const Float8 share = reached ? shine.share : none;
        if (lamp.diffuse.w & AMBIENT)
            around = around + share * broadcast(as_vec3(lamp.ambient));
        const Float8 cosine = cosines_over(dot(normal, shine.to_light), shine.spread);
        const Int8 lit = share * cosine > none;
        if (!any(lit))
            continue;
        Reflections back;
        reflections_of(paint.skin, normal, shine.to_light, to_eye, eye_cosine, shine.spread, back);
        const Vec3x8 own = share * (cosine * mul(back.matt, broadcast(as_vec3(lamp.diffuse)))
                                  + mul(back.gloss, broadcast(as_vec3(lamp.specular))));
        light = select(lit, light + own, light);
    }
    const Vec3x8 even =
        around + irradiance_sh(list.sky, turned_eight(rotation, normal), (Float8)(2.0f / 3.0f), (Float8)0.25f);
    const Vec3x8 mirror = turned_eight(rotation, 2.0f * slant * normal - to_eye);
    const Vec3x8 mirrored
        = around + sky_along<IMAGE>(list.sky, scene.textures, scene.background, mirror, paint.skin.roughness);
    light = light + paint.open * environment_brdf(paint.skin, eye_cosine, even, mirrored);
}

}  // namespace warpcam
