"""Differences between the pixels of one sensor that stay from frame to frame."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.sensors.kernels.electrons import three_normals
from warpcam.sensors.kernels.random import Randomness, lasting_state

wp.set_module_options(compiler_flags())


@wp.func
def pattern(randomness: Randomness, world: wp.int32, pixel: wp.int32) -> wp.vec3:
    """Normal numbers of a pixel's three channels, equal in all frames."""
    normals, _ = three_normals(lasting_state(randomness, world, pixel))
    return normals


@wp.kernel(enable_backward=False)
def vary_response(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    gains = wp.vec3(1.0) + sigma[world] * pattern(randomness, world, pixel)
    target[world, pixel] = wp.cw_mul(gains, source[world, pixel])


@wp.kernel(enable_backward=False)
def vary_dark_signal(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        target[world, pixel] = source[world, pixel] + sigma[world] * pattern(randomness, world, pixel)


@wp.kernel(enable_backward=False)
def spoil_pixels(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    dead: wp.array(dtype=wp.float32),
    hot: wp.array(dtype=wp.float32),
    level: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    value = source[world, pixel]
    number = wp.randf(lasting_state(randomness, world, pixel))
    if number < dead[world]:
        value = wp.vec3(0.0)
    elif number < dead[world] + hot[world]:
        value = wp.vec3(level[world])
    target[world, pixel] = value
