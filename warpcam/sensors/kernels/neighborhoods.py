"""Effects of a pixel's neighbours: blur, sharpening and channels of different size."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.indices import strip_of
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.sensors.kernels.color_images import ColorTarget, set_color

wp.set_module_options(compiler_flags())

MAX_SIGMA = 10.0  # of the widest Gaussian [pixels]: 61 pixels of a row and of a column are read


BLUR_ROWS = 16  # of a column of numbers that a thread of a blur has, as in native/sensors/blur_images.h

_IMAGES = {"mask": wp.array(dtype=wp.uint8), "width": wp.int32, "height": wp.int32}  # numbers across and down
_NUMBERS, _IMAGE = wp.array(dtype=wp.float32), wp.array2d(dtype=wp.float32)  # (world,) and (world, 3 pixel)

blur_rows = make_kernel(
    "blur_rows",
    "warpcam::blur_rows(mask, width, height, lanes, sigma, source, rows, index);",
    {**_IMAGES, "lanes": wp.int32, "sigma": _NUMBERS, "source": _IMAGE, "rows": _IMAGE},
    native_module("sensors/blur_images.h"),
)
blur = make_kernel(
    "blur",
    "warpcam::blur_image(mask, width, height, sigma, source, rows, target, index);",
    {**_IMAGES, "sigma": _NUMBERS, "source": _IMAGE, "rows": _IMAGE, "target": ColorTarget},
    native_module("sensors/blur_images.h"),
)
sharpen = make_kernel(
    "sharpen",
    "warpcam::sharpen_image(mask, width, height, amount, sigma, source, rows, target, index);",
    {**_IMAGES, "amount": _NUMBERS, "sigma": _NUMBERS, "source": _IMAGE, "rows": _IMAGE, "target": ColorTarget},
    native_module("sensors/blur_images.h"),
)


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
    target: ColorTarget,
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
        set_color(target, world, pixel, value)
