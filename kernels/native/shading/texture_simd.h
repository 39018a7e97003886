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
    Floats columns, rows;  // of the first

    Levels(const Image& image, int images)
    {
        count = lower_int(image.levels, MAX_LEVELS);
        columns = (Floats)float(image.width);
        rows = (Floats)float(image.height);
        Level level { image.start, image.width, images > 1 ? image.width : image.height };
        for (int i = 0; i < count; ++i) {
            start[i] = level.start;
            width[i] = level.width;
            height[i] = level.height;
            level = level.next(images);
        }
    }
};

inline Floats levels_of_detail(Floats right, Floats down, int levels)
{
    const Floats longer = upper(right, down), most = 1.0e30f;
    const Floats level = lower(0.5f * logarithm2(lower(upper(longer, (Floats)1.0f), most)), (Floats)float(levels - 1));
    return longer > 1.0f ? level : (Floats)0.0f;
}

inline void add_texels(Ints texel, Floats weight, Vecs& sum)
{
    sum.x += weight * to_floats(texel & 0xff);
    sum.y += weight * to_floats(texel >> 8 & 0xff);
    sum.z += weight * to_floats(texel >> 16 & 0xff);
}

// Adds the colours of four neighbours: two above, two below. JOINED: these stand beside each other.
inline void add_quads(const unsigned* texels, const Ints* quad, bool joined, Floats x, Floats y, Floats total,
                      Vecs& sum)
{
    const int* const entries = reinterpret_cast<const int*>(texels);
    const Floats low = y * total, high = total - low, left = 1.0f - x;
    Ints found[4];
    if (joined) {
        gather_pairs(entries, quad[0], found[0], found[1]);
        gather_pairs(entries, quad[2], found[2], found[3]);
    } else {
        for (int k = 0; k < 4; ++k)
            found[k] = gather(entries, quad[k]);
    }
    add_texels(found[0], left * high, sum);
    add_texels(found[1], x * high, sum);
    add_texels(found[2], left * low, sum);
    add_texels(found[3], x * low, sum);
}

inline void add_bilinear(const unsigned* texels, const Levels& levels, Ints step, Floats u, Floats v, Floats total,
                         Vecs& sum)
{
    const Ints width = look_up(levels.width, step), height = look_up(levels.height, step);
    const Ints start = look_up(levels.start, step);
    const Floats x = u * to_floats(width) - 0.5f, y = v * to_floats(height) - 0.5f;
    const Floats whole_x = round_down(x), whole_y = round_down(y);
    const Ints i = to_whole(whole_x), j = to_whole(whole_y);
    const Ints first = i < 0, last = i + 1 >= width;
    const Ints left = first ? width - 1 : i, right = last ? (Ints)0 : i + 1;
    const Ints rows = (j + 1) * width, over = j < 0;
    Ints above = rows - width;
    if (any_of(over))
        above = over ? (height - 1) * width : above;
    above += start;
    const Ints below = start + (j + 1 >= height ? (Ints)0 : rows);
    const Ints quad[4] = { above + left, above + right, below + left, below + right };
    add_quads(texels, quad, !any_of(first | last), x - whole_x, y - whole_y, total, sum);
}

inline Vecs sample_levels(const unsigned* texels, const Levels& levels, Floats detail, Floats u, Floats v)
{
    const Ints step = to_whole(detail);
    const Floats on = detail - to_floats(step);
    u = fraction(u);
    v = fraction(v);
    Vecs sum { (Floats)0.0f, (Floats)0.0f, (Floats)0.0f };
    add_bilinear(texels, levels, step, u, v, 1.0f - on, sum);
    if (any_of(on > 0.0f))
        add_bilinear(texels, levels, lower(step + 1, (Ints)(levels.count - 1)), u, v, on, sum);
    return (Floats)(1.0f / 255.0f) * sum;
}

struct Footprints {
    Floats u, v, right_u, right_v, down_u, down_v;
};

inline Vecs sample_2d(const unsigned* texels, const Levels& levels, const Footprints& at)
{
    const Floats right_u = at.right_u * levels.columns, right_v = at.right_v * levels.rows;
    const Floats down_u = at.down_u * levels.columns, down_v = at.down_v * levels.rows;
    const Floats detail = levels_of_detail(right_u * right_u + right_v * right_v, down_u * down_u + down_v * down_v,
                                           levels.count);
    return sample_levels(texels, levels, detail, at.u, at.v);
}

