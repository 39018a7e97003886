"""Lookups of depth beside the pixel: lateral noise."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import grazing_ratio, incidence, is_measured, resolution
from warpcam.sensors.kernels.random import Randomness, frame_state, two_normals

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False, grid_stride=False)
def shift_nearest(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    normals: wp.array4d(dtype=wp.float32),
    randomness: Randomness,
    constant: wp.array(dtype=wp.float32),
    angular: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    focal_y: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth of the pixel that lies at a random distance, which grows with the angle of incidence."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    width, height = size[0], size[1]
    view = views[world]
    growth = angular[world]
    least = wp.where(wp.isnan(growth), growth, constant[world])
    ratio = resolution(focal[world], focal_y[world], view)
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * width + column
        sigma = wp.float32(least)
        if is_measured(source[world, pixel]):
            sigma += growth * grazing_ratio(incidence(view, normals, world, row, column))
        state = wp.rand_init(random, pixel)
        across, down, _ = two_normals(state)
        x = wp.float32(column) + sigma * ratio[0] * across
        y = wp.float32(row) + sigma * ratio[1] * down
        other_column = wp.clamp(wp.int32(wp.floor(x + 0.5)), 0, width - 1)
        other_row = wp.clamp(wp.int32(wp.floor(y + 0.5)), 0, height - 1)
        depth = source[world, other_row * width + other_column]
        target[world, pixel] = wp.where(wp.isnan(x + y), 0.0, depth)


@wp.kernel(enable_backward=False, grid_stride=False)
def shift_bilinear(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    size: wp.vec2i,
    randomness: Randomness,
    shift: wp.array(dtype=wp.float32),
    focal: wp.array(dtype=wp.float32),
    focal_y: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth at a random distance, bilinear where all four pixels are measured, else that of the nearest pixel."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    width, height = size[0], size[1]
    sigma = shift[world] * resolution(focal[world], focal_y[world], views[world])
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * width + column
        state = wp.rand_init(random, pixel)
        across, down, _ = two_normals(state)
        if wp.isnan(sigma[0] + sigma[1]):
            target[world, pixel] = 0.0
            continue
        x = wp.clamp(wp.float32(column) + sigma[0] * across, 0.0, wp.float32(width - 1))
        y = wp.clamp(wp.float32(row) + sigma[1] * down, 0.0, wp.float32(height - 1))
        left = wp.int32(x)
        upper = wp.int32(y)
        u = x - wp.float32(left)
        v = y - wp.float32(upper)
        right = wp.min(left + 1, width - 1)
        lower = wp.min(upper + 1, height - 1)
        a = source[world, upper * width + left]
        b = source[world, upper * width + right]
        c = source[world, lower * width + left]
        d = source[world, lower * width + right]
        if is_measured(a) and is_measured(b) and is_measured(c) and is_measured(d):
            target[world, pixel] = wp.lerp(wp.lerp(a, b, u), wp.lerp(c, d, u), v)
        else:
            nearest_column = wp.where(u < 0.5, left, right)
            nearest_row = wp.where(v < 0.5, upper, lower)
            target[world, pixel] = source[world, nearest_row * width + nearest_column]
