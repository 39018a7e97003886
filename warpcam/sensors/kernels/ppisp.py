"""PPISP: exposure, vignetting, colour and response of a camera, of few numbers each."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color
from warpcam.sensors.kernels.tone import Responses, response
from warpcam.sensors.kernels.vignetting import around_middle, falloff

wp.set_module_options(compiler_flags())


@wp.struct
class Optics:
    """What acts on light before its colour."""

    responsivity: wp.array(dtype=wp.float32)  # (world,)
    exposure_offset: wp.array(dtype=wp.float32)  # (world,) [EV]
    factors: wp.array(dtype=wp.float32)  # (world,) of both, found once a frame
    centers: wp.array2d(dtype=wp.float32)  # (world, 6) x and y of vignetting for red, green and blue
    coefficients: wp.array2d(dtype=wp.float32)  # (world, 9) three of vignetting for red, green and blue


@wp.func
def moved(latents: wp.array2d(dtype=wp.float32), world: wp.int32, entry: wp.int32, spread: wp.vec3) -> wp.vec2:
    """Shift of a chromaticity: two latent numbers by a symmetric matrix, of which ``spread`` has xx, xy and yy."""
    x = latents[world, 2 * entry]
    y = latents[world, 2 * entry + 1]
    return wp.vec2(spread[0] * x + spread[1] * y, spread[1] * x + spread[2] * y)


@wp.kernel(enable_backward=False)
def prepare_worlds(
    latents: wp.array2d(dtype=wp.float32),
    homographies: wp.array(dtype=wp.mat33),
    optics: Optics,
    first: wp.int32,
):
    """Factor of exposure, and homography that takes corners of the chromaticity triangle and grey where they move.

    Homographies are of (red, green, sum). The images of the corners are weighted such that their sum is in the
    direction of the moved grey. The scale is that of Isaac Lab, which the offset below a quotient makes visible in the
    dark.
    """
    world = first + wp.tid()
    optics.factors[world] = optics.responsivity[world] * wp.pow(2.0, optics.exposure_offset[world])
    blue = moved(latents, world, 0, wp.vec3(0.0480542, -0.0043631, 0.0481283))
    red = moved(latents, world, 1, wp.vec3(0.0580570, -0.0179872, 0.0431061))
    green = moved(latents, world, 2, wp.vec3(0.0433336, -0.0180537, 0.0580500))
    gray = moved(latents, world, 3, wp.vec3(0.0128369, -0.0034654, 0.0128158))
    to_blue = wp.vec3(blue[0], blue[1], 1.0)
    to_red = wp.vec3(1.0 + red[0], red[1], 1.0)
    to_green = wp.vec3(green[0], 1.0 + green[1], 1.0)
    to_gray = wp.vec3(1.0 / 3.0 + gray[0], 1.0 / 3.0 + gray[1], 1.0)
    # Cramer's rule without its common divisor, which the scale below takes out.
    of_blue = wp.dot(to_gray, wp.cross(to_red, to_green))
    of_red = wp.dot(to_blue, wp.cross(to_gray, to_green))
    of_green = wp.dot(to_blue, wp.cross(to_red, to_gray))
    total = of_red + of_green - of_blue
    scale = wp.where(wp.abs(total) > 1.0e-20, 1.0 / total, 1.0)
    image_of_blue = (scale * of_blue) * to_blue
    image_of_red = (scale * of_red) * to_red
    image_of_green = (scale * of_green) * to_green
    by_red = image_of_red - image_of_blue
    by_green = image_of_green - image_of_blue
    homographies[world] = wp.matrix_from_cols(by_red, by_green, image_of_blue)


@wp.kernel(enable_backward=False, grid_stride=False, launch_bounds=(128, 6))
def process(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    optics: Optics,
    homographies: wp.array(dtype=wp.mat33),
    responses: Responses,
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    exposure = optics.factors[world]
    homography = homographies[world]
    red = responses.shapes[world, 0]
    green = responses.shapes[world, 1]
    blue = responses.shapes[world, 2]
    heights = responses.heights[world]
    x = around_middle(column, size[0], size)
    right = wp.vec3(x - optics.centers[world, 0], x - optics.centers[world, 2], x - optics.centers[world, 4])
    middles = wp.vec3(optics.centers[world, 1], optics.centers[world, 3], optics.centers[world, 5])
    coefficients = wp.mat33()
    for k in range(3):
        for power in range(3):
            coefficients[k, power] = optics.coefficients[world, 3 * k + power]
    ahead = color_at(source, world, top * size[0] + column)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        light = exposure * ahead
        ahead = color_at(source, world, wp.min(row + 1, bottom - 1) * size[0] + column)
        y = around_middle(row, size[1], size)
        for k in range(3):
            down = y - middles[k]
            square = right[k] * right[k] + down * down
            light[k] = light[k] * falloff(square, coefficients[k, 0], coefficients[k, 1], coefficients[k, 2])
        total = light[0] + light[1] + light[2]
        image = homography * wp.vec3(light[0], light[1], total)
        image = image * (total / (image[2] + 1.0e-5))
        color = wp.vec3(
            response(image[0], red, heights[0]),
            response(image[1], green, heights[1]),
            response(image[2] - image[0] - image[1], blue, heights[2]),
        )
        set_color(target, world, pixel, color)
