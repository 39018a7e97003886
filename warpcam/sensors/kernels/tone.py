"""Curves from linear light to display values, and steps of display values."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import color_strip_of
from warpcam.sensors.kernels.arithmetic import power, quotient
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget, color_at, set_color
from warpcam.sensors.kernels.curves import encode

wp.set_module_options(compiler_flags())


@wp.struct
class Responses:
    """Response curves of the three channels in each world."""

    shapes: wp.array2d(dtype=wp.vec4)  # (world, channel) exponents of toe and shoulder, gamma and centre
    heights: wp.array(dtype=wp.vec3)  # (world,) values at which toe and shoulder meet, before gamma


@wp.func
def greatest_number(bits: wp.float32) -> wp.float32:
    """Greatest number of so many bits, to the next whole one."""
    return wp.float32((1 << wp.int32(bits + 0.5)) - 1)


@wp.func
def softplus(raw: wp.float32) -> wp.float32:
    """log(1 + exp(raw)), also where exp(raw) is infinite."""
    return wp.max(raw, 0.0) + wp.log(1.0 + wp.exp(-wp.abs(raw)))


@wp.func
def response_shape(toe: wp.float32, shoulder: wp.float32, gamma: wp.float32, center: wp.float32) -> wp.vec4:
    """Exponents of toe and shoulder, gamma and centre of a response curve, from numbers without bounds."""
    middle = wp.clamp(1.0 / (1.0 + wp.exp(-center)), 1.0e-6, 1.0 - 1.0e-6)
    return wp.vec4(0.3 + softplus(toe), 0.3 + softplus(shoulder), 0.1 + softplus(gamma), middle)


@wp.func
def joint_height(shape: wp.vec4) -> wp.float32:
    """Value at which toe and shoulder meet with one slope, before gamma."""
    toe, shoulder, center = shape[0], shape[1], shape[3]
    return shoulder * center / (toe + (shoulder - toe) * center)


@wp.func
def response(light: wp.float32, shape: wp.vec4, height: wp.float32) -> wp.float32:
    """Two powers that meet at the centre, at that height, to the power of gamma."""
    bounded = wp.clamp(light, 0.0, 1.0)
    toe, shoulder, gamma, center = shape[0], shape[1], shape[2], shape[3]
    value = height * power(quotient(bounded, center), toe)
    if bounded > center:
        value = 1.0 - (1.0 - height) * power(quotient(1.0 - bounded, 1.0 - center), shoulder)
    return power(wp.max(value, 0.0), gamma)


@wp.kernel(enable_backward=False, grid_stride=False)
def apply_srgb(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        for k in range(3):
            value[k] = encode(value[k])
        set_color(target, world, pixel, value)


@wp.kernel(enable_backward=False, grid_stride=False)
def apply_gamma(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    gamma: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    exponent = 1.0 / gamma[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        for k in range(3):
            value[k] = power(wp.clamp(value[k], 0.0, 1.0), exponent)
        set_color(target, world, pixel, value)


@wp.kernel(enable_backward=False, grid_stride=False)
def apply_points(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    points: wp.array2d(dtype=wp.vec2),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    """Straight lines between points; the first and the last go on as they are."""
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        for k in range(3):
            low = wp.int32(0)
            high = wp.int32(points.shape[1] - 1)
            while high - low > 1:
                middle = (low + high) // 2
                if points[world, middle][0] <= value[k]:
                    low = middle
                else:
                    high = middle
            begin = points[world, low]
            end = points[world, high]
            share = wp.clamp((value[k] - begin[0]) / (end[0] - begin[0]), 0.0, 1.0)
            value[k] = wp.lerp(begin[1], end[1], share)
        set_color(target, world, pixel, value)


@wp.kernel(enable_backward=False, grid_stride=False)
def apply_response(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    responses: Responses,
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    red = responses.shapes[world, 0]
    green = responses.shapes[world, 1]
    blue = responses.shapes[world, 2]
    heights = responses.heights[world]
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        value[0] = response(value[0], red, heights[0])
        value[1] = response(value[1], green, heights[1])
        value[2] = response(value[2], blue, heights[2])
        set_color(target, world, pixel, value)


@wp.kernel(enable_backward=False)
def find_shapes(
    toe: wp.array2d(dtype=wp.float32),
    shoulder: wp.array2d(dtype=wp.float32),
    gamma: wp.array2d(dtype=wp.float32),
    center: wp.array2d(dtype=wp.float32),
    responses: Responses,
    first: wp.int32,
):
    world = first + wp.tid()
    heights = wp.vec3()
    for k in range(3):
        shape = response_shape(toe[world, k], shoulder[world, k], gamma[world, k], center[world, k])
        responses.shapes[world, k] = shape
        heights[k] = joint_height(shape)
    responses.heights[world] = heights


@wp.kernel(enable_backward=False, grid_stride=False)
def quantize(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    is_linear: wp.int32,
    bits: wp.array(dtype=wp.float32),
    source: ColorSource,
    target: ColorTarget,
    first: wp.int32,
):
    world, column, top, bottom = color_strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    highest = greatest_number(bits[world])
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = color_at(source, world, pixel)
        for k in range(3):
            display = wp.clamp(value[k], 0.0, 1.0)
            if is_linear != 0:
                display = encode(display)
            value[k] = quotient(wp.floor(display * highest + 0.5), highest)
        set_color(target, world, pixel, value)
