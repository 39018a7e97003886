"""Noise of depth, pixel by pixel."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import grazing_ratio, incidence, is_measured, not_negative
from warpcam.sensors.kernels.random import Randomness, device_state, element_state, frame_state, one_normal

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False, grid_stride=False)
def add_axial_noise(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    normals: wp.array4d(dtype=wp.float32),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    quadratic: wp.array(dtype=wp.float32),
    start: wp.array(dtype=wp.float32),
    angular: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    view = views[world]
    least = constant[world]
    growth = quadratic[world]
    begin = start[world]
    by_angle = angular[world]
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            beyond = depth - begin
            ratio = grazing_ratio(incidence(view, normals, world, row, column))
            sigma = least + growth * beyond * beyond + by_angle * ratio * ratio / wp.sqrt(depth)
            depth = wp.max(depth + sigma * one_normal(wp.rand_init(random, pixel)), 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def add_polynomial_noise(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    linear: wp.array(dtype=wp.float32),
    quadratic: wp.array(dtype=wp.float32),
    offset: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    c0 = constant[world]
    c1 = linear[world]
    c2 = quadratic[world]
    bias = offset[world]
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            sigma = not_negative(c0 + (c1 + c2 * depth) * depth)
            depth = wp.max(depth + bias + sigma * one_normal(wp.rand_init(random, pixel)), 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def add_ramp_noise(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    slope: wp.array(dtype=wp.float32),
    start: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    least = constant[world]
    growth = slope[world]
    begin = start[world]
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            sigma = least + growth * not_negative(depth - begin)
            depth = wp.max(depth + sigma * one_normal(wp.rand_init(random, pixel)), 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def add_bias(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    offset: wp.array(dtype=wp.float32),
    scale: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    factor = scale[world]
    bias = offset[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            depth = wp.max(factor * depth + bias, 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def walk(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    sigma: wp.array(dtype=wp.float32),
    relaxation: wp.array(dtype=wp.float32),
    drift: wp.array(dtype=wp.float32),
    first: wp.int32,
):
    """One step of each world's random walk."""
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        step = sigma[world] * one_normal(element_state(randomness, world, 0))
        drift[world] = (1.0 - relaxation[world]) * drift[world] + step


@wp.kernel(enable_backward=False, grid_stride=False)
def add_drift(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    drift: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    bias = drift[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            depth = wp.max(depth + bias, 0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def add_fixed_pattern(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    linear: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    least = constant[world]
    growth = linear[world]
    random = device_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            sigma = least + growth * depth
            depth = wp.max(depth + sigma * one_normal(wp.rand_init(random, pixel)), 0.0)
        target[world, pixel] = depth
