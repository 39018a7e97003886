"""Differences between the pixels of one sensor that stay from frame to frame."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color
from warpcam.sensors.kernels.random import Randomness, device_state, three_normals

wp.set_module_options(compiler_flags())


@wp.func
def pattern(random: wp.int32, pixel: wp.int32) -> wp.vec3:
    """Normal numbers of a pixel's three channels from the state of its device."""
    return three_normals(wp.rand_init(random, pixel))


@wp.kernel(enable_backward=False, grid_stride=False)
def vary_response(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    spread = sigma[world]
    random = device_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        gains = wp.vec3(1.0) + spread * pattern(random, pixel)
        set_color(target, world, pixel, wp.cw_mul(gains, color_at(source, world, pixel)))


@wp.kernel(enable_backward=False, grid_stride=False)
def vary_dark_signal(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    spread = sigma[world]
    random = device_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        set_color(target, world, pixel, color_at(source, world, pixel) + spread * pattern(random, pixel))


@wp.kernel(enable_backward=False, grid_stride=False)
def spoil_pixels(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    dead: wp.array(dtype=wp.float32),
    hot: wp.array(dtype=wp.float32),
    level: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    black = dead[world]
    bright = black + hot[world]
    shown = level[world]
    random = device_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        number = wp.randf(wp.rand_init(random, pixel))
        if number < black:
            value = wp.vec3(0.0)
        elif number < bright:
            value = wp.vec3(shown)
        set_color(target, world, pixel, value)
