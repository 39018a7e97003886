// Octahedral maps of an image of light from all around: mipmaps, and what lobes of microfacets see.
//
// A lobe is that of GGX's facets seen straight on, by the split-sum approximation (Karis, "Real Shading in Unreal
// Engine 4", 2013). Its directions are drawn evenly by a fixed sequence, and each reads the mipmap whose texels are as
// large as what the direction stands for (Krivanek and Colbert, "Real-time Shading with Filtered Importance Sampling",
// 2008).
#pragma once
#include "path/frame_axes.h"
#include "shading/environment_map.h"

namespace warpcam {

constexpr int FEW_DIRECTIONS = 64, MANY_DIRECTIONS = 256;  // of narrow lobes, and of those with an alpha of WIDE_LOBE
constexpr float WIDE_LOBE = 0.25f;

// A texel that a thread writes: its place, and the one inside the level that it is or repeats.
struct MapTexel {
    int at, column, row;

    WARPCAM_DEVICE MapTexel(int index, int side) : at(index)
    {
        row = index / padded(side) - 1;
        column = index - (row + 1) * padded(side) - 1;
        if (column < 0 || column >= side) {
            column = clamp(column, 0, side - 1);
            row = side - 1 - row;
        }
        if (row < 0 || row >= side) {
            row = clamp(row, 0, side - 1);
            column = side - 1 - column;
        }
    }

    // The direction of a place in the texel, from 0 to 1.
    WARPCAM_DEVICE Vec3 direction(int side, float x, float y) const
    {
        const float rate = 2.0f / float(side);
        return from_octahedron((float(column) + x) * rate - 1.0f, (float(row) + y) * rate - 1.0f);
    }
};

// An image and its maps. `data`: the texels of all maps.
struct MapBuilder {
    const Float3Int* source;
    int width, height;  // of the image
    Float3Int* data;
    const int* layout;

    WARPCAM_DEVICE int side(int level) const { return layout[ENVIRONMENT_SIDE] >> level; }
    WARPCAM_DEVICE Float3Int* level(int starts, int number) const { return data + layout[starts + number]; }

    // The first level from the image, as the mean of `parts` x `parts` places of a texel.
    WARPCAM_DEVICE void resample(int parts, int index) const
    {
        const MapTexel texel(index, side(0));
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        float weight = 0.0f;
        for (int part = 0; part < parts * parts; ++part) {
            const int down = part / parts, right = part - parts * down;
            const Vec3 d =
                texel.direction(side(0), (float(right) + 0.5f) / float(parts), (float(down) + 0.5f) / float(parts));
            const float length = dot(d, d), share = 1.0f / (length * wp::sqrt(length));
            sum = sum + share * sample_panorama(source, width, height, d);
            weight += share;
        }
        level(ENVIRONMENT_MIPS, 0)[texel.at] = make_float3_int(1.0f / weight * sum, 0);
    }

    // A level of mipmaps from the one before.
    WARPCAM_DEVICE void halve(int number, int index) const
    {
        const MapTexel texel(index, side(number));
        const Float3Int* const before = level(ENVIRONMENT_MIPS, number - 1);
        const int row = padded(side(number - 1)), first = (2 * texel.row + 1) * row + 2 * texel.column + 1;
        level(ENVIRONMENT_MIPS, number)[texel.at] =
            make_float3_int(mean_of_quad(before, first, first + row, 0, 1, 0.5f, 0.5f), 0);
    }

    // What the lobes of a level see.
    WARPCAM_DEVICE void filter(int number, int index) const
    {
        const MapTexel texel(index, side(number));
        const FrameAxes axes(normalized(texel.direction(side(number), 0.5f, 0.5f)));
        const int levels = layout[ENVIRONMENT_LEVELS];
        const float alpha = 1.0f / float(1 << (levels - 1 - number)), square = alpha * alpha;
        const int count = alpha < WIDE_LOBE ? FEW_DIRECTIONS : MANY_DIRECTIONS;
        const Environment environment { {}, {}, data, layout };
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        float weight = 0.0f;
        for (int n = 0; n < count; ++n) {
            const float u = (float(n) + 0.5f) / float(count);
            const float cosine_squared = (1.0f - u) / (1.0f + (square - 1.0f) * u);
            const Float2 turn = on_circle(radical_inverse(n));
            const float cosine = wp::sqrt(cosine_squared), sine = wp::sqrt(max(1.0f - cosine_squared, 0.0f));
            const float share = 2.0f * cosine_squared - 1.0f;  // the cosine to the direction
            if (share <= 0.0f)
                continue;
            const Vec3 d = axes.world({ 2.0f * cosine * sine * turn.x, 2.0f * cosine * sine * turn.y, share });
            const float facets = cosine_squared * (square - 1.0f) + 1.0f;
            const float angle = 4.0f * PI * facets * facets / (square * float(count));  // that a direction stands for
            const float size = 2.0f / float(side(0)), sum_of_axes = abs(d.x) + abs(d.y) + abs(d.z);
            const float own = size * size * sum_of_axes * sum_of_axes * sum_of_axes;  // of a texel of the first level
            const float level = 0.5f * wp::log2(max(angle / own, 1.0f));
            sum =
                sum + share * between_levels(environment, ENVIRONMENT_MIPS, ENVIRONMENT_MIPS, to_octahedron(d), level);
            weight += share;
        }
        this->level(ENVIRONMENT_LOBES, number)[texel.at] = make_float3_int(1.0f / weight * sum, 0);
    }

    // Van der Corput's sequence: the bits of a whole number below 2^8 in reverse, as a fraction.
    WARPCAM_DEVICE static float radical_inverse(int n)
    {
        float value = 0.0f, place = 0.5f;
        for (; n > 0; n >>= 1, place *= 0.5f)
            value += n & 1 ? place : 0.0f;
        return value;
    }
};

// Writes one texel of a step: the first level of an image, a level of its mipmaps or of its lobes.
template <class Texels, class Layouts>
WARPCAM_DEVICE void build_environment(const Texels& source, int width, int height, const Texels& texels,
                                      const Layouts& layouts, int image, int number, int parts, int index)
{
    const MapBuilder builder { reinterpret_cast<const Float3Int*>(source.data), width, height,
                               reinterpret_cast<Float3Int*>(texels.data), layouts.data + ENVIRONMENT_NUMBERS * image };
    if (parts > 0)
        builder.resample(parts, index);
    else if (parts == 0)
        builder.halve(number, index);
    else
        builder.filter(number, index);
}

}  // namespace warpcam