inline Ints cube_faces(Vecs v)
{
    const Floats x = magnitude(v.x), y = magnitude(v.y), z = magnitude(v.z), none = 0.0f;
    const Ints first = (x >= y) & (x >= z), second = y >= z;
    const Floats along = first ? v.x : second ? v.y : v.z;
    return (first ? (Ints)0 : second ? (Ints)2 : (Ints)4) + (along < none ? (Ints)1 : (Ints)0);
}

inline Vecs to_faces(Ints face, Vecs v)
{
    const Ints first = face < 2, second = face < 4;
    const Floats turn = (face & 1) != 0 ? (Floats)-1.0f : (Floats)1.0f;
    return { first ? -turn * v.z : second ? v.x : turn * v.x, second & ~first ? turn * v.z : -v.y,
             turn * (first ? v.x : second ? v.y : v.z) };
}

inline Vecs from_faces(Ints face, Vecs v)
{
    const Ints first = face < 2, second = face < 4;
    const Floats turn = (face & 1) != 0 ? (Floats)-1.0f : (Floats)1.0f;
    return { first ? turn * v.z : second ? v.x : turn * v.x, second & ~first ? turn * v.z : -v.y,
             first ? -turn * v.x : turn * (second ? v.y : v.z) };
}

// A texel of the face, or of the one that it lies on beyond the edge.
inline Ints cube_texels(Ints start, Ints size, Ints face, Ints i, Ints j)
{
    const Ints beyond = (i < 0) | (j < 0) | (i >= size) | (j >= size);
    const Floats half = 0.5f * to_floats(size), rate = reciprocal(half), one = 1.0f;
    const Vecs direction =
        from_faces(face, { (to_floats(i) + 0.5f) * rate - 1.0f, (to_floats(j) + 0.5f) * rate - 1.0f, one });
    const Ints other = cube_faces(direction);
    const Vecs place = to_faces(other, direction);
    const Floats outwards = reciprocal(place.z);
    i = beyond ? to_whole((place.x * outwards + 1.0f) * half) : i;
    j = beyond ? to_whole((place.y * outwards + 1.0f) * half) : j;
    face = beyond ? other : face;
    return start + (face * size + between(j, (Ints)0, size - 1)) * size + between(i, (Ints)0, size - 1);
}

inline void add_bilinear_cube(const unsigned* texels, const Levels& levels, Ints step, Ints face, Floats s, Floats t,
                              Floats total, Vecs& sum)
{
    const Ints size = look_up(levels.width, step), start = look_up(levels.start, step);
    const Floats x = s * to_floats(size) - 0.5f, y = t * to_floats(size) - 0.5f;
    const Floats whole_x = round_down(x), whole_y = round_down(y);
    const Ints i = to_whole(whole_x), j = to_whole(whole_y), corner = start + (face * size + j) * size + i;
    Ints quad[4] = { corner, corner + 1, corner + size, corner + size + 1 };
    const bool beyond = any_of((i < 0) | (j < 0) | (i + 1 >= size) | (j + 1 >= size));
    if (beyond)
        for (int k = 0; k < 4; ++k)
            quad[k] = cube_texels(start, size, face, i + (k & 1), j + (k >> 1));
    add_quads(texels, quad, !beyond, x - whole_x, y - whole_y, total, sum);
}

