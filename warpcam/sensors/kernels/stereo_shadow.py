"""Surfaces that the second imager of a stereo camera does not see."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column, strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.depth_values import is_measured

wp.set_module_options(compiler_flags())

# Neighbours whose disparities differ by more are of two surfaces [pixels]: one that is steeper is not seen by both
# eyes.
STEP = 1.0


# Threads that look for the least depth of a row, each in every so manieth column.
PARTS = 16


@wp.kernel(enable_backward=False, grid_stride=False)
def find_nearest_of_parts(
    mask: wp.array(dtype=wp.uint8),
    width: wp.int32,
    source: wp.array2d(dtype=wp.float32),
    nearest: wp.array3d(dtype=wp.float32),
    first: wp.int32,
):
    """Least depth of each part of each row, (world, row, part)."""
    line, part = row_and_column(first + wp.tid(), PARTS)
    world, row = row_and_column(line, nearest.shape[1])
    if mask[world] == wp.uint8(0):
        return
    least = wp.float32(wp.inf)
    for column in range(part, width, PARTS):
        depth = source[world, row * width + column]
        if is_measured(depth):
            least = wp.min(least, depth)
    nearest[world, row, part] = least


@wp.kernel(enable_backward=False, grid_stride=False)
def find_nearest(
    mask: wp.array(dtype=wp.uint8),
    parts: wp.array3d(dtype=wp.float32),
    nearest: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Least depth of each row of an image."""
    world, row = row_and_column(first + wp.tid(), nearest.shape[1])
    if mask[world] == wp.uint8(0):
        return
    least = parts[world, row, 0]
    for part in range(1, PARTS):
        least = wp.min(least, parts[world, row, part])
    nearest[world, row] = least


@wp.func
def disparity_at(
    source: wp.array2d(dtype=wp.float32),
    world: wp.int32,
    start: wp.int32,
    column: wp.int32,
    width: wp.int32,
    scale: wp.float32,
) -> wp.float32:
    """Disparity of a pixel [pixels]; -1 outside of the image and where nothing is measured."""
    disparity = wp.float32(-1.0)
    if column >= 0 and column < width:
        depth = source[world, start + column]
        if is_measured(depth):
            disparity = scale / depth
    return disparity


@wp.func
def is_joined(a: wp.float32, b: wp.float32) -> wp.bool:
    return a >= 0.0 and b >= 0.0 and wp.abs(a - b) <= STEP


@wp.kernel(enable_backward=False, grid_stride=False)
def drop_hidden(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    size: wp.vec2i,
    border: wp.int32,
    baseline: wp.array(dtype=wp.float32),
    nearest: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Make holes where the second imager sees something nearer, or nothing.

    A pixel k steps towards the second imager lies at ``e = k - (d_k - d_0)`` beside this one in the second image, where
    d are disparities: neighbours of one surface cover what lies between them, ends of a surface half a pixel more. The
    pixel is hidden if any covers 0. None farther than the greatest disparity of the row can.
    """
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    width = size[0]
    direction = wp.where(baseline[world] < 0.0, -1, 1)
    scale = wp.abs(baseline[world]) / views[world].scale[0]
    inside = wp.where(direction > 0, width - 1 - column, column)
    for row in range(top, bottom):
        start = row * width
        depth = source[world, start + column]
        if is_measured(depth):
            own = scale / depth
            steps = wp.min(wp.int32(scale / nearest[world, row] - own + 0.5) + 1, inside)
            before = wp.float32(own)
            here = disparity_at(source, world, start, column + direction, width, scale)
            hidden = wp.isnan(scale)
            k = wp.int32(1)
            while k <= steps and not hidden:
                after = disparity_at(source, world, start, column + direction * (k + 1), width, scale)
                if here >= 0.0:
                    place = wp.float32(k) - here + own
                    low = place
                    high = place
                    if not is_joined(before, here):
                        low -= 0.5
                    if is_joined(here, after):
                        high += 1.0 - after + here
                    else:
                        high += 0.5
                    hidden = low <= 0.0 and high >= 0.0
                before = here
                here = after
                k += 1
            place = wp.float32(column) + 0.5 - wp.float32(direction) * own
            outside = place < 0.0 or place > wp.float32(width)
            if hidden or (outside and border != 0):
                depth = wp.float32(0.0)
        target[world, start + column] = depth
