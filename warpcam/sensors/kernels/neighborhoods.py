"""Effects of a pixel's neighbours: blur, sharpening and channels of different size."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())

MAX_SIGMA = 10.0  # of the widest Gaussian [pixels]: 61 pixels of a row and of a column are read


@wp.func
def blurred(
    image: wp.array2d(dtype=wp.vec3),
    world: wp.int32,
    begin: wp.int32,
    step: wp.int32,
    count: wp.int32,
    place: wp.int32,
    sigma: wp.float32,
) -> wp.vec3:
    """Mean along a line of pixels, weighted by a Gaussian out to three standard deviations.

    Beyond its ends the line goes on as the pixels there.

    Args:
        image: (world, pixel).
        world: Which.
        begin: First pixel of the line.
        step: From a pixel of the line to the next.
        count: Pixels of the line.
        place: Number of the pixel in the line.
        sigma: Standard deviation [pixels]; more than MAX_SIGMA counts as that, and NaN as 0.
    """
    total = image[world, begin + place * step]
    if not sigma > 0.0:
        return total
    spread = wp.min(sigma, wp.static(MAX_SIGMA))
    ratio = wp.exp(-0.5 / (spread * spread))
    growth = ratio * ratio
    weight = wp.float32(1.0)
    weights = wp.float32(1.0)
    for distance in range(1, wp.int32(wp.ceil(3.0 * spread)) + 1):
        weight *= ratio  # ratio^(distance^2), whose exponent grows by 1, 3, 5, ...
        ratio *= growth
        before = image[world, begin + wp.max(place - distance, 0) * step]
        after = image[world, begin + wp.min(place + distance, count - 1) * step]
        total += weight * (before + after)
        weights += 2.0 * weight
    return total / weights


@wp.kernel(enable_backward=False)
def blur_lines(
    mask: wp.array(dtype=wp.uint8),
    sigma: wp.array(dtype=wp.float32),
    width: wp.int32,
    is_down: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Blur along the rows of an image, or down its columns."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, width)
    if is_down != 0:
        target[world, pixel] = blurred(source, world, column, width, source.shape[1] // width, row, sigma[world])
    else:
        target[world, pixel] = blurred(source, world, row * width, 1, width, column, sigma[world])


@wp.kernel(enable_backward=False)
def sharpen(
    mask: wp.array(dtype=wp.uint8),
    amount: wp.array(dtype=wp.float32),
    sigma: wp.array(dtype=wp.float32),
    width: wp.int32,
    rows: wp.array2d(dtype=wp.vec3),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Add what a blur takes; ``rows`` is the image blurred along its rows."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, width)
    value = source[world, pixel]
    detail = value - blurred(rows, world, column, width, source.shape[1] // width, row, sigma[world])
    target[world, pixel] = value + amount[world] * detail


@wp.func
def sample(
    source: wp.array2d(dtype=wp.vec3),
    world: wp.int32,
    x: wp.float32,
    y: wp.float32,
    width: wp.int32,
    height: wp.int32,
) -> wp.vec3:
    """Colour between the middles of pixels, which have whole coordinates; the image goes on as its border."""
    inside_x = wp.clamp(x, 0.0, wp.float32(width - 1))
    inside_y = wp.clamp(y, 0.0, wp.float32(height - 1))
    column = wp.min(wp.int32(inside_x), wp.max(width - 2, 0))
    row = wp.min(wp.int32(inside_y), wp.max(height - 2, 0))
    right = inside_x - wp.float32(column)
    below = inside_y - wp.float32(row)
    upper = row * width
    lower = wp.min(row + 1, height - 1) * width
    next_column = wp.min(column + 1, width - 1)
    above = wp.lerp(source[world, upper + column], source[world, upper + next_column], right)
    under = wp.lerp(source[world, lower + column], source[world, lower + next_column], right)
    return wp.lerp(above, under, below)


@wp.kernel(enable_backward=False)
def shift_channels(
    mask: wp.array(dtype=wp.uint8),
    red: wp.array(dtype=wp.float32),
    blue: wp.array(dtype=wp.float32),
    width: wp.int32,
    height: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Red and blue magnified about the middle of the image."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, width)
    middle = wp.vec2(0.5 * wp.float32(width - 1), 0.5 * wp.float32(height - 1))
    away = wp.vec2(wp.float32(column), wp.float32(row)) - middle
    of_red = middle + away / red[world]
    of_blue = middle + away / blue[world]
    value = source[world, pixel]
    value[0] = sample(source, world, of_red[0], of_red[1], width, height)[0]
    value[2] = sample(source, world, of_blue[0], of_blue[1], width, height)[2]
    target[world, pixel] = value
