// Eight places in the map of a light, on a CPU.
#pragma once
#include "core/simd8.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// As has_place().
inline Int8 have_places(const ShadowMap& map, bool distant, Vec3x8 place, Float8& along)
{
    const Vec3x8 offset = place - broadcast(map.from);
    along = dot(broadcast(map.along), offset);
    const Float8 side = max(abs(dot(broadcast(map.right), offset)), abs(dot(broadcast(map.up), offset)));
    return (along > map.near) & ~(side > (distant ? (Float8)1.0f : along));
}

}  // namespace warpcam
