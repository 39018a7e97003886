"""Pixels of a depth image whose surroundings have about the same disparity, which a match of windows needs."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import STRIP, strip_of, strip_vector
from warpcam.kernels.types import View
from warpcam.sensors.kernels.arithmetic import quotient
from warpcam.sensors.kernels.depth_values import focal_length, is_measured

wp.set_module_options(compiler_flags())

# Tolerance of a neighbour at r pixels, in units of r^2 times that of the pixel itself.
GROWTH = wp.constant(1.44)


@wp.struct
class MatchingRule:
    """Numbers of each world, (world,), and the size of the window."""

    views: wp.array(dtype=View)
    baseline: wp.array(dtype=wp.float32)  # [m]
    tolerance: wp.array(dtype=wp.float32)  # [pixels]
    share: wp.array(dtype=wp.float32)  # of the window
    focal: wp.array(dtype=wp.float32)  # [pixels], or 0
    radius: wp.int32  # [pixels]


@wp.struct
class WindowRows:
    """Disparities [pixels] of the pixels of a row that are measured, in the window of each pixel: (world, pixel)."""

    sums: wp.array2d(dtype=wp.float32)
    counts: wp.array2d(dtype=wp.float32)
    least: wp.array2d(dtype=wp.float32)  # infinity without any
    greatest: wp.array2d(dtype=wp.float32)  # 0 without any


@wp.func
def disparity_scale(rule: MatchingRule, world: wp.int32) -> wp.float32:
    """Disparity at 1 m [pixels]."""
    return focal_length(rule.focal[world], rule.views[world]) * rule.baseline[world]


@wp.kernel(enable_backward=False, grid_stride=False)
def sum_window_rows(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    rule: MatchingRule,
    source: wp.array2d(dtype=wp.float32),
    rows: WindowRows,
    first: wp.int32,
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    scale = disparity_scale(rule, world)
    left = wp.max(column - rule.radius, 0)
    right = wp.min(column + rule.radius + 1, size[0])
    for row in range(top, bottom):
        start = row * size[0]
        total = wp.float32(0.0)
        count = wp.float32(0.0)
        least = wp.float32(wp.inf)
        greatest = wp.float32(0.0)
        for place in range(left, right):
            depth = source[world, start + place]
            if is_measured(depth):
                disparity = quotient(scale, depth)
                total += disparity
                count += 1.0
                least = wp.min(least, disparity)
                greatest = wp.max(greatest, disparity)
        rows.sums[world, start + column] = total
        rows.counts[world, start + column] = count
        rows.least[world, start + column] = least
        rows.greatest[world, start + column] = greatest


@wp.func
def reach_of(deviation: wp.float32, growth: wp.float32, radius: wp.int32) -> wp.int32:
    """Distance along a row or a column beyond which all pixels count, if none deviates more."""
    reach = wp.int32(0)
    while reach < radius and not deviation < growth * wp.float32((reach + 1) * (reach + 1)):
        reach += 1
    return reach


@wp.func
def strays(
    source: wp.array2d(dtype=wp.float32),
    world: wp.int32,
    row: wp.int32,
    column: wp.int32,
    size: wp.vec2i,
    reach: wp.int32,
    scale: wp.float32,
    mean: wp.float32,
    growth: wp.float32,
) -> wp.float32:
    """Number of the measured pixels that do not count, but for the middle, in a window as wide as the reach.

    ``|scale / depth - mean| < tolerance`` is multiplied by the depth, which is positive.
    """
    count = wp.float32(0.0)
    for y in range(wp.max(row - reach, 0), wp.min(row + reach + 1, size[1])):
        squared = (y - row) * (y - row)
        start = y * size[0]
        for x in range(wp.max(column - reach, 0), wp.min(column + reach + 1, size[0])):
            depth = source[world, start + x]
            tolerance = growth * wp.float32(squared + (x - column) * (x - column))
            if is_measured(depth) and not wp.abs(scale - mean * depth) < tolerance * depth:
                if y != row or x != column:
                    count += 1.0
    return count


@wp.kernel(enable_backward=False, grid_stride=False)
def keep_matches(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    rule: MatchingRule,
    rows: WindowRows,
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Set pixels to 0 of whose window too small a share counts.

    A neighbour at r pixels counts if its disparity differs from the mean of the window by less than ``GROWTH r^2
    tolerance``, the pixel itself by less than the tolerance. The means are sums of rows. Pixels are tried out to where
    the extremes of the rows of a strip's windows show that all farther ones count: none on most flat surfaces.
    """
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    radius = rule.radius
    scale = disparity_scale(rule, world)
    tolerance = rule.tolerance[world]
    growth = GROWTH * tolerance
    share = rule.share[world]
    totals = strip_vector()
    counts = strip_vector()
    least = wp.float32(wp.inf)
    greatest = wp.float32(0.0)
    for row in range(wp.max(top - radius, 0), wp.min(bottom + radius, size[1])):
        place = row * size[0] + column
        total = rows.sums[world, place]
        count = rows.counts[world, place]
        least = wp.min(least, rows.least[world, place])
        greatest = wp.max(greatest, rows.greatest[world, place])
        for k in range(STRIP):
            if wp.abs(row - top - k) <= radius:
                totals[k] += total
                counts[k] += count
    columns = wp.min(column + radius + 1, size[0]) - wp.max(column - radius, 0)
    for k in range(STRIP):
        row = top + k
        if row < bottom:
            depth = source[world, row * size[0] + column]
            if is_measured(depth):
                mean = totals[k] / counts[k]
                reach = reach_of(wp.max(greatest - mean, mean - least), growth, radius)
                alike = counts[k]
                if not wp.abs(scale / depth - mean) < tolerance:
                    alike -= 1.0
                if reach > 0:
                    alike -= strays(source, world, row, column, size, reach, scale, mean, growth)
                lines = wp.min(row + radius + 1, size[1]) - wp.max(row - radius, 0)
                if alike < share * wp.float32(lines * columns):
                    depth = wp.float32(0.0)
            target[world, row * size[0] + column] = depth
