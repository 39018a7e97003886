"""Loss of JPEG: blocks of 8 x 8 pixels, transformed, quantised and transformed back."""

import math

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

# Loops are left to the compilers: all of them unrolled would be a long program.
wp.set_module_options({**compiler_flags(), "max_unroll": 1})

mat88 = wp.types.matrix(shape=(8, 8), dtype=wp.float32)

# The cosine transform of 8 numbers (ITU-T T.81, A.3.3), a row for each frequency.
COSINES = wp.constant(
    mat88(
        [
            math.cos((2 * place + 1) * frequency * math.pi / 16.0) * (0.5 if frequency else math.sqrt(0.125))
            for frequency in range(8)
            for place in range(8)
        ]
    )
)


@wp.func
def rounded(value: wp.float32) -> wp.float32:
    """The byte next to a value."""
    return wp.floor(wp.clamp(value, 0.0, 255.0) + 0.5)


@wp.func
def load_pixel(
    source: wp.array2d(dtype=wp.vec3),
    world: wp.int32,
    column: wp.int32,
    row: wp.int32,
    width: wp.int32,
    height: wp.int32,
) -> wp.vec3:
    """Luma and both chromas of a pixel, or of the border's next one, as bytes (JFIF, ITU-R BT.601)."""
    color = 255.0 * source[world, wp.min(row, height - 1) * width + wp.min(column, width - 1)]
    red, green, blue = rounded(color[0]), rounded(color[1]), rounded(color[2])
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    to_blue = 0.5 * blue - 0.168736 * red - 0.331264 * green + 128.0
    to_red = 0.5 * red - 0.418688 * green - 0.081312 * blue + 128.0
    return wp.vec3(rounded(luma), rounded(to_blue), rounded(to_red))


@wp.func
def code(block: mat88, tables: wp.array2d(dtype=wp.float32), table: wp.int32, quality: wp.float32) -> mat88:
    """A block of bytes less 128, as it comes back from the file."""
    percent = wp.where(quality < 50.0, wp.floor(5000.0 / quality), 200.0 - 2.0 * quality)
    frequencies = COSINES * block * wp.transpose(COSINES)
    for row in range(8):
        for column in range(8):
            step = wp.clamp(wp.floor((tables[table, 8 * row + column] * percent + 50.0) / 100.0), 1.0, 255.0)
            frequencies[row, column] = step * wp.round(frequencies[row, column] / step)
    return wp.transpose(COSINES) * frequencies * COSINES


@wp.kernel(enable_backward=False)
def compress(
    mask: wp.array(dtype=wp.uint8),
    tables: wp.array2d(dtype=wp.float32),
    quality: wp.array(dtype=wp.float32),
    width: wp.int32,
    height: wp.int32,
    blocks: wp.int32,
    units_across: wp.int32,
    units: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """A thread for each unit: one block of each chroma, and ``blocks`` x ``blocks`` of luma."""
    world, unit = row_and_column(first + wp.tid(), units)
    if mask[world] == wp.uint8(0):
        return
    unit_row, unit_column = row_and_column(unit, units_across)
    left = 8 * blocks * unit_column
    top = 8 * blocks * unit_row
    exact = wp.clamp(wp.floor(quality[world] + 0.5), 1.0, 100.0)
    to_blue = mat88()
    to_red = mat88()
    share = 1.0 / wp.float32(blocks * blocks)
    for row in range(8):
        for column in range(8):
            sums = wp.vec3()
            for y in range(blocks):
                for x in range(blocks):
                    sums += load_pixel(source, world, left + blocks * column + x, top + blocks * row + y, width, height)
            to_blue[row, column] = wp.floor(share * sums[1] + 0.5) - 128.0
            to_red[row, column] = wp.floor(share * sums[2] + 0.5) - 128.0
    to_blue = code(to_blue, tables, 1, exact)
    to_red = code(to_red, tables, 1, exact)
    for block_row in range(blocks):
        for block_column in range(blocks):
            begin_row = top + 8 * block_row
            begin_column = left + 8 * block_column
            luma = mat88()
            for row in range(8):
                for column in range(8):
                    pixel = load_pixel(source, world, begin_column + column, begin_row + row, width, height)
                    luma[row, column] = pixel[0] - 128.0
            luma = code(luma, tables, 0, exact)
            for row in range(8):
                for column in range(8):
                    y = begin_row + row
                    x = begin_column + column
                    if y < height and x < width:
                        at_row = (8 * block_row + row) // blocks
                        at_column = (8 * block_column + column) // blocks
                        light = rounded(luma[row, column] + 128.0)
                        blue = rounded(to_blue[at_row, at_column] + 128.0) - 128.0
                        red = rounded(to_red[at_row, at_column] + 128.0) - 128.0
                        color = wp.vec3(
                            rounded(light + 1.402 * red),
                            rounded(light - 0.344136 * blue - 0.714136 * red),
                            rounded(light + 1.772 * blue),
                        )
                        target[world, y * width + x] = color / 255.0
