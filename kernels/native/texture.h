// Looking up textures: a colour at a place, filtered over the footprint of a pixel.
//
// Filtering is trilinear: bilinear in the two mipmap levels around log2 of the footprint's longer side, as OpenGL's
// LINEAR_MIPMAP_LINEAR. 2-D textures repeat; a cube's faces are joined along their edges.
#pragma once
#include "vectors.h"

namespace warpcam {

enum TextureKind { TEXTURE_2D, TEXTURE_CUBE };  // values of types.py

// Does `texture` name a texture? Indices can be written by the user at any time.
template <class Textures> WARPCAM_FN bool is_texture(const Textures& textures, int texture)
{
    return texture >= 0 && texture < textures.kind.shape[0];
}

// Where a texture lies among the texels.
struct Image {
    int start, width, height;
    int levels;  // 0: no texture
};

template <class Textures> WARPCAM_FN Image load_image(const Textures& textures, int texture)
{
    if (!is_texture(textures, texture))
        return { 0, 0, 0, 0 };
    return { wp::index(textures.start, texture), wp::index(textures.width, texture),
             wp::index(textures.height, texture), wp::index(textures.levels, texture) };
}

// Adds a texel, each channel 0 to 255, to a sum.
WARPCAM_FN void add_texel(const unsigned* texels, int index, float weight, Vec& sum)
{
#if defined(__CUDA_ARCH__)
    const unsigned packed = __ldg(texels + index);
#else
    const unsigned packed = texels[index];
#endif
    sum.x += weight * float(packed & 0xffu);
    sum.y += weight * float(packed >> 8 & 0xffu);
    sum.z += weight * float(packed >> 16 & 0xffu);
}

// Mipmap level, 0 to `levels - 1`, for squares of the steps in texels to the next pixel right and down.
WARPCAM_FN float level_of_detail(float right, float down, int levels)
{
    const float longer = upper(right, down);
    if (!(longer > 1.0f))  // NaN too
        return 0.0f;
    return lower(0.5f * logarithm2(lower(longer, 1.0e30f)), float(levels - 1));
}

// One level of a texture; of a cube, its faces' side.
struct Level {
    int start, width, height;

    WARPCAM_FN Level next(int images) const
    {
        return { start + images * width * height, width > 1 ? width >> 1 : 1, height > 1 ? height >> 1 : 1 };
    }

