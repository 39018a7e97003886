"""Limits of the range of depth cameras and lidars."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of

wp.set_module_options(compiler_flags())


ROUNDING = wp.constant(3.0e-7)  # of a multiple of a unit, relative: unit, product and limit are float32


@wp.func
def at_limit(distance: wp.float32, least: wp.float32, greatest: wp.float32) -> wp.float32:
    """Return a limit for a distance that is beyond it by rounding alone, and other distances as they are."""
    if distance > greatest and distance * (1.0 - ROUNDING) <= greatest:
        distance = greatest
    if distance < least and distance * (1.0 + ROUNDING) >= least:
        distance = least
    return distance


@wp.kernel(enable_backward=False, grid_stride=False)
def limit_range(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    least: wp.array(dtype=wp.float32),
    greatest: wp.array(dtype=wp.float32),
    invalid: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    near = least[world]
    far = greatest[world]
    otherwise = invalid[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = at_limit(source[world, pixel], near, far)
        within = depth > 0.0 and depth >= near and depth <= far
        target[world, pixel] = wp.where(within, depth, otherwise)
