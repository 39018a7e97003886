"""Effects of a pixel's neighbours: blur, sharpening and channels of different size."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import STRIP, strip_of, strip_vector

wp.set_module_options(compiler_flags())

MAX_SIGMA = 10.0  # of the widest Gaussian [pixels]: 61 pixels of a row and of a column are read


@wp.struct
class Gaussian:
    """Weights of a Gaussian, of which the middle has 1, out to three standard deviations."""

    radius: wp.int32  # [pixels]
    ratio: wp.float32  # weight of the next pixel, whose weight is ratio^(1^2), and then ratio^(2^2), ...


@wp.func
def gaussian_of(sigma: wp.float32) -> Gaussian:
    """The Gaussian of a standard deviation [pixels]; more than MAX_SIGMA counts as that, and NaN as 0."""
    result = Gaussian()
    if sigma > 0.0:
        spread = wp.min(sigma, wp.static(MAX_SIGMA))
        result.radius = wp.int32(wp.ceil(3.0 * spread))
        result.ratio = wp.exp(-0.5 / (spread * spread))
    return result


@wp.kernel(enable_backward=False, grid_stride=False)
def blur_rows(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    sigma: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Means along the rows of an image, weighted by a Gaussian; beyond its ends a row goes on as the pixels there.

    Threads have strips of numbers, three times as many as pixels, as all channels are treated alike and what threads
    read together is next to each other. ``size`` counts numbers across.
    """
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    gaussian = gaussian_of(sigma[world])
    leftmost = column % 3
    rightmost = size[0] - 3 + leftmost
    starts = wp.vec4i()
    totals = strip_vector()
    for k in range(STRIP):
        starts[k] = wp.min(top + k, bottom - 1) * size[0]
        totals[k] = source[world, starts[k] + column]
    ratio = gaussian.ratio
    growth = ratio * ratio
    weight = wp.float32(1.0)
    weights = wp.float32(1.0)
    for distance in range(1, gaussian.radius + 1):
        weight *= ratio  # ratio^(distance^2), whose exponent grows by 1, 3, 5, ...
        ratio *= growth
        before = wp.max(column - 3 * distance, leftmost)
        after = wp.min(column + 3 * distance, rightmost)
        for k in range(STRIP):
            totals[k] += weight * (source[world, starts[k] + before] + source[world, starts[k] + after])
        weights += 2.0 * weight
    for k in range(STRIP):
        if top + k < bottom:
            target[world, starts[k] + column] = totals[k] / weights


@wp.func
def blurred_column(
    rows: wp.array2d(dtype=wp.float32),
    world: wp.int32,
    column: wp.int32,
    top: wp.int32,
    size: wp.vec2i,
    sigma: wp.float32,
) -> strip_vector:
    """Means along a column for the rows of a strip, likewise; a row is read once for all of them."""
    gaussian = gaussian_of(sigma)
    before = strip_vector()
    for k in range(STRIP):
        before[k] = rows[world, wp.min(top + k, size[1] - 1) * size[0] + column]
    after = strip_vector(before)
    totals = strip_vector(before)
    ratio = gaussian.ratio
    growth = ratio * ratio
    weight = wp.float32(1.0)
    weights = wp.float32(1.0)
    for distance in range(1, gaussian.radius + 1):
        weight *= ratio
        ratio *= growth
        for k in range(STRIP - 1):
            before[STRIP - 1 - k] = before[STRIP - 2 - k]
            after[k] = after[k + 1]
        before[0] = rows[world, wp.max(top - distance, 0) * size[0] + column]
        after[STRIP - 1] = rows[world, wp.min(top + STRIP - 1 + distance, size[1] - 1) * size[0] + column]
        totals += weight * (before + after)
        weights += 2.0 * weight
    return totals / weights


@wp.kernel(enable_backward=False, grid_stride=False)
def blur_columns(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    sigma: wp.array(dtype=wp.float32),
    rows: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Blur down the columns of an image of blurred rows."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    means = blurred_column(rows, world, column, top, size, sigma[world])
    for k in range(STRIP):
        if top + k < bottom:
            target[world, (top + k) * size[0] + column] = means[k]


@wp.kernel(enable_backward=False, grid_stride=False)
def sharpen(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    amount: wp.array(dtype=wp.float32),
    sigma: wp.array(dtype=wp.float32),
    rows: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Add what a blur takes; ``rows`` is the image with blurred rows."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    means = blurred_column(rows, world, column, top, size, sigma[world])
    gain = amount[world]
    for k in range(STRIP):
        if top + k < bottom:
            place = (top + k) * size[0] + column
            value = source[world, place]
            target[world, place] = value + gain * (value - means[k])


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


@wp.kernel(enable_backward=False, grid_stride=False)
def shift_channels(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    red: wp.array(dtype=wp.float32),
    blue: wp.array(dtype=wp.float32),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Red and blue magnified about the middle of the image."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    middle = wp.vec2(0.5 * wp.float32(size[0] - 1), 0.5 * wp.float32(size[1] - 1))
    of_red = red[world]
    of_blue = blue[world]
    away = wp.float32(column) - middle[0]
    x_of_red = middle[0] + away / of_red
    x_of_blue = middle[0] + away / of_blue
    for row in range(top, bottom):
        pixel = row * size[0] + column
        below = wp.float32(row) - middle[1]
        value = source[world, pixel]
        value[0] = sample(source, world, x_of_red, middle[1] + below / of_red, size[0], size[1])[0]
        value[2] = sample(source, world, x_of_blue, middle[1] + below / of_blue, size[0], size[1])[2]
        target[world, pixel] = value
