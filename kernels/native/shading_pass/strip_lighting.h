// Light of a strip's pixels from the plane's corners: see shading/plane_vertex_lighting.h.
#pragma once
#include "shading/plane_shading.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)

// A pixel among the vertices: the numbers of three, and the weights of two.
struct OnVertices {
    const float *first, *second, *third;
    float second_weight, third_weight;

    WARPCAM_DEVICE float mixed(float one, float two, float three) const
    {
        return one + second_weight * (two - one) + third_weight * (three - one);
    }
    WARPCAM_DEVICE float all(int start) const { return mixed(first[start], second[start], third[start]); }

    // `light` less what is dark of a group of numbers, of all but the first if FIRST.
    template <bool FIRST> WARPCAM_DEVICE float lit(int start, const int* bits, unsigned shadow, float light) const
    {
        alignas(16) float one[GREY_VERTEX_LIGHTS], two[GREY_VERTEX_LIGHTS], three[GREY_VERTEX_LIGHTS];
        load_few(first + start, one);
        load_few(second + start, two);
        load_few(third + start, three);
        if (FIRST)
            light = mixed(one[0], two[0], three[0]);
#pragma unroll
        for (int n = FIRST; n < GREY_VERTEX_LIGHTS; ++n)
            light -= bits[n] & shadow ? mixed(one[n], two[n], three[n]) : 0.0f;
        return light;
    }
};

// `bias`: of a corner's number.
WARPCAM_DEVICE OnVertices vertices_at(const float* values, int columns, int stride, unsigned bias, float u, float v)
{
    const float base_u = __fadd_rd(u, WHOLE_NUMBERS), base_v = __fadd_rd(v, WHOLE_NUMBERS);
    const float a = u - (base_u - WHOLE_NUMBERS), b = v - (base_v - WHOLE_NUMBERS);
    const bool high = a > 1.0f - b;
    const unsigned corner = unsigned(as_int(base_v)) * unsigned(columns) + unsigned(as_int(base_u)) - bias;
    values += int(corner) * stride;
    return { values + (high ? (columns + 1) * stride : 0), values + stride, values + columns * stride,
             high ? 1.0f - b : a, high ? 1.0f - a : b };
}

// Light of a pixel at (u, v) among the vertices: of the lights that `shadow` leaves if SHADED, else of all. For grey
// lights, of which a corner keeps as few numbers as may be.
template <bool SHADED, class Grid>
WARPCAM_DEVICE float light_at(const Grid& grid, unsigned bias, float u, float v, unsigned shadow)
{
    constexpr int STRIDE = Grid::SHADOWS ? GREY_VERTEX_LIGHTS : 1;
    const OnVertices on = vertices_at(grid.values, grid.columns, STRIDE, bias, u, v);
    if constexpr (SHADED)
        return on.template lit<true>(0, grid.bits, shadow, 0.0f);
    else
        return on.all(0);
}

// The same, of coloured or of many lights.
template <bool SHADED, class Grid>
WARPCAM_DEVICE Vec3 color_at(const Grid& grid, unsigned bias, float u, float v, unsigned shadow)
{
    const OnVertices on = vertices_at(grid.values, grid.columns, grid.stride, bias, u, v);
    if constexpr (SHADED) {
        return grid.by_channel([&](int start) {
            float light = on.all(start);
#pragma unroll 1
            for (int group = 0; group < grid.each; group += GREY_VERTEX_LIGHTS)
                light = on.template lit<false>(start + group, grid.bits + group, shadow, light);
            return light;
        });
    } else {
        const float first = on.all(0);
        return grid.grey ? Vec3 { first, first, first } : Vec3 { first, on.all(grid.each), on.all(2 * grid.each) };
    }
}

#endif

}  // namespace warpcam
