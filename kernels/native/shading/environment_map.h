// Images of light from all around, in float: one for each world, rotated and scaled. Its texels are linear radiance.
//
// Paths read the image as it came, by longitude and latitude. The real-time look reads octahedral maps (Cigolle et al.,
// "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014) that build/environment_builder.h
// makes of it: mipmaps, and what lobes of rising roughness see.
#pragma once
#include "core/scalar_or_simd.h"

namespace warpcam {

// Values of flags.py. HAS_ENVIRONMENT: it lights and is mirrored; SHOWS_ENVIRONMENT: it is behind everything.
enum EnvironmentFlag { HAS_ENVIRONMENT = 1 << 29, SHOWS_ENVIRONMENT = 1 << 30 };

constexpr int ENVIRONMENT_ROWS = 4;  // of a world in EnvironmentMaps.rows of types.py
constexpr int MAX_MAP_LEVELS = 8;
// Numbers of an image in EnvironmentMaps.layouts.
enum EnvironmentLayout {
    ENVIRONMENT_TEXELS,
    ENVIRONMENT_WIDTH,
    ENVIRONMENT_HEIGHT,
    ENVIRONMENT_SUMS,
    ENVIRONMENT_SIDE,
    ENVIRONMENT_LEVELS,
    ENVIRONMENT_MIPS,
    ENVIRONMENT_LOBES = ENVIRONMENT_MIPS + MAX_MAP_LEVELS,
    // Bits of floats: the direction towards a sun that is a light of its own, the cosine of the angle around it where
    // texels hold it, and the luminance that is left of them; the cosine is above 1 where there is none.
    ENVIRONMENT_SUN = ENVIRONMENT_LOBES + MAX_MAP_LEVELS,
    ENVIRONMENT_NUMBERS = ENVIRONMENT_SUN + 5
};

// One world's.
struct Environment {
    Vec3 axes[3];  // of the image in the world: towards its middle, to the left of that, up
    Vec3 gain;
    const Float3Int* texels;
    const int* layout;  // null: the world has none

