// A shape as it is now, and whether it can be seen and seen through.
#pragma once
#include "camera/shape_setup.h"

namespace warpcam {

// The opacity of a shape's colour. MuJoCo's rule of which colour counts (see shading/appearance.h).
template <class Shapes, class Materials>
WARPCAM_DEVICE float opacity(const Shapes& shapes, const Materials& materials, int world, int id)
{
    const auto color = per_world(shapes.colors, world, id);
    const int material = per_world(shapes.materials, world, id);
    const bool plain = color[0] == 0.5f && color[1] == 0.5f && color[2] == 0.5f && color[3] == 1.0f;
    if (material >= 0 && material < materials.color.shape[1] && plain)
        return per_world(materials.color, world, material)[3];
    return color[3];
}

// True if the shape's colour makes it invisible.
template <class Shapes, class Materials>
WARPCAM_DEVICE bool transparent(const Shapes& shapes, const Materials& materials, int world, int id)
{
    return opacity(shapes, materials, world, id) == 0.0f;
}

constexpr float SOLID = 0.995f;  // opacity from which MuJoCo draws a shape solid

constexpr int OPACITY_MAP = 6;  // ROLE_OPACITY of types.py

// True if the shape's material has an opacity texture. For scenes whose materials have a texture for each role.
template <class Shapes, class Materials>
WARPCAM_DEVICE bool has_opacity_map(const Shapes& shapes, const Materials& materials, int world, int id)
{
    const int material = per_world(shapes.materials, world, id), rows = materials.texture.shape[0];
    return material >= 0 && material < materials.color.shape[1]
           && *wp::address(materials.texture, world % rows, material, OPACITY_MAP) >= 0;
}

// True if the shape hides what lies behind it. `places` is not -1 for shapes that may be transparent. MAPS: some
// materials have opacity textures.
template <bool MAPS = false, class Shapes, class Materials, class Places>
WARPCAM_DEVICE bool solid(const Shapes& shapes, const Materials& materials, const Places& places, int world, int id)
{
    const float alpha = opacity(shapes, materials, world, id);
    if (alpha == 0.0f || wp::index(places, id) < 0)
        return alpha != 0.0f;
    if constexpr (MAPS)
        if (has_opacity_map(shapes, materials, world, id))
            return false;
    return alpha >= SOLID;
}

template <class Shapes> WARPCAM_DEVICE Shape load_shape(const Shapes& shapes, int world, int id)
{
    Shape s;
    s.type = wp::index(shapes.types, id);
    s.id = id;
    s.asset = per_world(shapes.assets, world, id);
    const auto p = wp::index(shapes.positions, world, id);
    const auto r = wp::index(shapes.rotations, world, id);
    const auto size = per_world(shapes.sizes, world, id);
    s.position = { p[0], p[1], p[2] };
    s.size = { size[0], size[1], size[2] };
    s.rotation = as_mat3(r);
    return s;
}

}  // namespace warpcam
