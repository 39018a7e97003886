"""Factors on linear light: exposure, gain and white balance."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def expose(
    mask: wp.array(dtype=wp.uint8),
    stops: wp.array(dtype=wp.float32),
    time: wp.array(dtype=wp.float32),
    reference_time: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    factor = wp.pow(2.0, stops[world]) * time[world] / reference_time[world]
    target[world, pixel] = factor * source[world, pixel]


@wp.kernel(enable_backward=False)
def amplify(
    mask: wp.array(dtype=wp.uint8),
    factor: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        target[world, pixel] = factor[world] * source[world, pixel]


@wp.kernel(enable_backward=False)
def balance(
    mask: wp.array(dtype=wp.uint8),
    gains: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] != wp.uint8(0):
        row = wp.vec3(gains[world, 0], gains[world, 1], gains[world, 2])
        target[world, pixel] = wp.cw_mul(row, source[world, pixel])
