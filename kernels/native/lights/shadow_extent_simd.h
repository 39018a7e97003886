// Eight places in the map of a light, on a CPU.
#pragma once
#include "core/simd8.h"
#include "lights/shadow_extent.h"

namespace warpcam {

// As has_place().
inline Ints have_places(const ShadowMap& map, bool distant, Vecs place, Floats& along)
{
    const Vecs offset = place - eight_of(map.from);
    along = dot(eight_of(map.along), offset);
    const Floats side = upper(magnitude(dot(eight_of(map.right), offset)), magnitude(dot(eight_of(map.up), offset)));
    return (along > map.near) & ~(side > (distant ? (Floats)1.0f : along));
}

}  // namespace warpcam
