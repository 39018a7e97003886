// Appearance of a shape with its material and own colour resolved, and the joint appearance of shapes that coincide.
#pragma once
#include "geometry/shape_state.h"

namespace warpcam {

struct ResolvedMaterial {
    Float3Int color;  // RGB; w: texture or -1
    Float3Int gloss;  // x: emission, y: specular, z: exponent of the highlight; w unused
};

// Material of coincident shapes. The last of them is visible, but light that casts shadows is added once for each, as
// MuJoCo's renderer does: its light passes draw all of them where the last was drawn.
struct JointMaterial : ResolvedMaterial {
    Float3Int joint;  // sums over all of them: RGB; w: bits of what is specular
};

// Reflectance for light that casts shadows.
struct Reflectance {
    Vec3 matt;
    float gloss;
};

WARPCAM_DEVICE Reflectance of_casting(const ResolvedMaterial& material)
{
    return { as_vec3(material.color), material.gloss.y };
}
WARPCAM_DEVICE Reflectance of_casting(const JointMaterial& material)
{
    return { as_vec3(material.joint), as_float(material.joint.w) };
}

// The index of a shape's material, or -1: indices can be written by the user at any time.
template <class Shapes, class Materials>
WARPCAM_DEVICE int material_of(const Shapes& shapes, const Materials& materials, int world, int id)
{
    const int index = per_world(shapes.materials, world, id);
    return index < materials.color.shape[1] ? index : -1;
}

enum Role {
    ROLE_COLOR = 1,
    ROLE_NORMAL = 5,
    ROLE_OPACITY = 6,
    ROLE_EMISSION = 7,
    ROLE_PACKED = 9
};  // values of types.py

template <class Materials>
WARPCAM_DEVICE int texture_of(const Materials& materials, int world, int material, Role role = ROLE_COLOR)
{
    const int rows = materials.texture.shape[0];
    return *wp::address(materials.texture, world < rows ? world : remainder(world, rows), material, role);
}

// A shape's own colour counts where it has been set: where it differs from the default, (0.5, 0.5, 0.5, 1). The
// material of a shape without one is MuJoCo's: half specular, half shininess.
template <bool MATERIAL, class Shapes, class Materials>
WARPCAM_DEVICE ResolvedMaterial load_material(const Shapes& shapes, const Materials& materials, int world, int id)
{
    auto color = per_world(shapes.colors, world, id);
    ResolvedMaterial material { { 0.0f, 0.0f, 0.0f, -1 }, { 0.0f, 0.5f, 64.0f, 0 } };
    const int index = MATERIAL ? material_of(shapes, materials, world, id) : -1;
    if (MATERIAL && index >= 0) {
        if (color[0] == 0.5f && color[1] == 0.5f && color[2] == 0.5f && color[3] == 1.0f)
            color = per_world(materials.color, world, index);
        material.color.w = texture_of(materials, world, index);
        material.gloss.x = per_world(materials.emission, world, index);
        material.gloss.y = per_world(materials.specular, world, index);
        material.gloss.z =
            128.0f * min(max(per_world(materials.shininess, world, index), 0.0f), 1.0f);  // as OpenGL takes
    }
    material.color.x = color[0];
    material.color.y = color[1];
    material.color.z = color[2];
    return material;
}

// True if both shapes coincide now, as they did when the scene was built.
template <class Shapes> WARPCAM_DEVICE bool coincide(const Shapes& shapes, int world, int id, int other)
{
    return wp::index(shapes.positions, world, id) == wp::index(shapes.positions, world, other)
           && wp::index(shapes.rotations, world, id) == wp::index(shapes.rotations, world, other)
           && per_world(shapes.sizes, world, id) == per_world(shapes.sizes, world, other)
           && per_world(shapes.assets, world, id) == per_world(shapes.assets, world, other);
}

template <bool MATERIAL, class Shapes, class Materials>
WARPCAM_DEVICE Float3Int load_joint(const Shapes& shapes, const Materials& materials, int world, int id,
                                    const ResolvedMaterial& material)
{
    Reflectance sum = of_casting(material);
    int other = opacity(shapes, materials, world, id) >= SOLID ? int(wp::index(shapes.coincident, id)) : -1;
    for (; other >= 0 && other != id; other = wp::index(shapes.coincident, other)) {
        if (!coincide(shapes, world, id, other) || opacity(shapes, materials, world, other) < SOLID)
            continue;
        const Reflectance own = of_casting(load_material<MATERIAL>(shapes, materials, world, other));
        sum = { sum.matt + own.matt, sum.gloss + own.gloss };
    }
    return make_float3_int(sum.matt, as_int(sum.gloss));
}

}  // namespace warpcam
