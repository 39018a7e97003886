"""Pixels of a depth image that lose their measurement, and those that mix two."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import cell_of, incidence, is_measured
from warpcam.sensors.kernels.random import Randomness, element_state

wp.set_module_options(compiler_flags())


@wp.func
def extremes(source: wp.array2d(dtype=wp.float32), world: wp.int32, pixel: wp.int32, width: wp.int32):
    """Least and greatest depth in the 3x3 neighbourhood of a pixel; 0, negative numbers and NaN do not count."""
    row, column = row_and_column(pixel, width)
    least = wp.float32(wp.inf)
    greatest = wp.float32(0.0)
    for y in range(wp.max(row - 1, 0), wp.min(row + 2, source.shape[1] // width)):
        for x in range(wp.max(column - 1, 0), wp.min(column + 2, width)):
            depth = source[world, y * width + x]
            if depth > 0.0:
                least = wp.min(least, depth)
                greatest = wp.max(greatest, depth)
    return least, greatest


@wp.kernel(enable_backward=False)
def drop_edges(
    mask: wp.array(dtype=wp.uint8),
    width: wp.int32,
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        least, greatest = extremes(source, world, pixel, width)
        if greatest - least > threshold[world]:
            if wp.randf(element_state(randomness, world, pixel)) < probability[world]:
                depth = wp.float32(0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def mix_edges(
    mask: wp.array(dtype=wp.uint8),
    width: wp.int32,
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        least, greatest = extremes(source, world, pixel, width)
        if greatest < wp.inf and greatest - least > threshold[world]:
            state = element_state(randomness, world, pixel)
            if wp.randf(state) < probability[world]:
                depth = wp.lerp(least, greatest, wp.randf(state))
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def drop_grazing(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    normals: wp.array4d(dtype=wp.float32),
    randomness: Randomness,
    start: wp.array(dtype=wp.float32),
    end: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        row, column = row_and_column(pixel, normals.shape[2])
        beyond = wp.degrees(incidence(views[world], normals, world, row, column)) - start[world]
        if beyond > 0.0:
            if wp.randf(element_state(randomness, world, pixel)) * wp.max(end[world] - start[world], 0.0) < beyond:
                depth = wp.float32(0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def drop_dark(
    mask: wp.array(dtype=wp.uint8),
    colors: wp.array4d(dtype=wp.uint8),
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        row, column = row_and_column(pixel, colors.shape[2])
        red = wp.float32(colors[world, row, column, 0])
        green = wp.float32(colors[world, row, column, 1])
        blue = wp.float32(colors[world, row, column, 2])
        gray = 0.299 * red + 0.587 * green + 0.114 * blue
        if gray < 255.0 * threshold[world]:
            if wp.randf(element_state(randomness, world, pixel)) < probability[world]:
                depth = wp.float32(0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def drop_at_random(
    mask: wp.array(dtype=wp.uint8),
    width: wp.int32,
    randomness: Randomness,
    probability: wp.array(dtype=wp.float32),
    cell: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        row, column = row_and_column(pixel, width)
        state = element_state(randomness, world, cell_of(row, column, width, cell[world]))
        if wp.randf(state) < probability[world]:
            depth = wp.float32(0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def quantize_depth(
    mask: wp.array(dtype=wp.uint8),
    unit: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth) and unit[world] > 0.0:
        units = wp.floor(depth / unit[world] + 0.5)
        depth = wp.where(units <= 65535.0, units * unit[world], 0.0)
    target[world, pixel] = depth
