// The alpha of a 2-D texture, filtered as its colour: texture/sampler.h.
#pragma once
#include "texture/sampler.h"

namespace warpcam {

// At (u, v) in [0, 1], in [0, 255].
WARPCAM_DEVICE float bilinear_alpha(const unsigned* texels, const Level& level, float u, float v)
{
    const Between x = between_texels(u, level.width), y = between_texels(v, level.height);
    const int columns[2] = { first_or_last(x.first, level.width), x.first + 1 >= level.width ? 0 : x.first + 1 };
    const int rows[2] = { first_or_last(y.first, level.height), y.first + 1 >= level.height ? 0 : y.first + 1 };
    float sum = 0.0f;
    for (int k = 0; k < 4; ++k) {
        const float weight = (k & 1 ? x.on : 1.0f - x.on) * (k >> 1 ? y.on : 1.0f - y.on);
        sum += weight * float(texels[level.start + rows[k >> 1] * level.width + columns[k & 1]] >> 24);
    }
    return sum;
}

// At (u, v), in images, in [0, 1]; `right` and `down` are the steps to the next pixels.
WARPCAM_DEVICE float sample_alpha(const unsigned* texels, const Image& image, float u, float v, Float2 right,
                                  Float2 down)
{
    const float width = float(image.width), height = float(image.height);
    const float right_u = right.x * width, right_v = right.y * height, down_u = down.x * width,
                down_v = down.y * height;
    const float detail =
        level_of_detail(right_u * right_u + right_v * right_v, down_u * down_u + down_v * down_v, image.levels);
    const int steps = int(detail);
    const float on = detail - float(steps);
    const Level level = Level { image.start, image.width, image.height }.after(steps, 1);
    u = fraction(u);
    v = fraction(v);
    const float near = bilinear_alpha(texels, level, u, v);
    const float far = on > 0.0f ? bilinear_alpha(texels, level.next(1), u, v) : near;
    return (1.0f / 255.0f) * (near + on * (far - near));
}

}  // namespace warpcam