    // The level some steps on. While sides halve without a rest their areas are a geometric series.
    WARPCAM_FN Level after(int steps, int images) const
    {
        const int low_width = width >> steps, low_height = height >> steps;
        if (low_width << steps == width && low_height << steps == height)
            return { start + images * ((width * height - low_width * low_height) / 3 * 4), low_width, low_height };
        Level level = *this;
        for (int step = 0; step < steps; ++step)
            level = level.next(images);
        return level;
    }
};

// A place between two texels along one axis: the first of them, and how far on.
struct Between {
    int first;
    float on;
};

// Nonsense becomes a place inside: `first` is -1 to `size - 1`.
WARPCAM_FN Between between_texels(float unit, int size)
{
    const float place = between(unit * float(size) - 0.5f, -0.5f, float(size) - 0.5f), first = round_down(place);
    return { int(first), place - first };
}

// Adds `weight` times the colour, 0 to 255, at (u, v) in [0, 1].
WARPCAM_FN void add_bilinear(const unsigned* texels, const Level& level, float u, float v, float weight, Vec& sum)
{
    const Between x = between_texels(u, level.width), y = between_texels(v, level.height);
    const int left = x.first < 0 ? level.width - 1 : x.first, right = x.first + 1 >= level.width ? 0 : x.first + 1;
    const int top = y.first < 0 ? level.height - 1 : y.first, bottom = y.first + 1 >= level.height ? 0 : y.first + 1;
    const int above = level.start + top * level.width, below = level.start + bottom * level.width;
    const float low = weight * y.on, high = weight - low;
    add_texel(texels, above + left, high - high * x.on, sum);
    add_texel(texels, above + right, high * x.on, sum);
    add_texel(texels, below + left, low - low * x.on, sum);
    add_texel(texels, below + right, low * x.on, sum);
}

// Colour in [0, 1] of a 2-D texture at (u, v), in images: (0, 0) is the top left corner, and images repeat. The steps
// are the changes of u and v from this pixel to the next on the right and to the next below.
WARPCAM_FN Vec sample_2d(const unsigned* texels, const Image& image, float u, float v, Pair right, Pair down)
{
    const float width = float(image.width), height = float(image.height);
    const float square_right = right.x * right.x * width * width + right.y * right.y * height * height;
    const float square_down = down.x * down.x * width * width + down.y * down.y * height * height;
    const float detail = level_of_detail(square_right, square_down, image.levels);
    const int steps = int(detail);
    const float blend = detail - float(steps);
    const Level level = Level { image.start, image.width, image.height }.after(steps, 1);
    u -= round_down(u);
    v -= round_down(v);
    Vec color { 0.0f, 0.0f, 0.0f };
    add_bilinear(texels, level, u, v, (1.0f - blend) * (1.0f / 255.0f), color);
    if (blend > 0.0f)  // then there is a next level: detail is at most levels - 1
        add_bilinear(texels, level.next(1), u, v, blend * (1.0f / 255.0f), color);
    return color;
}

// The face of the cube that `v` points at: 0 to 5 for +x -x +y -y +z -z.
WARPCAM_FN int cube_face(Vec v)
{
    const float x = magnitude(v.x), y = magnitude(v.y), z = magnitude(v.z);
    if (x >= y && x >= z)
        return v.x < 0.0f ? 1 : 0;
    if (y >= z)
        return v.y < 0.0f ? 3 : 2;
    return v.z < 0.0f ? 5 : 4;
}

// `v` in a face's own axes: right and down in its image, and outwards. The faces' axes are OpenGL's.
WARPCAM_FN Vec to_face(int face, Vec v)
{
    const float turn = face & 1 ? -1.0f : 1.0f;
    if (face < 2)
        return { -turn * v.z, -v.y, turn * v.x };
    if (face < 4)
        return { v.x, turn * v.z, turn * v.y };
    return { turn * v.x, -v.y, turn * v.z };
}

// The inverse of `to_face`.
WARPCAM_FN Vec from_face(int face, Vec v)
{
    const float turn = face & 1 ? -1.0f : 1.0f;
    if (face < 2)
        return { turn * v.z, -v.y, -turn * v.x };
    if (face < 4)
        return { v.x, turn * v.z, turn * v.y };
    return { turn * v.x, -v.y, turn * v.z };
}

// Adds a texel of a cube, up to one beyond the face's edge: then the one there on the neighbouring face.
WARPCAM_FN void add_cube_texel(const unsigned* texels, const Level& level, int face, int i, int j, float weight,
                               Vec& sum)
{
    const int size = level.width;
    if (i < 0 || j < 0 || i >= size || j >= size) {
        const float rate = inverse(0.5f * float(size));
        const Vec direction = from_face(face, { (float(i) + 0.5f) * rate - 1.0f, (float(j) + 0.5f) * rate - 1.0f,
                                                1.0f });
        face = cube_face(direction);
        const Vec place = to_face(face, direction);
        const float outwards = inverse(place.z), half = 0.5f * float(size);
        i = int((place.x * outwards + 1.0f) * half);
        j = int((place.y * outwards + 1.0f) * half);
    }
    i = between(i, 0, size - 1);
    j = between(j, 0, size - 1);
    add_texel(texels, level.start + (face * size + j) * size + i, weight, sum);
}

// Adds `weight` times the colour, 0 to 255, at (s, t) in [0, 1] of a face.
WARPCAM_FN void add_bilinear_cube(const unsigned* texels, const Level& level, int face, float s, float t, float weight,
                                  Vec& sum)
{
    const Between x = between_texels(s, level.width), y = between_texels(t, level.width);
    const float low = weight * y.on, high = weight - low;
    const float weights[4] = { high - high * x.on, high * x.on, low - low * x.on, low * x.on };
    if (x.first >= 0 && y.first >= 0 && x.first + 1 < level.width && y.first + 1 < level.width) {
        const int index = level.start + (face * level.width + y.first) * level.width + x.first;
        add_texel(texels, index, weights[0], sum);
        add_texel(texels, index + 1, weights[1], sum);
        add_texel(texels, index + level.width, weights[2], sum);
        add_texel(texels, index + level.width + 1, weights[3], sum);
        return;
    }
    add_cube_texel(texels, level, face, x.first, y.first, weights[0], sum);
    add_cube_texel(texels, level, face, x.first + 1, y.first, weights[1], sum);
    add_cube_texel(texels, level, face, x.first, y.first + 1, weights[2], sum);
    add_cube_texel(texels, level, face, x.first + 1, y.first + 1, weights[3], sum);
}

// Colour in [0, 1] of a cube texture in a direction of any length from its middle. The steps are the changes of
// `direction` from this pixel to the next on the right and to the next below.
WARPCAM_FN Vec sample_cube(const unsigned* texels, const Image& image, Vec direction, Vec right, Vec down)
{
    const int face = cube_face(direction), size = image.width;
    const Vec place = to_face(face, direction), step_right = to_face(face, right), step_down = to_face(face, down);
    const float rate = inverse(upper(place.z, 1.0e-20f)), scale = 0.5f * float(size) * rate;
    const float x = place.x * rate, y = place.y * rate;
    const float right_x = scale * (step_right.x - x * step_right.z), right_y = scale * (step_right.y - y * step_right.z);
    const float down_x = scale * (step_down.x - x * step_down.z), down_y = scale * (step_down.y - y * step_down.z);
    const float detail = level_of_detail(right_x * right_x + right_y * right_y, down_x * down_x + down_y * down_y,
                                         image.levels);
    const int steps = int(detail);
    const float blend = detail - float(steps), s = 0.5f * x + 0.5f, t = 0.5f * y + 0.5f;
    const Level level = Level { image.start, size, size }.after(steps, 6);
    Vec color { 0.0f, 0.0f, 0.0f };
    add_bilinear_cube(texels, level, face, s, t, (1.0f - blend) * (1.0f / 255.0f), color);
    if (blend > 0.0f)
        add_bilinear_cube(texels, level.next(6), face, s, t, blend * (1.0f / 255.0f), color);
    return color;
}

}  // namespace warpcam