static WARPCAM_COLD void sample_cubes(const unsigned* texels, const Levels& levels, const Vecs& direction,
                                      const Vecs& right, const Vecs& down, Vecs& color)
{
    const Ints face = cube_faces(direction);
    const Vecs place = to_faces(face, direction), to_right = to_faces(face, right), to_below = to_faces(face, down);
    const Floats rate = reciprocal(upper(place.z, (Floats)1.0e-20f)), scale = 0.5f * levels.columns * rate;
    const Floats x = place.x * rate, y = place.y * rate;
    const Floats right_x = scale * (to_right.x - x * to_right.z), right_y = scale * (to_right.y - y * to_right.z);
    const Floats down_x = scale * (to_below.x - x * to_below.z), down_y = scale * (to_below.y - y * to_below.z);
    const Floats detail = levels_of_detail(right_x * right_x + right_y * right_y, down_x * down_x + down_y * down_y,
                                           levels.count);
    const Floats s = saturated(0.5f * x + 0.5f), t = saturated(0.5f * y + 0.5f);
    const Ints step = to_whole(detail);
    const Floats on = detail - to_floats(step);
    Vecs sum { (Floats)0.0f, (Floats)0.0f, (Floats)0.0f };
    add_bilinear_cube(texels, levels, step, face, s, t, 1.0f - on, sum);
    if (any_of(on > 0.0f))
        add_bilinear_cube(texels, levels, lower(step + 1, (Ints)(levels.count - 1)), face, s, t, on, sum);
    color = (Floats)(1.0f / 255.0f) * sum;
}

inline Vecs slide(Vecs step, Vecs ray, Vecs normal)
{
    const Floats slope = dot(normal, ray);
    const Ints grazes = slope * slope < 1.0e-24f * dot(ray, ray);
    const Floats part = dot(normal, step) * reciprocal(grazes ? (Floats)1.0f : slope);
    return chosen(grazes, (Floats)1.0e6f * step, step - part * ray);
}

