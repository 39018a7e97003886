// Per-shape shading data in shared memory: pose in the view's frame, size, material.
#pragma once
#include "shading/plane_grid.h"
#include "shading/resolved_material.h"
#include "core/conditional.h"
#include "core/srgb.h"
#include "texture/sampler.h"

namespace warpcam {

// Bits of a set of images: what shading_pass/shading_pass.h writes. Values of flags.py.
enum ImageBit { RGB = 1, RGBA = 2, HDR = 4, NORMALS = 8, ALBEDO = 16 };
// Features of a scene and of an image that shading is compiled for.
enum ShadingFlag {
    HAS_MATERIALS = 1,
    HAS_TEXTURES = 2,
    HAS_SKYBOX = 4,
    HAS_SHADOWS = 8,
    STORE_QUADS = 16,
    WHOLE_REGIONS = 32,  // the image has no part of a region
    SEPARATE_PLANE_PATH = 64,  // few shapes and no meshes: there is room to draw floors apart and to look up in atlases
    PLANE_STRIPS = 128,  // floors may be drawn by strips: shading_pass/plane_strips.h
    PHYSICAL = 1 << 12,  // is lit as shading/pbr.h does it, else as shading/fixed_function.h does
    HAS_MAPS = 1 << 13,  // some material has more than the texture of its colour
    GENERAL_PLANES = 1 << 15,  // see LitVertexGrid
    HAS_OFFSETS = 1 << 20,  // textures are moved: shading/world_overrides.h
    HAS_MIPS = 1 << 24  // each texture but cubes has a mipmapped one; told where floors are looked up by them
};
// Flags of features beyond one layer. MIRROR_VIEW: the view is the one from behind the mirror; HAS_MIRROR: the images
// hold what is seen from there; HAS_TRANSPARENT: some shapes may be transparent; HAS_HAZE: an infinite plane has a haze
// over its horizon; HAS_REFLECTIONS: what surfaces mirror and what is seen through them has been traced, as
// occlusion/reflection_rays.h does it; WRITE_BACK_TRANSPARENT: what covers most of a pixel replaces the trace's result there, so that
// edges are smoothed by it.
enum LayerFact {
    MIRROR_VIEW = 1 << 8,
    HAS_MIRROR = 1 << 9,
    HAS_TRANSPARENT = 1 << 10,
    HAS_HAZE = 1 << 11,
    HAS_REFLECTIONS = 1 << 17,
    WRITE_BACK_TRANSPARENT = 1 << 14
};

// Inputs that a set of images and flags needs.
template <int IMAGES, int FLAGS> struct ShadingNeeds {
    static constexpr bool DISPLAY = (IMAGES & (RGB | RGBA)) != 0;
    static constexpr bool LIT = DISPLAY || (IMAGES & HDR);
    static constexpr bool COLORED = LIT || (IMAGES & ALBEDO);
    static constexpr bool MATERIAL = FLAGS & HAS_MATERIALS;
    static constexpr bool TEXTURED = COLORED && MATERIAL && (FLAGS & HAS_TEXTURES);
    static constexpr bool SHIFTED = TEXTURED && (FLAGS & HAS_OFFSETS);
    static constexpr bool USE_ATLAS = TEXTURED && (FLAGS & SEPARATE_PLANE_PATH);
    static constexpr bool WORLD_NORMALS = IMAGES & NORMALS;
    static constexpr bool SURFACE = LIT || TEXTURED || WORLD_NORMALS;
    static constexpr bool PBR = COLORED && (FLAGS & PHYSICAL);
    static constexpr bool MAPPED = PBR && (FLAGS & HAS_MAPS);
    static constexpr bool GOURAUD = LIT && !(FLAGS & PHYSICAL);
    static constexpr bool JOINS = LIT && (FLAGS & HAS_SHADOWS);
    static constexpr bool DIMMED = FLAGS & MIRROR_VIEW;  // colours are those that the mirror shows
};

// Material of a shape in a physically based scene, with the shape's own colour resolved.
struct PbrMaterial {
    Float3Int color;  // RGB, linear; w: texture or -1
    Float3Int gloss;  // x: roughness, y: metallic, z: reflectance of what is no metal; w: packed texture or -1
    Float3Int emission;  // RGB, linear; w: texture or -1
    int normals;  // texture or -1
    float glow;  // factor of the surface's own colour that it emits besides
};

// Layout of a texture on a shape.
struct TextureLayout {
    Float3Int extent;  // the half extents that MuJoCo gives its renderer; w: 1 if a cube texture repeats by the metre
    Image image;  // none where a texture of the kind does not show
    float repeat[2];  // of a 2-D texture on the shape; on a plane the rates of u and v along x and y [1/m]
    float start[2];  // u and v in a plane's middle
    int cube;  // 1: a cube texture
    int own;  // 1: a mesh with texture coordinates of its own
    unsigned long long atlas;  // see Textures.atlases; 0: none
};

// The shape's axes in the world.
struct ShapeToWorldRotation {
    Float3Int axis_x, axis_y, axis_z;

