"""Bayer mosaics: one channel of each pixel kept, the others made from its neighbours."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


@wp.struct
class Mosaic:
    """Image with one number for each pixel: the channel that the filter in front of it lets through."""

    colors: wp.array2d(dtype=wp.vec3)  # (world, pixel)
    width: wp.int32
    height: wp.int32
    red_column: wp.int32  # 0 or 1: columns with red filters are even or odd
    red_row: wp.int32


@wp.func
def mirrored(index: wp.int32, size: wp.int32) -> wp.int32:
    """Index of a line, mirrored at the lines of the border, which keeps the order of filters."""
    inside = wp.abs(index)
    return wp.where(inside >= size, 2 * (size - 1) - inside, inside)


@wp.func
def channel_of(mosaic: Mosaic, column: wp.int32, row: wp.int32) -> wp.int32:
    in_red_column = (column & 1) == mosaic.red_column
    in_red_row = (row & 1) == mosaic.red_row
    if in_red_column and in_red_row:
        return 0
    if in_red_column or in_red_row:
        return 1
    return 2


@wp.func
def at(mosaic: Mosaic, world: wp.int32, column: wp.int32, row: wp.int32) -> wp.float32:
    x = mirrored(column, mosaic.width)
    y = mirrored(row, mosaic.height)
    color = mosaic.colors[world, y * mosaic.width + x]
    return color[channel_of(mosaic, x, y)]


@wp.func
def across(mosaic: Mosaic, world: wp.int32, column: wp.int32, row: wp.int32, step: wp.int32) -> wp.float32:
    return at(mosaic, world, column - step, row) + at(mosaic, world, column + step, row)


@wp.func
def along(mosaic: Mosaic, world: wp.int32, column: wp.int32, row: wp.int32, step: wp.int32) -> wp.float32:
    return at(mosaic, world, column, row - step) + at(mosaic, world, column, row + step)


@wp.func
def corners(mosaic: Mosaic, world: wp.int32, column: wp.int32, row: wp.int32) -> wp.float32:
    return across(mosaic, world, column, row - 1, 1) + across(mosaic, world, column, row + 1, 1)


@wp.kernel(enable_backward=False)
def interpolate_bilinearly(
    mask: wp.array(dtype=wp.uint8), mosaic: Mosaic, target: wp.array2d(dtype=wp.vec3), first: wp.int32
):
    world, pixel = row_and_column(first + wp.tid(), target.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, mosaic.width)
    own = at(mosaic, world, column, row)
    horizontal = across(mosaic, world, column, row, 1)
    vertical = along(mosaic, world, column, row, 1)
    channel = channel_of(mosaic, column, row)
    color = wp.vec3(own)
    if channel == 1:
        is_red_row = (row & 1) == mosaic.red_row
        color[0] = 0.5 * wp.where(is_red_row, horizontal, vertical)
        color[2] = 0.5 * wp.where(is_red_row, vertical, horizontal)
    else:
        color[1] = 0.25 * (horizontal + vertical)
        color[2 - channel] = 0.25 * corners(mosaic, world, column, row)
    target[world, pixel] = color


@wp.kernel(enable_backward=False)
def interpolate_with_gradients(
    mask: wp.array(dtype=wp.uint8), mosaic: Mosaic, target: wp.array2d(dtype=wp.vec3), first: wp.int32
):
    """Linear filters of 5 x 5 pixels by Malvar, He and Cutler."""
    world, pixel = row_and_column(first + wp.tid(), target.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, mosaic.width)
    own = at(mosaic, world, column, row)
    horizontal = across(mosaic, world, column, row, 1)
    vertical = along(mosaic, world, column, row, 1)
    far_horizontal = across(mosaic, world, column, row, 2)
    far_vertical = along(mosaic, world, column, row, 2)
    diagonal = corners(mosaic, world, column, row)
    channel = channel_of(mosaic, column, row)
    color = wp.vec3(own)
    if channel == 1:
        common = 5.0 * own - diagonal
        sideways = (common + 4.0 * horizontal - far_horizontal + 0.5 * far_vertical) / 8.0
        upright = (common + 4.0 * vertical - far_vertical + 0.5 * far_horizontal) / 8.0
        is_red_row = (row & 1) == mosaic.red_row
        color[0] = wp.where(is_red_row, sideways, upright)
        color[2] = wp.where(is_red_row, upright, sideways)
    else:
        far = far_horizontal + far_vertical
        color[1] = (4.0 * own + 2.0 * (horizontal + vertical) - far) / 8.0
        color[2 - channel] = (6.0 * own + 2.0 * diagonal - 1.5 * far) / 8.0
    target[world, pixel] = wp.vec3(wp.max(color[0], 0.0), wp.max(color[1], 0.0), wp.max(color[2], 0.0))
