// Looking up textures: a colour at a place, filtered over the footprint of a pixel.
//
// Filtering is trilinear: bilinear in the two mipmap levels around log2 of the footprint's longer side, as OpenGL's
// LINEAR_MIPMAP_LINEAR. 2-D textures repeat; a cube's faces are joined along their edges.
#pragma once
#include "core/vec3.h"

namespace warpcam {

enum TextureKind { TEXTURE_2D, TEXTURE_CUBE };  // values of types.py

// True if `texture` names a texture. Users can write indices at any time.
template <class Textures> WARPCAM_DEVICE bool is_texture(const Textures& textures, int texture)
{
    return texture >= 0 && texture < textures.kind.shape[0];
}

// Texels of one texture: their place in the array, and its size.
struct Image {
    int start, width, height;
    int levels;  // 0: no texture
};

template <class Textures> WARPCAM_DEVICE Image load_image(const Textures& textures, int texture)
{
    if (!is_texture(textures, texture))
        return { 0, 0, 0, 0 };
    return { wp::index(textures.start, texture), wp::index(textures.width, texture),
             wp::index(textures.height, texture), wp::index(textures.levels, texture) };
}

// A sum of texels, each channel 0 to 255, with whole numbers as weights that make WHOLE together.
struct Blend {
    unsigned red, green, blue;
};

constexpr int WHOLE = 65535;

// Adds two texels; their weights are the halves of a word, the first one's the lower.
WARPCAM_DEVICE void add_texels(const unsigned* texels, int first, int second, unsigned weights, Blend& blend)
{
#if defined(__CUDA_ARCH__)
    const unsigned a = __ldg(texels + first), b = __ldg(texels + second);
    const unsigned red_green = __byte_perm(a, b, 0x5140), blue_alpha = __byte_perm(a, b, 0x7362);
    blend.red = __dp2a_lo(weights, red_green, blend.red);
    blend.green = __dp2a_hi(weights, red_green, blend.green);
    blend.blue = __dp2a_lo(weights, blue_alpha, blend.blue);
#else
    const unsigned a = texels[first], b = texels[second], low = weights & 0xffffu, high = weights >> 16;
    blend.red += low * (a & 0xffu) + high * (b & 0xffu);
    blend.green += low * (a >> 8 & 0xffu) + high * (b >> 8 & 0xffu);
    blend.blue += low * (a >> 16 & 0xffu) + high * (b >> 16 & 0xffu);
#endif
}

WARPCAM_DEVICE Vec3 to_color(const Blend& blend)
{
    return (1.0f / (255.0f * WHOLE)) * Vec3 { float(blend.red), float(blend.green), float(blend.blue) };
}

// A float of this size has no places after the point: what is added to it is rounded, and its last bits are a whole
// number.
constexpr float WHOLE_NUMBERS = 8388608.0f;

// Mipmap level, 0 to `levels - 1`, for squares of the steps in texels to the next pixel right and down.
WARPCAM_DEVICE float level_of_detail(float right, float down, int levels)
{
    const float longer = max(right, down);
    if (!(longer > 1.0f))  // NaN too
        return 0.0f;
    return min(0.5f * log2(min(longer, 1.0e30f)), float(levels - 1));
}

// One level of a texture; of a cube, its faces' side.
struct Level {
    int start, width, height;

    WARPCAM_DEVICE Level next(int images) const
    {
        return { start + images * width * height, width > 1 ? width >> 1 : 1, height > 1 ? height >> 1 : 1 };
    }

