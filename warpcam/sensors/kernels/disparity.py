"""Disparity of a stereo camera: noise and quantisation."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import cell_of, cell_side, focal_length, is_measured
from warpcam.sensors.kernels.random import Randomness, frame_state, one_normal

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False, grid_stride=False)
def add_disparity_noise(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    size: wp.vec2i,
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
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    scale = focal_length(focal[world], views[world]) * baseline[world]
    error = bias[world]
    deviation = wp.where(wp.isnan(cell[world]), cell[world], sigma[world])
    side = cell_side(cell[world])
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            state = wp.rand_init(random, cell_of(row, column, size[0], side))
            disparity = scale / depth + error + deviation * one_normal(state)
            depth = wp.where(disparity > 0.0, scale / disparity, 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def quantize_disparity(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    baseline: wp.array(dtype=wp.float32),
    step: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    scale = focal_length(focal[world], views[world]) * baseline[world]
    least = step[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth) and least != 0.0:
            steps = wp.floor(scale / (depth * least) + 0.5)
            depth = wp.where(steps > 0.0, scale / (steps * least), 0.0)
        target[world, pixel] = depth
