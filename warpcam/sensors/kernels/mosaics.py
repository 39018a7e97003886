"""Bayer mosaics: one channel of each pixel kept, the others made from its neighbours."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import STRIP, strip_of, strip_vector
from warpcam.sensors.kernels.color_images import ColorTarget, set_color

wp.set_module_options(compiler_flags())

near_column = wp.types.vector(length=int(STRIP) + 2, dtype=wp.float32)  # a number for each row of a strip and 1 beside
far_column = wp.types.vector(length=int(STRIP) + 4, dtype=wp.float32)  # likewise, and 2 beside


@wp.struct
class Mosaic:
    """Image with one number for each pixel: the channel that the filter in front of it lets through."""

    numbers: wp.array2d(dtype=wp.float32)  # (world, 3 pixel) colours
    width: wp.int32
    height: wp.int32
    red_column: wp.int32  # 0 or 1: columns with red filters are even or odd
    red_row: wp.int32


@wp.func
def mirrored(index: wp.int32, size: wp.int32) -> wp.int32:
    """Index of a line, mirrored at the lines of the border, which keeps the order of filters; 0 for one far outside."""
    inside = wp.abs(index)
    return wp.max(wp.where(inside >= size, 2 * (size - 1) - inside, inside), 0)


@wp.func
def beyond_red(mosaic: Mosaic, column: wp.int32) -> wp.int32:
    """0 in a column with red filters, 1 in others."""
    return (column ^ mosaic.red_column) & 1


@wp.func
def at(mosaic: Mosaic, world: wp.int32, column: wp.int32, row: wp.int32) -> wp.float32:
    """Number of a pixel: a filter is red in a column and a row of red ones, blue in neither, else green."""
    y = mirrored(row, mosaic.height)
    channel = beyond_red(mosaic, column) + ((y ^ mosaic.red_row) & 1)
    return mosaic.numbers[world, 3 * (y * mosaic.width + column) + channel]


@wp.func
def near_sums(mosaic: Mosaic, world: wp.int32, column: wp.int32, top: wp.int32) -> near_column:
    """Sums of the pixels to the left and to the right, from the row above a strip on."""
    left = mirrored(column - 1, mosaic.width)
    right = mirrored(column + 1, mosaic.width)
    sums = near_column()
    for k in range(STRIP + 2):
        sums[k] = at(mosaic, world, left, top - 1 + k) + at(mosaic, world, right, top - 1 + k)
    return sums


@wp.func
def is_red_row(mosaic: Mosaic, row: wp.int32) -> wp.bool:
    return (row & 1) == mosaic.red_row


@wp.func
def color_of(channel: wp.int32, own: wp.float32, green: wp.float32, other: wp.float32) -> wp.vec3:
    """Colour of a pixel that measures red, 0, or blue, 2, and of which green and the other one were found."""
    return wp.vec3(wp.where(channel == 0, own, other), green, wp.where(channel == 0, other, own))


@wp.kernel(enable_backward=False, grid_stride=False)
def interpolate_bilinearly(
    mask: wp.array(dtype=wp.uint8), size: wp.vec2i, mosaic: Mosaic, target: ColorTarget, first: wp.int32
):
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    middle = near_column()
    for k in range(STRIP + 2):
        middle[k] = at(mosaic, world, column, top - 1 + k)
    beside = near_sums(mosaic, world, column, top)
    outside = beyond_red(mosaic, column)
    for k in range(STRIP):
        row = top + k
        if row < bottom:
            own = middle[k + 1]
            horizontal = beside[k + 1]
            vertical = middle[k] + middle[k + 2]
            in_red_row = is_red_row(mosaic, row)
            channel = outside + wp.where(in_red_row, 0, 1)
            color = wp.vec3(
                0.5 * wp.where(in_red_row, horizontal, vertical), own, 0.5 * wp.where(in_red_row, vertical, horizontal)
            )
            if channel != 1:
                color = color_of(channel, own, 0.25 * (horizontal + vertical), 0.25 * (beside[k] + beside[k + 2]))
            set_color(target, world, row * size[0] + column, color)


@wp.kernel(enable_backward=False, grid_stride=False)
def interpolate_with_gradients(
    mask: wp.array(dtype=wp.uint8), size: wp.vec2i, mosaic: Mosaic, target: ColorTarget, first: wp.int32
):
    """Linear filters of 5 x 5 pixels by Malvar, He and Cutler."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    middle = far_column()
    for k in range(STRIP + 4):
        middle[k] = at(mosaic, world, column, top - 2 + k)
    beside = near_sums(mosaic, world, column, top)
    left = mirrored(column - 2, size[0])
    right = mirrored(column + 2, size[0])
    far_horizontal = strip_vector()
    for k in range(STRIP):
        far_horizontal[k] = at(mosaic, world, left, top + k) + at(mosaic, world, right, top + k)
    outside = beyond_red(mosaic, column)
    for k in range(STRIP):
        row = top + k
        if row < bottom:
            own = middle[k + 2]
            horizontal = beside[k + 1]
            vertical = middle[k + 1] + middle[k + 3]
            far_vertical = middle[k] + middle[k + 4]
            diagonal = beside[k] + beside[k + 2]
            in_red_row = is_red_row(mosaic, row)
            channel = outside + wp.where(in_red_row, 0, 1)
            color = wp.vec3()
            if channel == 1:
                common = 5.0 * own - diagonal
                sideways = (common + 4.0 * horizontal - far_horizontal[k] + 0.5 * far_vertical) / 8.0
                upright = (common + 4.0 * vertical - far_vertical + 0.5 * far_horizontal[k]) / 8.0
                color = wp.vec3(wp.where(in_red_row, sideways, upright), own, wp.where(in_red_row, upright, sideways))
            else:
                far = far_horizontal[k] + far_vertical
                green = (4.0 * own + 2.0 * (horizontal + vertical) - far) / 8.0
                color = color_of(channel, own, green, (6.0 * own + 2.0 * diagonal - 1.5 * far) / 8.0)
            color = wp.vec3(wp.max(color[0], 0.0), wp.max(color[1], 0.0), wp.max(color[2], 0.0))
            set_color(target, world, row * size[0] + column, color)
