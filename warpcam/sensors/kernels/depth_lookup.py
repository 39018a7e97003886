"""Lookups of depth beside the pixel: lateral noise."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import grazing_ratio, incidence, is_measured, resolution
from warpcam.sensors.kernels.random import Randomness, element_state

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def shift_nearest(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    normals: wp.array4d(dtype=wp.float32),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    angular: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth of the pixel that lies at a random distance, which grows with the angle of incidence."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    height = normals.shape[1]
    width = normals.shape[2]
    row, column = row_and_column(pixel, width)
    view = views[world]
    sigma = constant[world]
    if is_measured(source[world, pixel]):
        sigma += angular[world] * grazing_ratio(incidence(view, normals, world, row, column))
    sigma *= resolution(focal[world], view)
    state = element_state(randomness, world, pixel)
    x = wp.float32(column) + sigma * wp.randn(state)
    y = wp.float32(row) + sigma * wp.randn(state)
    column = wp.clamp(wp.int32(wp.floor(x + 0.5)), 0, width - 1)
    row = wp.clamp(wp.int32(wp.floor(y + 0.5)), 0, height - 1)
    target[world, pixel] = source[world, row * width + column]


@wp.kernel(enable_backward=False)
def shift_bilinear(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    width: wp.int32,
    randomness: Randomness,
    shift: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth at a random distance, bilinear where all four pixels are measured, else that of the nearest pixel."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    height = source.shape[1] // width
    row, column = row_and_column(pixel, width)
    sigma = shift[world] * resolution(focal[world], views[world])
    state = element_state(randomness, world, pixel)
    x = wp.clamp(wp.float32(column) + sigma * wp.randn(state), 0.0, wp.float32(width - 1))
    y = wp.clamp(wp.float32(row) + sigma * wp.randn(state), 0.0, wp.float32(height - 1))
    left = wp.int32(x)
    top = wp.int32(y)
    u = x - wp.float32(left)
    v = y - wp.float32(top)
    right = wp.min(left + 1, width - 1)
    bottom = wp.min(top + 1, height - 1)
    a = source[world, top * width + left]
    b = source[world, top * width + right]
    c = source[world, bottom * width + left]
    d = source[world, bottom * width + right]
    if is_measured(a) and is_measured(b) and is_measured(c) and is_measured(d):
        target[world, pixel] = wp.lerp(wp.lerp(a, b, u), wp.lerp(c, d, u), v)
    else:
        nearest_column = wp.where(u < 0.5, left, right)
        nearest_row = wp.where(v < 0.5, top, bottom)
        target[world, pixel] = source[world, nearest_row * width + nearest_column]
