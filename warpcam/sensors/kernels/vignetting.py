"""Falloff of light towards the corners of an image."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.arithmetic import quotient
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color

wp.set_module_options(compiler_flags())


@wp.func
def around_middle(index: wp.int32, count: wp.int32, size: wp.vec2i) -> wp.float32:
    """Place of the middle of a row, or a column, of so many from the middle of the image; the longer side is 1."""
    longer = wp.float32(wp.max(size[0], size[1]))
    return quotient(wp.float32(index) + 0.5 - 0.5 * wp.float32(count), longer)


@wp.func
def falloff(square: wp.float32, first: wp.float32, second: wp.float32, third: wp.float32) -> wp.float32:
    """A polynomial of the squared radius, from 0 to 1."""
    return wp.clamp(1.0 + square * (first + square * (second + square * third)), 0.0, 1.0)


@wp.kernel(enable_backward=False, grid_stride=False)
def darken_naturally(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    strength: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    view = views[world]
    amount = strength[world]
    x = (wp.float32(column) + 0.5 - view.center[0]) * view.scale[0]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        y = (wp.float32(row) + 0.5 - view.center[1]) * view.scale[1]
        squared_cosine = quotient(1.0, 1.0 + x * x + y * y)
        factor = 1.0 + amount * (squared_cosine * squared_cosine - 1.0)
        set_color(target, world, pixel, factor * color_at(source, world, pixel))


@wp.kernel(enable_backward=False, grid_stride=False)
def darken_by_radius(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    coefficients: wp.array2d(dtype=wp.float32),
    center: wp.array2d(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    x = around_middle(column, size[0], size) - center[world, 0]
    middle = center[world, 1]
    a = coefficients[world, 0]
    b = coefficients[world, 1]
    c = coefficients[world, 2]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        y = around_middle(row, size[1], size) - middle
        set_color(target, world, pixel, falloff(x * x + y * y, a, b, c) * color_at(source, world, pixel))