// One hit at a time.
template <int TYPES, class Meshes>
static WARPCAM_COLD void other_footprints(const Pose& pose, const Layout& layout, const Meshes& meshes,
                                          const Surfaces& surface, const Vecs& ray, const Vecs& right, const Vecs& down,
                                          Footprints& at)
{
    for (int k = 0; k < PACKET; ++k) {
        const Footprint one = footprint_2d<TYPES>(pose, layout, meshes, one_of(surface, k), one_of(ray, k),
                                                  one_of(right, k), one_of(down, k));
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
inline void footprints_along(Ints first, Ints upright, const Layout& layout, const Vecs& local, const Vecs& right,
                             const Vecs& down, Footprints& at)
{
    const float rate_u = layout.repeat[0], rate_v = -layout.repeat[1];
    const auto along_u = [&](const Vecs& v) { return rate_u * (first ? v.y : v.x); };
    const auto along_v = [&](const Vecs& v) { return rate_v * (upright ? v.z : v.y); };
    at = { along_u(local), 1.0f + along_v(local), along_u(right), along_v(right), along_u(down), along_v(down) };
}

template <int TYPES, class Meshes>
inline void footprints_2d(const Pose& pose, const Layout& layout, const Meshes& meshes, const Surfaces& surface,
                          const Vecs& ray, const Vecs& right, const Vecs& down, Footprints& at)
{
    constexpr int OTHERS = TYPES & ~(1 << PLANE | 1 << HEIGHT_FIELD);
    if constexpr ((TYPES >> PLANE & 1) != 0) {
        if (pose.type() == PLANE) {
            const float rate_u = layout.repeat[0], rate_v = layout.repeat[1];
            const Floats slope = reciprocal(ray.z), rise_right = right.z * slope, rise_down = down.z * slope;
            at = { surface.local.x * rate_u + layout.start[0],
                   surface.local.y * rate_v + layout.start[1],
                   rate_u * (right.x - rise_right * ray.x),
                   rate_v * (right.y - rise_right * ray.y),
                   rate_u * (down.x - rise_down * ray.x),
                   rate_v * (down.y - rise_down * ray.y) };
            return;
        }
    }
    if constexpr ((TYPES >> PROJECTED & 1) != 0) {
        if (!((TYPES >> MESH & 1) && pose.type() == MESH)) {
            const Vecs normal = surface.normal;
            const Floats x = magnitude(normal.x), y = magnitude(normal.y), z = magnitude(normal.z);
            const Ints first = (x >= y) & (x >= z);
            footprints_along(first, first | (y >= z), layout, surface.local, slide(right, ray, normal),
                             slide(down, ray, normal), at);
            return;
        }
    }
    if constexpr (!(TYPES >> PROJECTED & 1) && (TYPES & (1 << MESH | 1 << HEIGHT_FIELD)) != 0) {
        if (pose.type() == HEIGHT_FIELD || (pose.type() == MESH && !layout.own)) {  // laid on from above
            const float rate_u = layout.repeat[0] * 0.5f * reciprocal(upper(layout.extent.x, 1.0e-12f));
            const float rate_v = layout.repeat[1] * -0.5f * reciprocal(upper(layout.extent.y, 1.0e-12f));
            const Vecs to_right = slide(right, ray, surface.normal), to_below = slide(down, ray, surface.normal);
            at = { rate_u * surface.local.x - 0.5f, rate_v * surface.local.y - 0.5f, rate_u * to_right.x,
                   rate_v * to_right.y, rate_u * to_below.x, rate_v * to_below.y };
            return;
        }
    }
    if constexpr (OTHERS != 0)
        other_footprints<OTHERS>(pose, layout, meshes, surface, ray, right, down, at);
}

template <int TYPES>
inline Vecs cube_directions(const Pose& pose, const Layout& layout, const Surfaces& surface, Vecs& scale)
{
    const int type = pose.type();
    const Vec half = to_vec(layout.extent);
    Vecs place = surface.local;
    Vec rates { 1.0f, 1.0f, 1.0f };
    if (type != PLANE && type != HEIGHT_FIELD && type != MESH)
        rates = { reciprocal(half.x), reciprocal(half.y), reciprocal(half.z) };
    scale = eight_of(rates);
    if ((TYPES >> CAPSULE & 1) && type == CAPSULE) {
        const Ints side = surface.part == int(SIDE);
        scale.z = side ? scale.z : scale.x;
        scale.y = side ? scale.y : scale.x;
        const Floats aside = half.x - half.z;
        place.z += side ? (Floats)0.0f : surface.part == int(BOTTOM) ? -aside : aside;
    }
    if (layout.extent.w)
        scale = times(scale, eight_of(half));
    return times(place, scale);
}

// The texture's colours at packets of hits. `steps(n, right, down)` says how far it is to what the next pixels show.
template <int TYPES, class Looks, class Meshes, class Textures, class Steps>
WARPCAM_APART inline void texture_colors(const Looks& look, const Levels& levels, const Meshes& meshes,
                                         const Textures& textures, const Steps& steps, const Surfaces* surfaces,
                                         const Vecs* rays, int packets, Vecs* colors)
{
    const Layout& layout = look.layout;
    const Pose& pose = look.pose;
    for (int n = 0; n < packets; ++n) {
        const Vecs ray = rays[n];
        Vecs right, down;
        steps(n, right, down);
        if (layout.cube) {
            Vecs scale;
            const Vecs direction = cube_directions<TYPES>(pose, layout, surfaces[n], scale);
            sample_cubes(textures.texels.data, levels, direction, times(scale, slide(right, ray, surfaces[n].normal)),
                         times(scale, slide(down, ray, surfaces[n].normal)), colors[n]);
            continue;
        }
        Footprints at;
        const auto sampled = [&] {
            if constexpr (Looks::SHIFTED) {
                at.u += look.shift_u;
                at.v += look.shift_v;
            }
            return sample_2d(textures.texels.data, levels, at);
        };
        if constexpr ((TYPES >> TRIPLANAR & 1) != 0) {
            if (is_blended<TYPES>(pose, layout)) {
                const Vecs along = slide(right, ray, surfaces[n].normal), below = slide(down, ray, surfaces[n].normal);
                Vecs share, sum { (Floats)0.0f, (Floats)0.0f, (Floats)0.0f };
                for (int k = 0; k < PACKET; ++k) {
                    const Vec one = shares_of(smooth_normal<TYPES>(pose, meshes, one_of(surfaces[n], k)));
                    share.x[k] = one.x;
                    share.y[k] = one.y;
                    share.z[k] = one.z;
                }
                for (int axis = 0; axis < 3; ++axis) {
                    footprints_along((Ints)(axis == 0 ? -1 : 0), (Ints)(axis == 2 ? 0 : -1), layout, surfaces[n].local,
                                     along, below, at);
                    sum = sum + (axis == 0 ? share.x : axis == 1 ? share.y : share.z) * sampled();
                }
                colors[n] = sum;
                continue;
            }
        }
        footprints_2d<TYPES>(pose, layout, meshes, surfaces[n], ray, right, down, at);
        colors[n] = sampled();
    }
}

}  // namespace warpcam
