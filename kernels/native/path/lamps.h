// Lights of a scene as paths meet them: drawn from a place, with the density, and met by rays that were drawn otherwise.
//
// Strengths are those of shading/area_lights.h: of lights of a size their colour is radiance, a point's is what a white
// surface that faces it shows. Lights of a size give light from every place of their surface, and cast soft shadows.
#pragma once
#include "path/frame_axes.h"
#include "shading/area_lights.h"

namespace warpcam {

// Light that arrives at a place from one direction.
struct LampSample {
    Vec3 direction;  // unit, to the light
    float distance;  // MISS: there is no end
    float weight;  // of the light's colours: over the density [1/sr] if it has one
    float density;  // of the direction, or 0 where the light has no size
};

WARPCAM_DEVICE bool is_distant(const AreaLight& lamp) { return !(lamp.diffuse.w & SPOT); }
constexpr float SMALLEST_SUN = 1.0e-9f;  // squared sine below which a distant light has no size

// How much of its light a lamp sends along a direction: none outside of its cone.
WARPCAM_DEVICE float share_of_cone(const AreaLight& lamp, Vec3 to_lamp)
{
    const float along = -dot(to_lamp, as_vec3(lamp.axis)), exponent = as_float(lamp.falloff.w);
    if (along < as_float(lamp.axis.w))
        return 0.0f;
    return exponent != 0.0f ? pow(max(along, MIN_NORMAL), exponent) : 1.0f;
}

// The cap, as seen from its middle's distance, of a ball whose squared sine is given.
WARPCAM_DEVICE float cap_height(float sine_squared)
{
    const float square = min(sine_squared, 1.0f);
    return square / (1.0f + wp::sqrt(max(1.0f - square, 0.0f)));
}
WARPCAM_DEVICE float cap_density(float height) { return 1.0f / (2.0f * PI * height); }

// How far along a ray from the middle of a ball's frame it is met; MISS if not.
WARPCAM_DEVICE float meet_ball(Vec3 offset, Vec3 direction, float radius)
{
    const float along = dot(offset, direction);
    const Vec3 aside = offset - along * direction;
    const float rest = radius * radius - dot(aside, aside);
    if (rest < 0.0f)
        return MISS;
    const float half = wp::sqrt(rest), near = along - half;
    return near > 0.0f ? near : along + half > 0.0f ? along + half : MISS;
}

// Where a ray meets a lamp that has a size, and the density with which draw_lamp() would have drawn the ray.
struct LampMeeting {
    float distance;  // MISS: it does not
    float density;
};

// `offset`: from the ray's start to the lamp's place.
WARPCAM_DEVICE LampMeeting meet_lamp(const AreaLight& lamp, Vec3 start, Vec3 direction)
{
    const LampMeeting none { MISS, 0.0f };
    if (is_distant(lamp)) {
        const Vec3 aside = cross(direction, as_vec3(lamp.place));
        const bool met = lamp.size.x > SMALLEST_SUN && dot(direction, as_vec3(lamp.place)) > 0.0f
                         && dot(aside, aside) <= lamp.size.x;
        return met ? LampMeeting { MAX_RAY_T, cap_density(cap_height(lamp.size.x)) } : none;
    }
    const Vec3 offset = as_vec3(lamp.place) - start, axis = as_vec3(lamp.axis), across = as_vec3(lamp.across);
    const float square = dot(offset, offset);
    const int form = lamp.across.w;
    if (form == FORM_SPHERE) {
        const float radius = lamp.size.x, t = meet_ball(offset, direction, radius);
        const float height = square > radius * radius ? cap_height(radius * radius / square) : 2.0f;
        return t < MISS ? LampMeeting { t, cap_density(height) } : none;
    }
    if (form == FORM_DISK || form == FORM_RECTANGLE) {
        const float slope = -dot(direction, axis), t = -dot(offset, axis) / avoid_zero(slope);
        if (!(slope > 0.0f && t > 0.0f))
            return none;
        const Vec3 at = t * direction - offset;
        const float u = dot(at, across), v = dot(at, cross(axis, across));
        const bool met = form == FORM_DISK ? dot(at, at) <= lamp.size.x * lamp.size.x
                                           : abs(u) <= lamp.size.x && abs(v) <= lamp.size.y;
        const float area = form == FORM_DISK ? PI * lamp.size.x * lamp.size.x : 4.0f * lamp.size.x * lamp.size.y;
        return met ? LampMeeting { t, t * t / (slope * area) } : none;
    }
    if (form == FORM_CYLINDER) {
        const float radius = lamp.size.x, half = lamp.size.y, run = dot(direction, across);
        const Vec3 flat = direction - run * across, away = offset - dot(offset, across) * across;
        const float steep = dot(flat, flat), along = dot(away, flat);
        const float rest = along * along - steep * (dot(away, away) - radius * radius);
        if (!(rest > 0.0f && steep > 0.0f))
            return none;
        const float t = (along - wp::sqrt(rest)) / steep;
        if (!(t > 0.0f && abs(t * run - dot(offset, across)) <= half))
            return none;
        const float cosine = wp::sqrt(rest) / radius;
        return { t, t * t / (max(cosine, 1.0e-6f) * 4.0f * PI * radius * half) };
    }
    return none;
}

// A direction to a ball, evenly over what is seen of it, and how far along it is met.
struct BallSample {
    Vec3 direction;
    float distance, height;  // of the cap
};
WARPCAM_DEVICE BallSample draw_ball(Vec3 offset, float radius, float u, float v)
{
    const float square = max(dot(offset, offset), 1.0e-12f);
    const float height = square > radius * radius ? cap_height(radius * radius / square) : 2.0f;
    const Vec3 direction = FrameAxes(normalized(offset)).world(cap_direction(u, v, height));
    const float t = meet_ball(offset, direction, radius);
    return { direction, t < MISS ? t : dot(offset, direction), height };  // rounding may take it past the edge
}

// Draws a direction to the lamp from a place. A point whose size is not 0 gives its light from all over a bulb.
WARPCAM_DEVICE LampSample draw_lamp(const AreaLight& lamp, Vec3 place, float u, float v)
{
    if (is_distant(lamp)) {
        const Vec3 toward = as_vec3(lamp.place);
        if (!(lamp.size.x > SMALLEST_SUN))
            return { toward, MISS, PI, 0.0f };
        const float height = cap_height(lamp.size.x), density = cap_density(height);
        return { FrameAxes(toward).world(cap_direction(u, v, height)), MISS, 1.0f / (lamp.size.x * density), density };
    }
    const Vec3 offset = as_vec3(lamp.place) - place, axis = as_vec3(lamp.axis), across = as_vec3(lamp.across);
    const float square = max(dot(offset, offset), 1.0e-12f);
    const int form = lamp.across.w;
    Vec3 at = offset;
    if (form == FORM_POINT) {
        const float distance = wp::sqrt(square);
        const Vec3 toward = 1.0f / distance * offset;
        const Float3Int f = lamp.falloff;
        const float share = share_of_cone(lamp, toward) / max(f.x + distance * (f.y + distance * f.z), 1.0e-12f);
        if (lamp.size.x > 0.0f) {
            const BallSample bulb = draw_ball(offset, lamp.size.x, u, v);
            return { bulb.direction, bulb.distance, PI * share, 0.0f };
        }
        return { toward, distance, PI * share, 0.0f };
    }
    if (form == FORM_SPHERE) {
        const BallSample ball = draw_ball(offset, lamp.size.x, u, v);
        const float density = cap_density(ball.height);
        return { ball.direction, ball.distance, share_of_cone(lamp, ball.direction) / density, density };
    }
    if (form == FORM_DISK) {
        const Float2 turn = on_circle(v);
        const float radius = lamp.size.x * wp::sqrt(u);
        at = offset + radius * turn.x * across + radius * turn.y * cross(axis, across);
    } else if (form == FORM_RECTANGLE) {
        at = offset + (2.0f * u - 1.0f) * lamp.size.x * across + (2.0f * v - 1.0f) * lamp.size.y * cross(axis, across);
    } else {
        const Float2 turn = on_circle(v);
        const FrameAxes axes(across);
        at = offset + (2.0f * u - 1.0f) * lamp.size.y * across + lamp.size.x * (turn.x * axes.x + turn.y * axes.y);
    }
    const Vec3 direction = normalized(at);
    const LampMeeting met = meet_lamp(lamp, place, direction);
    const float distance = wp::sqrt(dot(at, at));
    // the far side of a cylinder, and what rounding takes past an edge, sends nothing here
    const bool seen = met.distance < MISS && met.distance > 0.999f * distance - 1.0e-6f;
    return { direction, distance, seen ? share_of_cone(lamp, direction) / met.density : 0.0f, met.density };
}

}  // namespace warpcam