    WARPCAM_DEVICE Vec3 local(Vec3 d) const { return { dot(axes[0], d), dot(axes[1], d), dot(axes[2], d) }; }
    WARPCAM_DEVICE Vec3 world(Vec3 d) const { return d.x * axes[0] + d.y * axes[1] + d.z * axes[2]; }
};

template <class Maps> WARPCAM_DEVICE Environment load_environment(const Maps& maps, int world)
{
    const void* const rows = maps.rows.data + ENVIRONMENT_ROWS * world;
    Environment environment;
    int image = -1;
    for (int row = 0; row < 3; ++row) {
        const Float3Int axis = load(rows, row);
        environment.axes[row] = as_vec3(axis);
        image = row == 0 ? int(as_float(axis.w)) : image;
    }
    environment.gain = as_vec3(load(rows, 3));
    environment.texels = reinterpret_cast<const Float3Int*>(maps.texels.data);
    environment.layout = image < 0 ? nullptr : maps.layouts.data + ENVIRONMENT_NUMBERS * image;
    return environment;
}

// The mean of four texels, two in a row at `upper` and two at `lower`.
WARPCAM_DEVICE Vec3 mean_of_quad(const Float3Int* texels, int upper, int lower, int left, int right, float x, float y)
{
    const Vec3 above = (1.0f - x) * as_vec3(load(texels, upper + left)) + x * as_vec3(load(texels, upper + right));
    const Vec3 below = (1.0f - x) * as_vec3(load(texels, lower + left)) + x * as_vec3(load(texels, lower + right));
    return (1.0f - y) * above + y * below;
}

// Place of a direction on an image by longitude and latitude, in [0, 1]: from its left, where it looks away from its
// middle, and from its top.
WARPCAM_DEVICE Float2 panorama_place(Vec3 d)
{
    const float flat = wp::sqrt(d.x * d.x + d.y * d.y);
    return { 0.5f - wp::atan2(d.y, d.x) * (0.5f / PI), 0.5f - wp::atan2(d.z, flat) * (1.0f / PI) };
}

// The image along a direction in its own frame, between texels.
WARPCAM_DEVICE Vec3 sample_panorama(const Float3Int* texels, int width, int height, Vec3 d)
{
    const Float2 place = panorama_place(d);
    const float x = place.x * float(width) - 0.5f, y = clamp(place.y * float(height) - 0.5f, 0.0f, float(height - 1));
    const float first_x = wp::floor(x);
    const int column = clamp(int(first_x), -1, width - 1), row = clamp(int(y), 0, height - 1);
    const int left = column < 0 ? width - 1 : column, right = column + 1 < width ? column + 1 : 0;
    return mean_of_quad(texels, row * width, min(row + 1, height - 1) * width, left, right, x - first_x,
                        y - float(row));
}

// Place of a direction on the square [-1, 1]^2 of an octahedral map.
WARPCAM_DEVICE Float2 to_octahedron(Vec3 d)
{
    const float rate = 1.0f / max(abs(d.x) + abs(d.y) + abs(d.z), MIN_NORMAL);
    const float x = rate * d.x, y = rate * d.y;
    if (d.z >= 0.0f)
        return { x, y };
    return { (1.0f - abs(y)) * sign(x), (1.0f - abs(x)) * sign(y) };
}

// The direction of a place on the square, not of unit length; its length is 1 where its components' sum is.
WARPCAM_DEVICE Vec3 from_octahedron(float x, float y)
{
    const float z = 1.0f - abs(x) - abs(y);
    return z >= 0.0f ? Vec3 { x, y, z } : Vec3 { (1.0f - abs(y)) * sign(x), (1.0f - abs(x)) * sign(y), z };
}

// Texels of a level from one side to the other, with those around it that repeat what lies across its edges.
WARPCAM_DEVICE int padded(int side) { return side + 2; }

// A level of an octahedral map of that side, between texels.
WARPCAM_DEVICE Vec3 sample_octahedron(const Float3Int* level, int side, Float2 place)
{
    const float half = 0.5f * float(side), most = float(side) + 0.5f;
    const float x = clamp((place.x + 1.0f) * half + 0.5f, 0.5f, most);
    const float y = clamp((place.y + 1.0f) * half + 0.5f, 0.5f, most);
    const int column = clamp(int(x), 0, side), row = clamp(int(y), 0, side);
    return mean_of_quad(level, row * padded(side), (row + 1) * padded(side), column, column + 1, x - float(column),
                        y - float(row));
}

// Levels of a map, of which the first is `first`, between two of them; `starts`: one after the other in the layout.
WARPCAM_DEVICE Vec3 between_levels(const Environment& environment, int first_start, int starts, Float2 place,
                                   float level)
{
    const int* const layout = environment.layout;
    const int side = layout[ENVIRONMENT_SIDE], levels = layout[ENVIRONMENT_LEVELS];
    level = clamp(level, 0.0f, float(levels - 1));
    const int lower = clamp(int(level), 0, levels - 1), upper = min(lower + 1, levels - 1);
    const float on = level - float(lower);
    const auto read = [&](int n) {
        return sample_octahedron(environment.texels + layout[n == 0 ? first_start : starts + n], side >> n, place);
    };
    const Vec3 sharp = read(lower);
    return on > 0.0f ? sharp + on * (read(upper) - sharp) : sharp;
}

// A texel of the first level, along a unit direction in the image's frame, without the sun that is a light of its own.
WARPCAM_DEVICE Vec3 without_sun(const int* layout, Vec3 d, Vec3 light)
{
    const int* const sun = layout + ENVIRONMENT_SUN;
    const float bright = 0.2126f * light.x + 0.7152f * light.y + 0.0722f * light.z, limit = as_float(sun[4]);
    if (!(bright > limit) || !(dot(d, { as_float(sun[0]), as_float(sun[1]), as_float(sun[2]) }) >= as_float(sun[3])))
        return light;
    return limit / bright * light;
}

// What a lobe of GGX's facets about `direction`, in the world, sees. `alpha`: the roughness squared.
WARPCAM_DEVICE Vec3 lobe_of(const Environment& environment, Vec3 direction, float alpha)
{
    if (!environment.layout)
        return { 0.0f, 0.0f, 0.0f };
    const float level = float(environment.layout[ENVIRONMENT_LEVELS] - 1) + wp::log2(max(alpha, 1.0e-6f));
    const Vec3 local = environment.local(direction);
    const Float2 place = to_octahedron(local);
    const Vec3 light = between_levels(environment, ENVIRONMENT_MIPS, ENVIRONMENT_LOBES, place, level);
    return mul(environment.gain, level < 1.0f ? without_sun(environment.layout, normalized(local), light) : light);
}

// Light from a direction of any length, over what a pixel covers: to the next ones' it is `right` and `down`. All in the
// world.
WARPCAM_DEVICE Vec3 environment_behind(const Environment& environment, Vec3 direction, Vec3 right, Vec3 down)
{
    if (!environment.layout)
        return { 0.0f, 0.0f, 0.0f };
    const float texel = 2.0f / float(environment.layout[ENVIRONMENT_SIDE]);
    const float step = max(dot(right, right), dot(down, down)) / max(dot(direction, direction), MIN_NORMAL);
    const float wide = step / (texel * texel);
    const float level = wide > 1.0f ? 0.5f * wp::log2(min(wide, 1.0e30f)) : 0.0f;
    const Float2 place = to_octahedron(environment.local(direction));
    return mul(environment.gain, between_levels(environment, ENVIRONMENT_MIPS, ENVIRONMENT_MIPS, place, level));
}

// Light from a direction of the world, as the image has it.
WARPCAM_DEVICE Vec3 environment_along(const Environment& environment, Vec3 direction)
{
    if (!environment.layout)
        return { 0.0f, 0.0f, 0.0f };
    const int* const layout = environment.layout;
    return mul(environment.gain,
               sample_panorama(environment.texels + layout[ENVIRONMENT_TEXELS], layout[ENVIRONMENT_WIDTH],
                               layout[ENVIRONMENT_HEIGHT], environment.local(direction)));
}

}  // namespace warpcam
