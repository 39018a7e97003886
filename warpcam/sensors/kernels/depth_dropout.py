"""Pixels of a depth image that lose their measurement, and those that mix two."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import cell_of, cell_side, happens, incidence, is_measured
from warpcam.sensors.kernels.random import Randomness, frame_state

wp.set_module_options(compiler_flags())


@wp.func
def least_of(depth: wp.float32) -> wp.float32:
    return wp.where(depth > 0.0, depth, wp.inf)


@wp.func
def greatest_of(depth: wp.float32) -> wp.float32:
    return wp.where(depth > 0.0, depth, 0.0)


@wp.func
def extremes(
    source: wp.array2d(dtype=wp.float32), world: wp.int32, row: wp.int32, column: wp.int32, size: wp.vec2i
) -> wp.vec2:
    """Least and greatest depth of three pixels of a row about a column; 0, negative numbers and NaN do not count.

    Infinity and 0 where none counts. Beyond the borders are the pixels of the borders, which count anyhow, so that
    nothing is asked before a pixel is loaded.
    """
    start = wp.clamp(row, 0, size[1] - 1) * size[0]
    left = source[world, start + wp.max(column - 1, 0)]
    middle = source[world, start + column]
    right = source[world, start + wp.min(column + 1, size[0] - 1)]
    least = wp.min(wp.min(least_of(left), least_of(middle)), least_of(right))
    greatest = wp.max(wp.max(greatest_of(left), greatest_of(middle)), greatest_of(right))
    return wp.vec2(least, greatest)


@wp.func
def joined(above: wp.vec2, here: wp.vec2, below: wp.vec2):
    """Least and greatest depth of three rows."""
    return wp.min(wp.min(above[0], here[0]), below[0]), wp.max(wp.max(above[1], here[1]), below[1])


@wp.kernel(enable_backward=False, grid_stride=False)
def drop_edges(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    limit = threshold[world]
    chance = probability[world]
    random = frame_state(randomness, world)
    above = extremes(source, world, top - 1, column, size)
    here = extremes(source, world, top, column, size)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        below = extremes(source, world, row + 1, column, size)
        depth = source[world, pixel]
        if is_measured(depth):
            least, greatest = joined(above, here, below)
            if not (greatest - least <= limit):
                if happens(wp.randf(wp.rand_init(random, pixel)), chance):
                    depth = wp.float32(0.0)
        target[world, pixel] = depth
        above = here
        here = below


@wp.kernel(enable_backward=False, grid_stride=False)
def mix_edges(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    limit = threshold[world]
    chance = probability[world]
    random = frame_state(randomness, world)
    above = extremes(source, world, top - 1, column, size)
    here = extremes(source, world, top, column, size)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        below = extremes(source, world, row + 1, column, size)
        depth = source[world, pixel]
        if is_measured(depth):
            least, greatest = joined(above, here, below)
            if greatest < wp.inf and not (greatest - least <= limit):
                state = wp.rand_init(random, pixel)
                if happens(wp.randf(state), chance):
                    depth = wp.lerp(least, greatest, wp.randf(state))
                    if wp.isnan(limit + chance):
                        depth = 0.0
        target[world, pixel] = depth
        above = here
        here = below


@wp.kernel(enable_backward=False, grid_stride=False)
def drop_grazing(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    normals: wp.array4d(dtype=wp.float32),
    randomness: Randomness,
    start: wp.array(dtype=wp.float32),
    end: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    view = views[world]
    begin = start[world]
    ramp = wp.max(end[world] - begin, 0.0)
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            beyond = wp.degrees(incidence(view, normals, world, row, column)) - begin
            if not (beyond <= 0.0):
                if not (wp.randf(wp.rand_init(random, pixel)) * ramp >= beyond):
                    depth = wp.float32(0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def drop_dark(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    colors: wp.array4d(dtype=wp.uint8),
    randomness: Randomness,
    threshold: wp.array(dtype=wp.float32),
    probability: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    limit = 255.0 * threshold[world]
    chance = probability[world]
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            red = wp.float32(colors[world, row, column, 0])
            green = wp.float32(colors[world, row, column, 1])
            blue = wp.float32(colors[world, row, column, 2])
            gray = 0.299 * red + 0.587 * green + 0.114 * blue
            if not (gray >= limit):
                if happens(wp.randf(wp.rand_init(random, pixel)), chance):
                    depth = wp.float32(0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def drop_at_random(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    randomness: Randomness,
    probability: wp.array(dtype=wp.float32),
    cell: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    chance = wp.where(wp.isnan(cell[world]), cell[world], probability[world])
    side = cell_side(cell[world])
    random = frame_state(randomness, world)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth):
            state = wp.rand_init(random, cell_of(row, column, size[0], side))
            if happens(wp.randf(state), chance):
                depth = wp.float32(0.0)
        target[world, pixel] = depth


@wp.kernel(enable_backward=False, grid_stride=False)
def quantize_depth(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    unit: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    step = unit[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        if is_measured(depth) and step != 0.0:
            units = wp.floor(depth / step + 0.5)
            depth = wp.where(units <= 65535.0, units * step, 0.0)
        target[world, pixel] = depth
