"""Limits of the range of depth cameras and lidars."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

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


@wp.kernel(enable_backward=False)
def limit_range(
    mask: wp.array(dtype=wp.uint8),
    least: wp.array(dtype=wp.float32),
    greatest: wp.array(dtype=wp.float32),
    invalid: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = at_limit(source[world, pixel], least[world], greatest[world])
    within = depth > 0.0 and depth >= least[world] and depth <= greatest[world]
    target[world, pixel] = wp.where(within, depth, invalid[world])
