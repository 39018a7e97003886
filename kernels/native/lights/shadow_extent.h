// Extent of a light's shadows. MuJoCo's renderer draws the light's view into a map: points outside of it are lit, and
// objects nearer to the light than its near plane cast no shadow.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

struct MapSize {
    float width;  // half of it: of a distant light [m], else at a distance of 1; 0 where shadows reach everywhere
    float near;   // from the light's position along its direction [m]
    float gap;    // a single face nearer to a point casts no shadow on it, as a part of `width`
};

// The map of one light, in axes of one's choice and from a place of one's choice.
struct ShadowMap {
    Vec3 right, up;  // over half the map's width
    Vec3 along;
    Vec3 from;  // the light's position
    float near;
    float nearest;  // a single face nearer to a point casts no shadow on it, in the units of ray_to()
    bool bounded;  // else the rest means nothing
};

// `along`: unit, the way the light shines; `up`: what is across it and the world's x axis, of any length.
WARPCAM_DEVICE ShadowMap shadow_map(Vec3 from, Vec3 along, Vec3 up, const MapSize& size)
{
    const float rate = rcp(sqrt(max(dot(up, up), 1.0e-30f)) * max(size.width, 1.0e-30f));
    return { rate * cross(along, up), rate * up, along, from, size.near, size.width * size.gap, size.width > 0.0f };
}

// `cutoff` [degrees]: of a spot.
template <class Lights> WARPCAM_DEVICE MapSize map_size(const Lights& lights, bool distant, float cutoff)
{
    const float half = 0.017453292519943295f * min(lights.shadow_scale * cutoff, 80.0f);
    const bool flat = distant || !(lights.shadow_width > 0.0f);
    return { flat ? lights.shadow_width : sin(half) * rcp(cos(half)), lights.shadow_near, lights.shadow_gap };
}

// True if a bounded map covers a point at distance `along` its axis.
template <class Vector>
WARPCAM_DEVICE MaskOf<Vector> has_place(const ShadowMap& map, bool distant, Vector place, NumberOf<Vector>& along)
{
    using Number = NumberOf<Vector>;
    const Vector offset = place - broadcast<Vector>(map.from);
    along = dot(broadcast<Vector>(map.along), offset);
    const Number side =
        max(abs(dot(broadcast<Vector>(map.right), offset)), abs(dot(broadcast<Vector>(map.up), offset)));
    return (along > map.near) & !(side > (distant ? (Number)1.0f : along));
}

}  // namespace warpcam
