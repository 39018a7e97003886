"""Disparity of a stereo camera: noise, quantisation and the window that a match needs."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import cell_of, focal_length, is_measured
from warpcam.sensors.kernels.random import Randomness, element_state

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def add_disparity_noise(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    width: wp.int32,
    randomness: Randomness,
    baseline: wp.array(dtype=wp.float32),
    sigma: wp.array(dtype=wp.float32),
    bias: wp.array(dtype=wp.float32),
    cell: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
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
        scale = focal_length(focal[world], views[world]) * baseline[world]
        disparity = scale / depth + bias[world] + sigma[world] * wp.randn(state)
        depth = wp.where(disparity > 0.0, scale / disparity, 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def quantize_disparity(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    baseline: wp.array(dtype=wp.float32),
    step: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth) and step[world] > 0.0:
        scale = focal_length(focal[world], views[world]) * baseline[world]
        steps = wp.floor(scale / (depth * step[world]) + 0.5)
        depth = wp.where(steps > 0.0, scale / (steps * step[world]), 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def keep_matches(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    width: wp.int32,
    radius: wp.int32,
    baseline: wp.array(dtype=wp.float32),
    tolerance: wp.array(dtype=wp.float32),
    share: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
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
        scale = focal_length(focal[world], views[world]) * baseline[world]
        top = wp.max(row - radius, 0)
        bottom = wp.min(row + radius + 1, source.shape[1] // width)
        left = wp.max(column - radius, 0)
        right = wp.min(column + radius + 1, width)
        total = wp.float32(0.0)
        valid = wp.float32(0.0)
        for y in range(top, bottom):
            for x in range(left, right):
                other = source[world, y * width + x]
                if is_measured(other):
                    total += scale / other
                    valid += 1.0
        mean = total / valid
        alike = wp.float32(0.0)
        for y in range(top, bottom):
            for x in range(left, right):
                other = source[world, y * width + x]
                distance = 1.44 * wp.float32((y - row) * (y - row) + (x - column) * (x - column))
                weight = wp.where(distance > 0.0, 1.0 / distance, 1.0)
                if is_measured(other) and weight * wp.abs(scale / other - mean) < tolerance[world]:
                    alike += 1.0
        if alike < share[world] * wp.float32((bottom - top) * (right - left)):
            depth = wp.float32(0.0)
    target[world, pixel] = depth