    // The level some steps on. While sides halve without a rest their areas are a geometric series.
    WARPCAM_DEVICE Level after(int steps, int images) const
    {
        const int low_width = width >> steps, low_height = height >> steps;
        if (low_width << steps == width && low_height << steps == height)
            return { start + images * ((width * height - low_width * low_height) / 3 * 4), low_width, low_height };
        Level level = *this;
#pragma unroll 1
        for (int step = 0; step < steps; ++step)
            level = level.next(images);
        return level;
    }
};

// A place between two texels along one axis: the first of them, -1 to `size - 1`, and how far on.
struct Between {
    int first;
    float on;
};

WARPCAM_DEVICE Between between_texels(float unit, int size)
{
    constexpr float BASE = 1.5f * WHOLE_NUMBERS;  // of whole numbers of either sign
    const float place = unit * float(size) - 0.5f, base = (place - 0.5f) + BASE;
    return { as_int(base) - as_int(BASE), place - (base - BASE) };
}

// Wraps an index: before the first texel comes the last.
WARPCAM_DEVICE int first_or_last(int first, int size)
{
#if defined(__CUDA_ARCH__)
    return int(::min(unsigned(first), unsigned(size - 1)));
#else
    return first < 0 ? size - 1 : first;
#endif
}

// Two weights, of which none is negative and both make WHOLE at most, in the halves of a word: the first in the lower.
WARPCAM_DEVICE unsigned two_weights(float part, float first, float other, float second)
{
    const int low = as_int(fma(part, first, WHOLE_NUMBERS)), high = as_int(fma(other, second, WHOLE_NUMBERS));
#if defined(__CUDA_ARCH__)
    return __byte_perm(low, high, 0x5410);
#else
    return (unsigned(low) & 0xffffu) | unsigned(high) << 16;
#endif
}

// Adds four neighbours, the upper two first, which together weigh `total`.
WARPCAM_DEVICE void add_quad(const unsigned* texels, const int* quad, const Between& x, const Between& y, float total,
                             Blend& blend)
{
    const float low = y.on * total, high = total - low, left = 1.0f - x.on;
    add_texels(texels, quad[0], quad[1], two_weights(left, high, x.on, high), blend);
    add_texels(texels, quad[2], quad[3], two_weights(left, low, x.on, low), blend);
}

// Adds the colour at (u, v) in [0, 1].
WARPCAM_DEVICE void add_bilinear(const unsigned* texels, const Level& level, float u, float v, float total,
                                 Blend& blend)
{
    const Between x = between_texels(u, level.width), y = between_texels(v, level.height);
    const int left = first_or_last(x.first, level.width), right = x.first + 1 >= level.width ? 0 : x.first + 1;
    const int top = first_or_last(y.first, level.height), bottom = y.first + 1 >= level.height ? 0 : y.first + 1;
    const int above = level.start + top * level.width, below = level.start + bottom * level.width;
    const int quad[4] = { above + left, above + right, below + left, below + right };
    add_quad(texels, quad, x, y, total, blend);
}

#if defined(__CUDA_ARCH__)
WARPCAM_DEVICE Vec3 look_up(unsigned long long atlas, float x, float y)
{
    float red, green, blue, alpha;
    asm("tex.2d.v4.f32.f32 {%0, %1, %2, %3}, [%4, {%5, %6}];"
        : "=f"(red), "=f"(green), "=f"(blue), "=f"(alpha)
        : "l"(atlas), "f"(x), "f"(y));
    return { red, green, blue };
}

// Samples a mipmapped texture at (u, v), in images, which repeat.
WARPCAM_DEVICE Vec3 look_up(unsigned long long mips, float u, float v, float level)
{
    float red, green, blue, alpha;
    asm("tex.level.2d.v4.f32.f32 {%0, %1, %2, %3}, [%4, {%5, %6}], %7;"
        : "=f"(red), "=f"(green), "=f"(blue), "=f"(alpha)
        : "l"(mips), "f"(u), "f"(v), "f"(level));
    return { red, green, blue };
}
#endif

// The part of `unit` after the point; 0 of what has none.
WARPCAM_DEVICE float fraction(float unit) { return saturate(unit - round_down(unit)); }

// Colour in [0, 1] at (u, v), in images, between a level and the next, which starts at `next`; `on` says how far on.
WARPCAM_DEVICE Vec3 sample_levels(const unsigned* texels, const Level& level, int next, float u, float v, float on)
{
    const float coarse = float(WHOLE) * on;
    u = fraction(u);
    v = fraction(v);
    Blend blend { 0u, 0u, 0u };
    add_bilinear(texels, level, u, v, float(WHOLE) - coarse, blend);
    if (coarse > 0.0f) {  // then there is a next level: detail is at most levels - 1
        const int width = level.width >> 1, height = level.height >> 1;
        add_bilinear(texels, { next, width > 1 ? width : 1, height > 1 ? height : 1 }, u, v, coarse, blend);
    }
    return to_color(blend);
}

// The mip atlas of a texture; 0 where it has none.
template <class Textures> WARPCAM_DEVICE unsigned long long atlas_of(const Textures& textures, int texture)
{
#if defined(__CUDA_ARCH__)
    if (texture >= 0 && texture < textures.atlases.shape[0])
        return wp::index(textures.atlases, texture);
#endif
    return 0;
}

// Place of a mip level in its image's atlas: width, height, left and top, all floats. Level 0 is on the left, the
// others below each other beside it; each has a border of a texel, which repeats the opposite side.
WARPCAM_DEVICE Float3Int level_in_atlas(const Image& image, int number)
{
    int width = image.width >> number, height = image.height >> number, left = image.width + 3, top;
    if (number == 0) {
        left = top = 1;
    } else if (height << number == image.height) {  // sides that halve without a rest are a geometric series
        top = image.height - 2 * height + 2 * number - 1;
    } else {
        top = 1;
#pragma unroll 1
        for (int i = 1; i < number; ++i)
            top += max(image.height >> i, 1) + 2;
    }
    return { float(max(width, 1)), float(max(height, 1)), float(left), as_int(float(top)) };
}

// Place of a cube's mip level in its atlas: side, distance between faces, left and top. The faces of a level are in a
// row, with borders of the faces that they meet, the levels below each other.
WARPCAM_DEVICE Float3Int cube_level_in_atlas(int size, int number)
{
    const int side = size >> number;
    int top = 1;
    if (side << number == size)
        top += 2 * (size - side) + 2 * number;
    else
#pragma unroll 1
        for (int i = 0; i < number; ++i)
            top += max(size >> i, 1) + 2;
    const float shown = float(max(side, 1));
    return { shown, shown + 2.0f, 1.0f, as_int(float(top)) };
}

#if defined(__CUDA_ARCH__)
// Colour in [0, 1] at (u, v), in images, between two levels of an atlas; `on` says how far on. The hardware's filter
// rounds how far a place is from a texel to 1/256.
WARPCAM_DEVICE Vec3 sample_atlas(unsigned long long atlas, const Float3Int& near, const Float3Int& far, float u,
                                 float v, float on)
{
    u = fraction(u);
    v = fraction(v);
    const Vec3 first = look_up(atlas, fma(u, near.x, near.z), fma(v, near.y, as_float(near.w)));
    const Vec3 second = look_up(atlas, fma(u, far.x, far.z), fma(v, far.y, as_float(far.w)));
    return first + on * (second - first);
}
#endif

#if defined(__CUDA_ARCH__)
// Samples a 2-D texture from its mip atlas, as sample_2d() does from texels.
WARPCAM_DEVICE Vec3 sample_2d_atlas(unsigned long long atlas, const Image& image, float u, float v, Float2 right,
                                    Float2 down)
{
    const float width = float(image.width), height = float(image.height);
    const float right_u = right.x * width, right_v = right.y * height, down_u = down.x * width,
                down_v = down.y * height;
    const float detail =
        level_of_detail(right_u * right_u + right_v * right_v, down_u * down_u + down_v * down_v, image.levels);
    const int steps = int(detail);
    return sample_atlas(atlas, level_in_atlas(image, steps), level_in_atlas(image, min(steps + 1, image.levels - 1)), u,
                        v, detail - float(steps));
}
#endif

// Colour in [0, 1] of a 2-D texture at (u, v), in images: (0, 0) is the top left corner, and images repeat. The steps
// from this pixel to the next on the right and to the next below are given by the squares of their lengths in texels.
WARPCAM_DEVICE Vec3 sample_level(const unsigned* texels, const Image& image, float u, float v, float right, float down)
{
    const float detail = level_of_detail(right, down, image.levels);
    const int steps = int(detail);
    const Level level = Level { image.start, image.width, image.height }.after(steps, 1);
    return sample_levels(texels, level, level.start + level.width * level.height, u, v, detail - float(steps));
}

// Samples with steps given in images.
WARPCAM_DEVICE Vec3 sample_2d(const unsigned* texels, const Image& image, float u, float v, Float2 right, Float2 down)
{
    const float width = float(image.width), height = float(image.height);
    const float right_u = right.x * width, right_v = right.y * height, down_u = down.x * width,
                down_v = down.y * height;
    return sample_level(texels, image, u, v, right_u * right_u + right_v * right_v, down_u * down_u + down_v * down_v);
}

// The face of the cube that `v` points at: 0 to 5 for +x -x +y -y +z -z.
WARPCAM_DEVICE int cube_face(Vec3 v)
{
    const float x = abs(v.x), y = abs(v.y), z = abs(v.z);
    if (x >= y && x >= z)
        return v.x < 0.0f ? 1 : 0;
    if (y >= z)
        return v.y < 0.0f ? 3 : 2;
    return v.z < 0.0f ? 5 : 4;
}

// `v` in a face's own axes: right and down in its image, and outwards. The faces' axes are OpenGL's.
WARPCAM_DEVICE Vec3 to_face(int face, Vec3 v)
{
    const float turn = face & 1 ? -1.0f : 1.0f;
    if (face < 2)
        return { -turn * v.z, -v.y, turn * v.x };
    if (face < 4)
        return { v.x, turn * v.z, turn * v.y };
    return { turn * v.x, -v.y, turn * v.z };
}

// The inverse of `to_face`.
WARPCAM_DEVICE Vec3 from_face(int face, Vec3 v)
{
    const float turn = face & 1 ? -1.0f : 1.0f;
    if (face < 2)
        return { turn * v.z, -v.y, -turn * v.x };
    if (face < 4)
        return { v.x, turn * v.z, turn * v.y };
    return { turn * v.x, -v.y, turn * v.z };
}

// A texel of a cube, up to one beyond the face's edge: then the one there on the neighbouring face.
static WARPCAM_NOINLINE int cube_texel(int start, int size, int face, int i, int j)
{
    if (i < 0 || j < 0 || i >= size || j >= size) {
        const float half = 0.5f * float(size), rate = rcp(half);
        const float right = (float(i) + 0.5f) * rate - 1.0f, down = (float(j) + 0.5f) * rate - 1.0f;
        const Vec3 direction = from_face(face, { right, down, 1.0f });
        face = cube_face(direction);
        const Vec3 place = to_face(face, direction);
        const float outwards = rcp(place.z);
        i = int((place.x * outwards + 1.0f) * half);
        j = int((place.y * outwards + 1.0f) * half);
    }
    return start + (face * size + clamp(j, 0, size - 1)) * size + clamp(i, 0, size - 1);
}

// Adds the colour at (s, t) in [0, 1] of a face.
WARPCAM_DEVICE void add_bilinear_cube(const unsigned* texels, const Level& level, int face, float s, float t,
                                      float total, Blend& blend)
{
    const int size = level.width;
    const Between x = between_texels(s, size), y = between_texels(t, size);
    const int corner = level.start + (face * size + y.first) * size + x.first;
    int quad[4] = { corner, corner + 1, corner + size, corner + size + 1 };
    if (x.first < 0 || y.first < 0 || x.first + 1 >= size || y.first + 1 >= size) {
        quad[0] = cube_texel(level.start, size, face, x.first, y.first);
        quad[1] = cube_texel(level.start, size, face, x.first + 1, y.first);
        quad[2] = cube_texel(level.start, size, face, x.first, y.first + 1);
        quad[3] = cube_texel(level.start, size, face, x.first + 1, y.first + 1);
    }
    add_quad(texels, quad, x, y, total, blend);
}

// Intersection of a direction with a cube: the face, the position on it in [0, 1], and the mip level.
struct OnCube {
    int face;
    float s, t, detail;
};

WARPCAM_DEVICE OnCube on_cube(const Image& image, Vec3 direction, Vec3 right, Vec3 down)
{
    const int face = cube_face(direction), size = image.width;
    const Vec3 place = to_face(face, direction), step_right = to_face(face, right), step_down = to_face(face, down);
    const float rate = rcp(max(place.z, 1.0e-20f)), scale = 0.5f * float(size) * rate;
    const float x = place.x * rate, y = place.y * rate;
    const float right_x = scale * (step_right.x - x * step_right.z);
    const float right_y = scale * (step_right.y - y * step_right.z);
    const float down_x = scale * (step_down.x - x * step_down.z), down_y = scale * (step_down.y - y * step_down.z);
    const float detail =
        level_of_detail(right_x * right_x + right_y * right_y, down_x * down_x + down_y * down_y, image.levels);
    return { face, saturate(0.5f * x + 0.5f), saturate(0.5f * y + 0.5f), detail };
}

// Colour in [0, 1] of a cube texture in a direction of any length from its middle. The steps are the changes of
// `direction` from this pixel to the next on the right and to the next below.
static WARPCAM_NOINLINE Vec3 sample_cube(const unsigned* texels, const Image& image, Vec3 direction, Vec3 right,
                                         Vec3 down)
{
    const OnCube on = on_cube(image, direction, right, down);
    const int steps = int(on.detail);
    const float coarse = float(WHOLE) * (on.detail - float(steps));
    const Level level = Level { image.start, image.width, image.width }.after(steps, 6);
    Blend blend { 0u, 0u, 0u };
    add_bilinear_cube(texels, level, on.face, on.s, on.t, float(WHOLE) - coarse, blend);
    if (coarse > 0.0f)
        add_bilinear_cube(texels, level.next(6), on.face, on.s, on.t, coarse, blend);
    return to_color(blend);
}

#if defined(__CUDA_ARCH__)
// Samples a cube texture from its mip atlas.
WARPCAM_DEVICE Vec3 sample_cube_atlas(unsigned long long atlas, const Image& image, Vec3 direction, Vec3 right,
                                      Vec3 down)
{
    const OnCube on = on_cube(image, direction, right, down);
    const int steps = int(on.detail);
    const Float3Int near = cube_level_in_atlas(image.width, steps);
    const Float3Int far = cube_level_in_atlas(image.width, min(steps + 1, image.levels - 1));
    const float face = float(on.face), part = on.detail - float(steps);
    const Vec3 first =
        look_up(atlas, fma(face, near.y, fma(on.s, near.x, near.z)), fma(on.t, near.x, as_float(near.w)));
    const Vec3 second = look_up(atlas, fma(face, far.y, fma(on.s, far.x, far.z)), fma(on.t, far.x, as_float(far.w)));
    return first + part * (second - first);
}
#endif

}  // namespace warpcam
