// The cells that MuJoCo's renderer cuts planes into; see shading/gouraud.h.
#pragma once
#include "geometry/surface_interaction.h"

namespace warpcam {

constexpr int PLANE_CELLS = 200;  // at most, along a side

// The cells along one side of a plane. Those in the middle are all as long as `step`.
struct GridAxis {
    float start;    // where one of them begins [m]
    float step;     // [m]; 0 where the plane is lit at each pixel
    float inverse;  // of `step`
    float rest;     // length of the first and last cell, outside of +-`start`; -1 on an endless side
};

struct PlaneGrid {
    GridAxis u, v;
};

template <class Number> struct CellSpan {
    Number start, length;
};

// Cells of a side from `-half` to `half`: an even number of cells twice `spacing` long lies in the middle; the first
// and last cell take what is left.
WARPCAM_DEVICE GridAxis cells_between(float half, float spacing)
{
    const float step = max(spacing, half * (1.0f / float(PLANE_CELLS - 2)));
    const float rest = half - 2.0f * step * round_down(0.5f * round_down(half / step));
    return { rest - half, 2.0f * step, 0.5f * rcp(step), rest };
}

// Cells of an endless side: counted from its middle, wherever the eye is. There is room for two more of the material's
// tiles, whether it has a texture or not.
WARPCAM_DEVICE GridAxis cells_of_endless(float repeat, float horizon)
{
    const float tile = repeat > 0.0f ? 2.0f * rcp(repeat) : 2.1f * horizon * (1.0f / float(PLANE_CELLS - 2));
    const float step = (2.1f * horizon + 2.0f * tile) * (1.0f / float(PLANE_CELLS));
    return { 0.0f, step, rcp(step), -1.0f };
}

// `horizon` is how far the camera of MuJoCo's renderer sees [m]; 0 lights endless planes at each pixel.
WARPCAM_DEVICE PlaneGrid plane_cells(const ShapeFromCamera& pose, const float* repeat, float horizon)
{
    const Vec3 size = as_vec3(pose.size);
    if (!(size.x > 0.0f && size.y > 0.0f) && !(horizon > 0.0f))
        return {};
    return { size.x > 0.0f ? cells_between(size.x, size.z) : cells_of_endless(repeat[0], horizon),
             size.y > 0.0f ? cells_between(size.y, size.z) : cells_of_endless(repeat[1], horizon) };
}

// The cell around `x`.
template <class Number> WARPCAM_DEVICE CellSpan<Number> cell_around(const GridAxis& cells, Number x)
{
    const Number start = cells.start + cells.step * round_down((x - cells.start) * cells.inverse), step = cells.step;
    if (cells.rest < 0.0f)
        return { start, step };
    const Number rest = cells.rest, last = -cells.start, first = cells.start - cells.rest;
    const auto beyond = x > -cells.start;
    const auto within = (x > cells.start) & !beyond;
    return { within ? start : beyond ? last : first, within ? step : rest };
}

}  // namespace warpcam
