"""Loss of JPEG: blocks of 8 x 8 numbers, transformed, quantised and transformed back."""

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
def code_chroma(
    mask: wp.array(dtype=wp.uint8),
    tables: wp.array2d(dtype=wp.float32),
    quality: wp.array(dtype=wp.float32),
    size: wp.vec2i,
    scale: wp.int32,
    blocks: wp.vec2i,
    source: wp.array2d(dtype=wp.vec3),
    chroma: wp.array2d(dtype=wp.vec2ub),
    first: wp.int32,
):
    """Chroma of an image that is ``scale`` times smaller; a thread for each block of it."""
    world, block = row_and_column(first + wp.tid(), blocks[0] * blocks[1])
    if mask[world] == wp.uint8(0):
        return
    block_row, block_column = row_and_column(block, blocks[0])
    exact = wp.clamp(wp.floor(quality[world] + 0.5), 1.0, 100.0)
    to_blue = mat88()
    to_red = mat88()
    share = 1.0 / wp.float32(scale * scale)
    for row in range(8):
        for column in range(8):
            left = scale * (8 * block_column + column)
            top = scale * (8 * block_row + row)
            sums = wp.vec3()
            for y in range(scale):
                for x in range(scale):
                    sums += load_pixel(source, world, left + x, top + y, size[0], size[1])
            to_blue[row, column] = wp.floor(share * sums[1] + 0.5) - 128.0
            to_red[row, column] = wp.floor(share * sums[2] + 0.5) - 128.0
    to_blue = code(to_blue, tables, 1, exact)
    to_red = code(to_red, tables, 1, exact)
    for row in range(8):
        for column in range(8):
            place = (8 * block_row + row) * 8 * blocks[0] + 8 * block_column + column
            blue = wp.uint8(rounded(to_blue[row, column] + 128.0))
            red = wp.uint8(rounded(to_red[row, column] + 128.0))
            chroma[world, place] = wp.vec2ub(blue, red)


@wp.func
def chroma_at(
    chroma: wp.array2d(dtype=wp.vec2ub),
    world: wp.int32,
    x: wp.int32,
    y: wp.int32,
    scale: wp.int32,
    size: wp.vec2i,
    width: wp.int32,
) -> wp.vec2:
    """Chroma of a pixel: of half resolution, 9/16 of the nearest and the rest of its neighbours, as libjpeg does."""
    column = x // scale
    row = y // scale
    nearest = as_floats(chroma[world, row * width + column])
    if scale == 1:
        return nearest
    other_column = wp.clamp(column + 2 * (x & 1) - 1, 0, (size[0] + 1) // 2 - 1)
    other_row = wp.clamp(row + 2 * (y & 1) - 1, 0, (size[1] + 1) // 2 - 1)
    beside = as_floats(chroma[world, row * width + other_column])
    above = as_floats(chroma[world, other_row * width + column])
    diagonal = as_floats(chroma[world, other_row * width + other_column])
    total = 9.0 * nearest + 3.0 * (beside + above) + diagonal
    return wp.vec2(wp.floor((total[0] + 8.0) / 16.0), wp.floor((total[1] + 8.0) / 16.0))


@wp.func
def as_floats(pair: wp.vec2ub) -> wp.vec2:
    return wp.vec2(wp.float32(pair[0]), wp.float32(pair[1]))


@wp.kernel(enable_backward=False)
def code_luma(
    mask: wp.array(dtype=wp.uint8),
    tables: wp.array2d(dtype=wp.float32),
    quality: wp.array(dtype=wp.float32),
    size: wp.vec2i,
    scale: wp.int32,
    chroma_width: wp.int32,
    blocks: wp.vec2i,
    source: wp.array2d(dtype=wp.vec3),
    chroma: wp.array2d(dtype=wp.vec2ub),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Luma, and colours of it with the chroma; a thread for each block."""
    world, block = row_and_column(first + wp.tid(), blocks[0] * blocks[1])
    if mask[world] == wp.uint8(0):
        return
    block_row, block_column = row_and_column(block, blocks[0])
    exact = wp.clamp(wp.floor(quality[world] + 0.5), 1.0, 100.0)
    luma = mat88()
    for row in range(8):
        for column in range(8):
            pixel = load_pixel(source, world, 8 * block_column + column, 8 * block_row + row, size[0], size[1])
            luma[row, column] = pixel[0] - 128.0
    luma = code(luma, tables, 0, exact)
    for row in range(8):
        for column in range(8):
            x = 8 * block_column + column
            y = 8 * block_row + row
            if x < size[0] and y < size[1]:
                light = rounded(luma[row, column] + 128.0)
                tint = chroma_at(chroma, world, x, y, scale, size, chroma_width) - wp.vec2(128.0, 128.0)
                color = wp.vec3(
                    rounded(light + 1.402 * tint[1]),
                    rounded(light - 0.344136 * tint[0] - 0.714136 * tint[1]),
                    rounded(light + 1.772 * tint[0]),
                )
                target[world, y * size[0] + x] = color / 255.0
