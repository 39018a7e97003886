"""Noise of depth, pixel by pixel."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import grazing_ratio, incidence, is_measured
from warpcam.sensors.kernels.random import Randomness, element_state, lasting_state

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def add_axial_noise(
    mask: wp.array(dtype=wp.uint8),
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
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        row, column = row_and_column(pixel, normals.shape[2])
        beyond = depth - start[world]
        ratio = grazing_ratio(incidence(views[world], normals, world, row, column))
        sigma = constant[world] + quadratic[world] * beyond * beyond + angular[world] * ratio * ratio / wp.sqrt(depth)
        depth = wp.max(depth + sigma * wp.randn(element_state(randomness, world, pixel)), 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def add_polynomial_noise(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    linear: wp.array(dtype=wp.float32),
    quadratic: wp.array(dtype=wp.float32),
    offset: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        sigma = wp.max(constant[world] + (linear[world] + quadratic[world] * depth) * depth, 0.0)
        depth = wp.max(depth + offset[world] + sigma * wp.randn(element_state(randomness, world, pixel)), 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def add_ramp_noise(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    slope: wp.array(dtype=wp.float32),
    start: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        sigma = constant[world] + slope[world] * wp.max(depth - start[world], 0.0)
        depth = wp.max(depth + sigma * wp.randn(element_state(randomness, world, pixel)), 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def add_bias(
    mask: wp.array(dtype=wp.uint8),
    offset: wp.array(dtype=wp.float32),
    scale: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        depth = wp.max(scale[world] * depth + offset[world], 0.0)
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
        step = sigma[world] * wp.randn(element_state(randomness, world, 0))
        drift[world] = (1.0 - relaxation[world]) * drift[world] + step


@wp.kernel(enable_backward=False)
def add_drift(
    mask: wp.array(dtype=wp.uint8),
    drift: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        depth = wp.max(depth + drift[world], 0.0)
    target[world, pixel] = depth


@wp.kernel(enable_backward=False)
def add_fixed_pattern(
    mask: wp.array(dtype=wp.uint8),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    linear: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    depth = source[world, pixel]
    if is_measured(depth):
        sigma = constant[world] + linear[world] * depth
        depth = wp.max(depth + sigma * wp.randn(lasting_state(randomness, world, pixel)), 0.0)
    target[world, pixel] = depth
