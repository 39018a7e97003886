// Textures at eight places of one shape, on a CPU: texture/sampler.h and shading/texture_mapping.h, whose comments hold
// here.
#pragma once
#include "shading/plane_vertex_lighting.h"
#include "shading/texture_mapping.h"
#include "shading/surface_simd.h"

namespace warpcam {

// The levels of a texture.
struct Levels {
    int start[MAX_LEVELS], width[MAX_LEVELS], height[MAX_LEVELS];
    int count;
    Float8 columns, rows;  // of the first

    Levels(const Image& image, int images)
    {
        count = min(image.levels, MAX_LEVELS);
        columns = (Float8) float(image.width);
        rows = (Float8) float(image.height);
        Level level { image.start, image.width, images > 1 ? image.width : image.height };
        for (int i = 0; i < count; ++i) {
            start[i] = level.start;
            width[i] = level.width;
            height[i] = level.height;
            level = level.next(images);
        }
    }
};

inline Float8 levels_of_detail(Float8 right, Float8 down, int levels)
{
    const Float8 longer = max(right, down), most = 1.0e30f;
    const Float8 level = min(0.5f * log2(min(max(longer, (Float8)1.0f), most)), (Float8) float(levels - 1));
    return longer > 1.0f ? level : (Float8)0.0f;
}

inline void add_texels(Int8 texel, Float8 weight, Vec3x8& sum)
{
    sum.x += weight * to_floats(texel & 0xff);
    sum.y += weight * to_floats(texel >> 8 & 0xff);
    sum.z += weight * to_floats(texel >> 16 & 0xff);
}

// Adds the colours of four neighbours: two above, two below. JOINED: these stand beside each other.
inline void add_quads(const unsigned* texels, const Int8* quad, bool joined, Float8 x, Float8 y, Float8 total,
                      Vec3x8& sum)
{
    const int* const entries = reinterpret_cast<const int*>(texels);
    const Float8 low = y * total, high = total - low, left = 1.0f - x;
    Int8 found[4];
    if (joined) {
        gather_pairs(entries, quad[0], found[0], found[1]);
        gather_pairs(entries, quad[2], found[2], found[3]);
    } else {
        for (int k = 0; k < 4; ++k)
            found[k] = build_shape_list(entries, quad[k]);
    }
    add_texels(found[0], left * high, sum);
    add_texels(found[1], x * high, sum);
    add_texels(found[2], left * low, sum);
    add_texels(found[3], x * low, sum);
}

inline void add_bilinear(const unsigned* texels, const Levels& levels, Int8 step, Float8 u, Float8 v, Float8 total,
                         Vec3x8& sum)
{
    const Int8 width = look_up(levels.width, step), height = look_up(levels.height, step);
    const Int8 start = look_up(levels.start, step);
    const Float8 x = u * to_floats(width) - 0.5f, y = v * to_floats(height) - 0.5f;
    const Float8 whole_x = round_down(x), whole_y = round_down(y);
    const Int8 i = to_int(whole_x), j = to_int(whole_y);
    const Int8 first = i < 0, last = i + 1 >= width;
    const Int8 left = first ? width - 1 : i, right = last ? (Int8)0 : i + 1;
    const Int8 rows = (j + 1) * width, over = j < 0;
    Int8 above = rows - width;
    if (any(over))
        above = over ? (height - 1) * width : above;
    above += start;
    const Int8 below = start + (j + 1 >= height ? (Int8)0 : rows);
    const Int8 quad[4] = { above + left, above + right, below + left, below + right };
    add_quads(texels, quad, !any(first | last), x - whole_x, y - whole_y, total, sum);
}

inline Vec3x8 sample_levels(const unsigned* texels, const Levels& levels, Float8 detail, Float8 u, Float8 v)
{
    const Int8 step = to_int(detail);
    const Float8 on = detail - to_floats(step);
    u = fraction(u);
    v = fraction(v);
    Vec3x8 sum { (Float8)0.0f, (Float8)0.0f, (Float8)0.0f };
    add_bilinear(texels, levels, step, u, v, 1.0f - on, sum);
    if (any(on > 0.0f))
        add_bilinear(texels, levels, min(step + 1, (Int8)(levels.count - 1)), u, v, on, sum);
    return (Float8)(1.0f / 255.0f) * sum;
}

struct Footprints {
    Float8 u, v, right_u, right_v, down_u, down_v;
};

inline Vec3x8 sample_2d(const unsigned* texels, const Levels& levels, const Footprints& at)
{
    const Float8 right_u = at.right_u * levels.columns, right_v = at.right_v * levels.rows;
    const Float8 down_u = at.down_u * levels.columns, down_v = at.down_v * levels.rows;
    const Float8 detail =
        levels_of_detail(right_u * right_u + right_v * right_v, down_u * down_u + down_v * down_v, levels.count);
    return sample_levels(texels, levels, detail, at.u, at.v);
}

inline Int8 cube_faces(Vec3x8 v)
{
    const Float8 x = abs(v.x), y = abs(v.y), z = abs(v.z), none = 0.0f;
    const Int8 first = (x >= y) & (x >= z), second = y >= z;
    const Float8 along = first ? v.x : second ? v.y : v.z;
    return (first ? (Int8)0 : second ? (Int8)2 : (Int8)4) + (along < none ? (Int8)1 : (Int8)0);
}

inline Vec3x8 to_faces(Int8 face, Vec3x8 v)
{
    const Int8 first = face < 2, second = face < 4;
    const Float8 turn = (face & 1) != 0 ? (Float8)-1.0f : (Float8)1.0f;
    return { first    ? -turn * v.z
             : second ? v.x
                      : turn * v.x,
             second & ~first ? turn * v.z : -v.y,
             turn
                 * (first    ? v.x
                    : second ? v.y
                             : v.z) };
}

inline Vec3x8 from_faces(Int8 face, Vec3x8 v)
{
    const Int8 first = face < 2, second = face < 4;
    const Float8 turn = (face & 1) != 0 ? (Float8)-1.0f : (Float8)1.0f;
    return { first    ? turn * v.z
             : second ? v.x
                      : turn * v.x,
             second & ~first ? turn * v.z : -v.y, first ? -turn * v.x : turn * (second ? v.y : v.z) };
}

// A texel of the face, or of the one that it lies on beyond the edge.
inline Int8 cube_texels(Int8 start, Int8 size, Int8 face, Int8 i, Int8 j)
{
    const Int8 beyond = (i < 0) | (j < 0) | (i >= size) | (j >= size);
    const Float8 half = 0.5f * to_floats(size), rate = rcp(half), one = 1.0f;
    const Vec3x8 direction =
        from_faces(face, { (to_floats(i) + 0.5f) * rate - 1.0f, (to_floats(j) + 0.5f) * rate - 1.0f, one });
    const Int8 other = cube_faces(direction);
    const Vec3x8 place = to_faces(other, direction);
    const Float8 outwards = rcp(place.z);
    i = beyond ? to_int((place.x * outwards + 1.0f) * half) : i;
    j = beyond ? to_int((place.y * outwards + 1.0f) * half) : j;
    face = beyond ? other : face;
    return start + (face * size + clamp(j, (Int8)0, size - 1)) * size + clamp(i, (Int8)0, size - 1);
}

inline void add_bilinear_cube(const unsigned* texels, const Levels& levels, Int8 step, Int8 face, Float8 s, Float8 t,
                              Float8 total, Vec3x8& sum)
{
    const Int8 size = look_up(levels.width, step), start = look_up(levels.start, step);
    const Float8 x = s * to_floats(size) - 0.5f, y = t * to_floats(size) - 0.5f;
    const Float8 whole_x = round_down(x), whole_y = round_down(y);
    const Int8 i = to_int(whole_x), j = to_int(whole_y), corner = start + (face * size + j) * size + i;
    Int8 quad[4] = { corner, corner + 1, corner + size, corner + size + 1 };
    const bool beyond = any((i < 0) | (j < 0) | (i + 1 >= size) | (j + 1 >= size));
    if (beyond)
        for (int k = 0; k < 4; ++k)
            quad[k] = cube_texels(start, size, face, i + (k & 1), j + (k >> 1));
    add_quads(texels, quad, !beyond, x - whole_x, y - whole_y, total, sum);
}

static WARPCAM_NOINLINE void sample_cubes(const unsigned* texels, const Levels& levels, const Vec3x8& direction,
                                          const Vec3x8& right, const Vec3x8& down, Vec3x8& color)
{
    const Int8 face = cube_faces(direction);
    const Vec3x8 place = to_faces(face, direction), to_right = to_faces(face, right), to_below = to_faces(face, down);
    const Float8 rate = rcp(max(place.z, (Float8)1.0e-20f)), scale = 0.5f * levels.columns * rate;
    const Float8 x = place.x * rate, y = place.y * rate;
    const Float8 right_x = scale * (to_right.x - x * to_right.z), right_y = scale * (to_right.y - y * to_right.z);
    const Float8 down_x = scale * (to_below.x - x * to_below.z), down_y = scale * (to_below.y - y * to_below.z);
    const Float8 detail =
        levels_of_detail(right_x * right_x + right_y * right_y, down_x * down_x + down_y * down_y, levels.count);
    const Float8 s = saturate(0.5f * x + 0.5f), t = saturate(0.5f * y + 0.5f);
    const Int8 step = to_int(detail);
    const Float8 on = detail - to_floats(step);
    Vec3x8 sum { (Float8)0.0f, (Float8)0.0f, (Float8)0.0f };
    add_bilinear_cube(texels, levels, step, face, s, t, 1.0f - on, sum);
    if (any(on > 0.0f))
        add_bilinear_cube(texels, levels, min(step + 1, (Int8)(levels.count - 1)), face, s, t, on, sum);
    color = (Float8)(1.0f / 255.0f) * sum;
}

inline Vec3x8 slide(Vec3x8 step, Vec3x8 ray, Vec3x8 normal)
{
    const Float8 slope = dot(normal, ray);
    const Int8 grazes = slope * slope < 1.0e-24f * dot(ray, ray);
    const Float8 part = dot(normal, step) * rcp(grazes ? (Float8)1.0f : slope);
    return select(grazes, (Float8)1.0e6f * step, step - part * ray);
}

// One hit at a time.
template <class Types, class Meshes>
static WARPCAM_NOINLINE void other_footprints(const ShapeFromCamera& pose, const TextureLayout& layout,
                                              const Meshes& meshes, const SurfaceInteraction8& surface,
                                              const Vec3x8& ray, const Vec3x8& right, const Vec3x8& down,
                                              Footprints& at)
{
    for (int k = 0; k < SIMD_WIDTH; ++k) {
        const Footprint one = footprint_2d<Types>(pose, layout, meshes, get_lane(surface, k), get_lane(ray, k),
                                                  get_lane(right, k), get_lane(down, k));
        at.u[k] = one.u;
        at.v[k] = one.v;
        at.right_u[k] = one.right.x;
        at.right_v[k] = one.right.y;
        at.down_u[k] = one.down.x;
        at.down_v[k] = one.down.y;
    }
}

// Laid along the x axis where `first`, along z where not `upright`, else along y; `right` and `down` are steps of the
// hits.
inline void footprints_along(Int8 first, Int8 upright, const TextureLayout& layout, const Vec3x8& local,
                             const Vec3x8& right, const Vec3x8& down, Footprints& at)
{
    const float rate_u = layout.repeat[0], rate_v = -layout.repeat[1];
    const auto along_u = [&](const Vec3x8& v) { return rate_u * (first ? v.y : v.x); };
    const auto along_v = [&](const Vec3x8& v) { return rate_v * (upright ? v.z : v.y); };
    at = { along_u(local), 1.0f + along_v(local), along_u(right), along_v(right), along_u(down), along_v(down) };
}

template <class Types, class Meshes> inline void footprints_2d(const ShapeFromCamera& pose, const TextureLayout& layout,
                                                               const Meshes& meshes, const SurfaceInteraction8& surface,
                                                               const Vec3x8& ray, const Vec3x8& right,
                                                               const Vec3x8& down, Footprints& at)
{
    using Others = SceneTypes<Types::GEOMETRY & ~(1 << PLANE | 1 << HEIGHT_FIELD), Types::FEATURES>;
    if constexpr (Types::has(PLANE)) {
        if (pose.type() == PLANE) {
            const float rate_u = layout.repeat[0], rate_v = layout.repeat[1];
            const Float8 slope = rcp(ray.z), rise_right = right.z * slope, rise_down = down.z * slope;
            at = { surface.local.x * rate_u + layout.start[0], surface.local.y * rate_v + layout.start[1],
                   rate_u * (right.x - rise_right * ray.x),    rate_v * (right.y - rise_right * ray.y),
                   rate_u * (down.x - rise_down * ray.x),      rate_v * (down.y - rise_down * ray.y) };
            return;
        }
    }
    if constexpr (Types::has(PROJECTED)) {
        if (!(Types::has(MESH) && pose.type() == MESH)) {
            const Vec3x8 normal = surface.normal;
            const Float8 x = abs(normal.x), y = abs(normal.y), z = abs(normal.z);
            const Int8 first = (x >= y) & (x >= z);
            footprints_along(first, first | (y >= z), layout, surface.local, slide(right, ray, normal),
                             slide(down, ray, normal), at);
            return;
        }
    }
    if constexpr (!Types::has(PROJECTED) && Types::has_any(MESH, HEIGHT_FIELD)) {
        if (pose.type() == HEIGHT_FIELD || (pose.type() == MESH && !layout.own)) {  // laid on from above
            const float rate_u = layout.repeat[0] * 0.5f * rcp(max(layout.extent.x, 1.0e-12f));
            const float rate_v = layout.repeat[1] * -0.5f * rcp(max(layout.extent.y, 1.0e-12f));
            const Vec3x8 to_right = slide(right, ray, surface.normal), to_below = slide(down, ray, surface.normal);
            at = { rate_u * surface.local.x - 0.5f,
                   rate_v * surface.local.y - 0.5f,
                   rate_u * to_right.x,
                   rate_v * to_right.y,
                   rate_u * to_below.x,
                   rate_v * to_below.y };
            return;
        }
    }
    if constexpr (Others::GEOMETRY != 0)
        other_footprints<Others>(pose, layout, meshes, surface, ray, right, down, at);
}

template <class Types> inline Vec3x8 cube_directions(const ShapeFromCamera& pose, const TextureLayout& layout,
                                                     const SurfaceInteraction8& surface, Vec3x8& scale)
{
    const int type = pose.type();
    const Vec3 half = as_vec3(layout.extent);
    Vec3x8 place = surface.local;
    Vec3 rates { 1.0f, 1.0f, 1.0f };
    if (type != PLANE && type != HEIGHT_FIELD && type != MESH)
        rates = { rcp(half.x), rcp(half.y), rcp(half.z) };
    scale = broadcast(rates);
    visit_shape<Types::GEOMETRY>(type, [&](auto shape) { shape.fit_cube(half, surface.part, place, scale); });
    if (layout.extent.w)
        scale = mul(scale, broadcast(half));
    return mul(place, scale);
}

// The texture's colours at packets of hits. `steps(n, right, down)` says how far it is to what the next pixels show.
template <class Types, class Appearances, class Meshes, class Textures, class Steps>
WARPCAM_NOINLINE_CPU inline void texture_colors(const Appearances& look, const Levels& levels, const Meshes& meshes,
                                                const Textures& textures, const Steps& steps,
                                                const SurfaceInteraction8* surfaces, const Vec3x8* rays, int packets,
                                                Vec3x8* colors)
{
    const TextureLayout& layout = look.layout;
    const ShapeFromCamera& pose = look.pose;
    for (int n = 0; n < packets; ++n) {
        const Vec3x8 ray = rays[n];
        Vec3x8 right, down;
        steps(n, right, down);
        if (layout.cube) {
            Vec3x8 scale;
            const Vec3x8 direction = cube_directions<Types>(pose, layout, surfaces[n], scale);
            sample_cubes(textures.texels.data, levels, direction, mul(scale, slide(right, ray, surfaces[n].normal)),
                         mul(scale, slide(down, ray, surfaces[n].normal)), colors[n]);
            continue;
        }
        Footprints at;
        const auto sampled = [&] {
            if constexpr (Appearances::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            return sample_2d(textures.texels.data, levels, at);
        };
        if constexpr (Types::has(TRIPLANAR)) {
            if (is_blended<Types>(pose, layout)) {
                const Vec3x8 along = slide(right, ray, surfaces[n].normal),
                             below = slide(down, ray, surfaces[n].normal);
                Vec3x8 share, sum { (Float8)0.0f, (Float8)0.0f, (Float8)0.0f };
                for (int k = 0; k < SIMD_WIDTH; ++k) {
                    const Vec3 one = shares_of(smooth_normal<Types>(pose, meshes, get_lane(surfaces[n], k)));
                    share.x[k] = one.x;
                    share.y[k] = one.y;
                    share.z[k] = one.z;
                }
                for (int axis = 0; axis < 3; ++axis) {
                    footprints_along((Int8)(axis == 0 ? -1 : 0), (Int8)(axis == 2 ? 0 : -1), layout, surfaces[n].local,
                                     along, below, at);
                    sum = sum + (axis == 0 ? share.x : axis == 1 ? share.y : share.z) * sampled();
                }
                colors[n] = sum;
                continue;
            }
        }
        footprints_2d<Types>(pose, layout, meshes, surfaces[n], ray, right, down, at);
        colors[n] = sampled();
    }
}

}  // namespace warpcam