    WARPCAM_DEVICE Vec3 world(Vec3 v) const { return transform_rows(*this, v); }
};

// Offset of a texture on its shape, in images.
struct Shift {
    float shift_u, shift_v;
};
struct Unmoved {};

// Adds it to a place on the texture.
template <class Appearances> WARPCAM_DEVICE void shift(const Appearances& look, float& u, float& v)
{
    if constexpr (Appearances::SHIFTED) {
        u += look.shift_u;
        v += look.shift_v;
    }
}

// Only what the images need.
template <class Types, class Wants> struct ShapeAppearance : conditional_t<Wants::SHIFTED, Shift, Unmoved> {
    static constexpr bool SHIFTED = Wants::SHIFTED, TEXTURED = Wants::TEXTURED, USE_ATLAS = Wants::USE_ATLAS;
    optional_t<Wants::SURFACE, ShapeFromCamera> pose;
    static constexpr bool JOINT = Wants::JOINS && Types::has(COINCIDENT);
    using Material_ = conditional_t<JOINT, JointMaterial, ResolvedMaterial>;
    optional_t<Wants::COLORED, conditional_t<Wants::PBR, PbrMaterial, Material_>> material;
    optional_t<Wants::WORLD_NORMALS, ShapeToWorldRotation> turn;
    optional_t<Wants::TEXTURED, TextureLayout> layout;
    optional_t<Wants::GOURAUD && Types::has(PLANE), PlaneGrid> cells;
};

template <class Types, class Shapes, class Meshes>
WARPCAM_DEVICE ShapeFromCamera load_pose(const Shapes& shapes, const Meshes& meshes, const Camera& camera, int world,
                                         int id)
{
    const auto r = wp::index(shapes.rotations, world, id);
    const Vec3 away = camera.origin - as_vec3(wp::index(shapes.positions, world, id));
    const Mat3 turn = as_mat3(r), view = transposed_times(turn, camera.rotation);
    const Vec3 eye = transform_transposed(turn, away);
    const int type = wp::index(shapes.types, id), asset = per_world(shapes.assets, world, id);
    Vec3 size = as_vec3(per_world(shapes.sizes, world, id));
    if (Types::has(MESH) && !Types::has(PER_SHAPE_SCALE) && type == MESH && asset >= 0) {
        size.x = as_float(wp::index(meshes.face_start, asset));
        size.y = as_float(wp::index(meshes.corner_start, asset));
    }
    return { { view.at[0][0], view.at[0][1], view.at[0][2], as_int(eye.x) },
             { view.at[1][0], view.at[1][1], view.at[1][2], as_int(eye.y) },
             { view.at[2][0], view.at[2][1], view.at[2][2], as_int(eye.z) },
             make_float3_int(size, type + 16 * (asset + 1)) };
}

template <class Shapes> WARPCAM_DEVICE ShapeToWorldRotation load_turn(const Shapes& shapes, int world, int id)
{
    const auto r = wp::index(shapes.rotations, world, id);
    return { { r.data[0][0], r.data[0][1], r.data[0][2], 0 },
             { r.data[1][0], r.data[1][1], r.data[1][2], 0 },
             { r.data[2][0], r.data[2][1], r.data[2][2], 0 } };
}

// Loads the material of a shape in a physically based scene.
template <bool MATERIAL, bool MAPS, class Shapes, class Materials, class Physical>
WARPCAM_DEVICE PbrMaterial load_pbr_material(const Shapes& shapes, const Materials& materials, const Physical& physical,
                                             int world, int id)
{
    const ResolvedMaterial material = load_material<MATERIAL>(shapes, materials, world, id);
    PbrMaterial pbr;
    pbr.color = make_float3_int(srgb_to_linear(as_vec3(material.color)), material.color.w);
    pbr.gloss = { 0.5f, 0.0f, 0.04f, -1 };
    pbr.emission = { 0.0f, 0.0f, 0.0f, -1 };
    pbr.normals = -1;
    pbr.glow = material.gloss.x;
    const int index = MATERIAL ? material_of(shapes, materials, world, id) : -1;
    if (index >= 0) {
        pbr.gloss.x = per_world(physical.roughness, world, index);
        pbr.gloss.y = per_world(physical.metallic, world, index);
        pbr.gloss.z = per_world(physical.reflectance, world, index);
        pbr.emission = make_float3_int(as_vec3(per_world(physical.emissive, world, index)), -1);
        if (MAPS) {
            pbr.normals = texture_of(materials, world, index, ROLE_NORMAL);
            pbr.gloss.w = texture_of(materials, world, index, ROLE_PACKED);
            pbr.emission.w = texture_of(materials, world, index, ROLE_EMISSION);
        }
    }
    return pbr;
}

// The half extents of a shape as MuJoCo gives them to its renderer.
template <class Types, class Meshes, class HeightFields>
WARPCAM_DEVICE Vec3 extent_of(const ShapeFromCamera& pose, const Meshes& meshes, const HeightFields& fields)
{
    const Vec3 size = as_vec3(pose.size);
    const int type = pose.type(), asset = pose.asset();
    if (Types::has(MESH) && type == MESH && asset >= 0) {
        const auto lo = wp::index(meshes.bounds_min, asset), hi = wp::index(meshes.bounds_max, asset);
        return { max(abs(lo[0]), abs(hi[0])), max(abs(lo[1]), abs(hi[1])), max(abs(lo[2]), abs(hi[2])) };
    }
    if (Types::has(HEIGHT_FIELD) && type == HEIGHT_FIELD && asset >= 0) {
        const auto field = wp::index(fields.size, asset);
        return { field[0], field[1], 0.25f * field[2] + 0.5f * field[3] };
    }
    Vec3 half = size;
    visit_shape<Types::GEOMETRY>(type, [&](auto shape) { half = shape.axes(size); });
    return half;
}

// Repeats of an image along an axis. MuJoCo's renderer takes values that are not positive for 1, except where it
// projects images from above.
template <class Types> WARPCAM_DEVICE float repeat_of(float given, int type, int own)
{
    const bool from_above = Types::has(TEXTURE_FROM_ABOVE) || type == HEIGHT_FIELD || (type == MESH && !own);
    return given > 0.0f || from_above ? given : 1.0f;
}

// PHYSICALLY: images are repeated as the material says.
template <class Types, bool PHYSICALLY, class Shapes, class Materials, class Textures, class Meshes, class HeightFields>
WARPCAM_DEVICE TextureLayout load_layout(const Shapes& shapes, const Materials& materials, const Textures& textures,
                                         const Meshes& meshes, const HeightFields& fields, const ShapeFromCamera& pose,
                                         int texture, int world, int id)
{
    TextureLayout layout { { 0.0f, 0.0f, 0.0f, 0 }, load_image(textures, texture), { 1.0f, 1.0f }, {}, 0, 0, 0 };
    const int index = material_of(shapes, materials, world, id);
    if (index < 0)
        return layout;
    const int kind = layout.image.levels > 0 ? int(wp::index(textures.kind, texture)) : TEXTURE_2D;
    layout.cube = kind == TEXTURE_CUBE;
    const bool uniform = per_world(materials.texture_uniform, world, index);
    if (Types::has(MESH) && pose.type() == MESH && pose.asset() >= 0)
        layout.own = wp::index(meshes.has_uvs, pose.asset());
    const auto given = per_world(materials.texture_repeat, world, index);
    float repeat[2] = { given[0], given[1] };
    for (int axis = 0; axis < 2 && !PHYSICALLY; ++axis)
        repeat[axis] = repeat_of<Types>(repeat[axis], pose.type(), layout.own);
    const Vec3 extent = extent_of<Types>(pose, meshes, fields);
    layout.extent =
        make_float3_int(extent, uniform && extent.x + extent.y > 0.0f);  // metres on endless planes all the same
    layout.repeat[0] = repeat[0] * (uniform && extent.x > 0.0f ? extent.x : 1.0f);
    layout.repeat[1] = repeat[1] * (uniform && extent.y > 0.0f ? extent.y : 1.0f);
    if constexpr (Types::has(PROJECTED)) {
        layout.repeat[0] = repeat[0];
        layout.repeat[1] = repeat[1];
        if (pose.type() == PLANE) {
            layout.start[1] = 1.0f;
            layout.repeat[1] = -repeat[1];
        }
        return layout;
    }
    if (Types::has(PLANE) && pose.type() == PLANE) {  // a side of length 0 is endless, two metres an image
        constexpr bool FROM_MIDDLE = Types::has(TEXTURE_FROM_ABOVE);
        const float offset = extent.x <= 0.0f || extent.y <= 0.0f || FROM_MIDDLE ? -0.5f : 0.0f;
        const float half[2] = { extent.x, extent.y };
        for (int axis = 0; axis < 2; ++axis) {
            layout.start[axis] = (half[axis] > 0.0f && !FROM_MIDDLE ? 0.5f * layout.repeat[axis] : 0.0f) + offset;
            layout.repeat[axis] *= (axis == 0 ? 0.5f : -0.5f) * (half[axis] > 0.0f ? rcp(half[axis]) : 1.0f);
        }
    }
    if (layout.cube && layout.own)  // on such a mesh a cube texture does not show
        layout.image.levels = 0;
    if constexpr (Types::has(TEXTURELESS_SHAPES)) {  // cylinders whose third size is -1, and some meshes
        if (layout.own < 0 || (pose.type() == CYLINDER && pose.size.z < 0.0f))
            layout.image.levels = 0;
        for (int axis = 0; axis < 2 && layout.own == 2; ++axis)
            layout.repeat[axis] = repeat[axis];
    }
    return layout;
}

// Loads the parts of an appearance that only textured shapes and planes use.
template <class Types, class Wants, class Shapes, class Materials, class Textures, class Meshes, class HeightFields>
WARPCAM_DEVICE void load_rest(ShapeAppearance<Types, Wants>& look, const Shapes& shapes, const Materials& materials,
                              const Textures& textures, const Meshes& meshes, const HeightFields& fields, float horizon,
                              int world, int id)
{
    if constexpr (Wants::TEXTURED)
        look.layout = load_layout<Types, Wants::PBR>(shapes, materials, textures, meshes, fields, look.pose,
                                                     look.material.color.w, world, id);
    if constexpr (Wants::USE_ATLAS)
        look.layout.atlas = atlas_of(textures, look.material.color.w);
    if constexpr (Wants::GOURAUD && Types::has(PLANE)) {
        const int index = Wants::MATERIAL ? material_of(shapes, materials, world, id) : -1;
        float repeat[2] = { 0.0f, 0.0f };
        if (Wants::MATERIAL && index >= 0)
            for (int axis = 0; axis < 2; ++axis)
                repeat[axis] = per_world(materials.texture_repeat, world, index)[axis];
        look.cells = plane_cells(look.pose, repeat, horizon);
    }
}

template <class Types, class Wants, class Shapes, class Materials, class Physical, class Textures, class Meshes,
          class HeightFields>
WARPCAM_NOINLINE_CPU WARPCAM_DEVICE ShapeAppearance<Types, Wants> load_appearance(
    const Shapes& shapes, const Materials& materials, const Physical& physical, const Textures& textures,
    const Meshes& meshes, const HeightFields& fields, const Camera& camera, float horizon, int world, int id)
{
    ShapeAppearance<Types, Wants> look;
    if constexpr (Wants::SURFACE)
        look.pose = load_pose<Types>(shapes, meshes, camera, world, id);
    if constexpr (Wants::WORLD_NORMALS)
        look.turn = load_turn(shapes, world, id);
    if constexpr (Wants::COLORED && !Wants::PBR) {
        const ResolvedMaterial material = load_material<Wants::MATERIAL>(shapes, materials, world, id);
        static_cast<ResolvedMaterial&>(look.material) = material;
        if constexpr (ShapeAppearance<Types, Wants>::JOINT)
            look.material.joint = load_joint<Wants::MATERIAL>(shapes, materials, world, id, material);
    }
    if constexpr (Wants::PBR)
        look.material = load_pbr_material<Wants::MATERIAL, Wants::MAPPED>(shapes, materials, physical, world, id);
    load_rest(look, shapes, materials, textures, meshes, fields, horizon, world, id);
    return look;
}

// Looks without that: enough of most shapes.
template <class Wants> struct Untextured : Wants {
    static constexpr bool TEXTURED = false, SHIFTED = false, USE_ATLAS = false, GOURAUD = false;
};

// Appearances of the shapes that a block sees, as far as shared memory has room, for scenes too large to store all.
// PLACES: room for the drawn shapes' marks.
template <class Types_, class Wants_, int PLACES, int SIZE> struct SeenLooks {
    using Types = Types_;
    static constexpr bool MARKED = THREADS > 1 && PLACES > 1;
    using Wants = Wants_;

    ShapeAppearance<Types, Wants> plane;  // whose corners are kept: shading/plane_vertex_lighting.h
    ShapeAppearance<Types, Untextured<Wants>> looks[SIZE];
    unsigned short marks[PLACES];  // by place among the drawn shapes: 1 + where its look is, or 0
    int count;
};

}  // namespace warpcam
