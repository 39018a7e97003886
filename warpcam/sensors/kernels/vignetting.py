"""Falloff of light towards the corners of an image."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View

wp.set_module_options(compiler_flags())


@wp.func
def around_middle(pixel: wp.int32, width: wp.int32, height: wp.int32) -> wp.vec2:
    """Place of a pixel's middle from the middle of the image, right and down; the longer side is 1."""
    row, column = row_and_column(pixel, width)
    longer = wp.float32(wp.max(width, height))
    return (
        wp.vec2(wp.float32(column) + 0.5 - 0.5 * wp.float32(width), wp.float32(row) + 0.5 - 0.5 * wp.float32(height))
        / longer
    )


@wp.func
def falloff(square: wp.float32, first: wp.float32, second: wp.float32, third: wp.float32) -> wp.float32:
    """A polynomial of the squared radius, from 0 to 1."""
    return wp.clamp(1.0 + square * (first + square * (second + square * third)), 0.0, 1.0)


@wp.kernel(enable_backward=False)
def darken_naturally(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    strength: wp.array(dtype=wp.float32),
    width: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, width)
    view = views[world]
    x = (wp.float32(column) + 0.5 - view.center[0]) * view.scale[0]
    y = (wp.float32(row) + 0.5 - view.center[1]) * view.scale[1]
    squared_cosine = 1.0 / (1.0 + x * x + y * y)
    factor = 1.0 + strength[world] * (squared_cosine * squared_cosine - 1.0)
    target[world, pixel] = factor * source[world, pixel]


@wp.kernel(enable_backward=False)
def darken_by_radius(
    mask: wp.array(dtype=wp.uint8),
    coefficients: wp.array2d(dtype=wp.float32),
    center: wp.array2d(dtype=wp.float32),
    width: wp.int32,
    height: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    away = around_middle(pixel, width, height) - wp.vec2(center[world, 0], center[world, 1])
    factor = falloff(wp.dot(away, away), coefficients[world, 0], coefficients[world, 1], coefficients[world, 2])
    target[world, pixel] = factor * source[world, pixel]
