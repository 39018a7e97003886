"""Limits of a depth camera's range."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


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
    depth = source[world, pixel]
    within = depth > 0.0 and depth >= least[world] and depth <= greatest[world]
    target[world, pixel] = wp.where(within, depth, invalid[world])
