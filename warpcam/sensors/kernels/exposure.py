"""Factors on linear light: exposure, gain and white balance."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False, grid_stride=False)
def expose(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    stops: wp.array(dtype=wp.float32),
    time: wp.array(dtype=wp.float32),
    reference_time: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    factor = wp.pow(2.0, stops[world]) * time[world] / reference_time[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        set_color(target, world, pixel, factor * color_at(source, world, pixel))


@wp.kernel(enable_backward=False, grid_stride=False)
def amplify(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    factor: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    gain = factor[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        set_color(target, world, pixel, gain * color_at(source, world, pixel))


@wp.kernel(enable_backward=False, grid_stride=False)
def balance(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    gains: wp.array2d(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    factors = wp.vec3(gains[world, 0], gains[world, 1], gains[world, 2])
    for row in range(top, bottom):
        pixel = row * size[0] + column
        set_color(target, world, pixel, wp.cw_mul(factors, color_at(source, world, pixel)))
