"""Infrared images: the scene's light, dots of a projector, and noise."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View
from warpcam.sensors.kernels.random import Randomness, element_state, two_normals

wp.set_module_options(compiler_flags())

# A point is lit if it lies no farther than this times what the projector sees around its pixel.
REACH = 1.002
TRIES = 16  # of drawing a number, each of which succeeds more often than not


@wp.struct
class Eye:
    """Images of one imager, without a projector but for colours empty."""

    views: wp.array(dtype=View)  # (world,)
    colors: wp.array3d(dtype=wp.uint8)  # (world, pixel, 3) display values
    albedo: wp.array3d(dtype=wp.uint8)  # (world, pixel, 3)
    normals: wp.array3d(dtype=wp.float32)  # (world, pixel, 3) world frame
    depth: wp.array2d(dtype=wp.float32)  # (world, pixel) [m]
    luminance: wp.array(dtype=wp.float32)  # (3 * 256,) share of it, by channel and value


@wp.struct
class Projector:
    """What a projector sees, and the pattern that it sends over all of its view."""

    views: wp.array(dtype=View)  # (world,), or empty: there is none
    depth: wp.array3d(dtype=wp.float32)  # (world, row, column) [m]
    pattern: wp.array2d(dtype=wp.float32)  # (row, column) from 0 to 1


@wp.struct
class InfraredParams:
    """Numbers of each world, (world,)."""

    ambient: wp.array(dtype=wp.float32)  # share of the scene's light that is seen
    intensity: wp.array(dtype=wp.float32)  # light of a dot on a white surface that faces it at 1 m; white is 1
    speckle: wp.array(dtype=wp.float32)  # variance of the factor
    sigma: wp.array(dtype=wp.float32)  # [levels of 255]
    offset: wp.array(dtype=wp.float32)  # [levels of 255]


@wp.func
def luminance_of(
    shares: wp.array(dtype=wp.float32), image: wp.array3d(dtype=wp.uint8), world: wp.int32, pixel: wp.int32
) -> wp.float32:
    total = wp.float32(0.0)
    for c in range(3):
        total += shares[256 * c + wp.int32(image[world, pixel, c])]
    return total


@wp.func
def pattern_at(pattern: wp.array2d(dtype=wp.float32), across: wp.float32, down: wp.float32) -> wp.float32:
    """Value between the middles of pixels, at parts of the pattern's width and height."""
    inside_x = wp.clamp(across * wp.float32(pattern.shape[1]) - 0.5, 0.0, wp.float32(pattern.shape[1] - 1))
    inside_y = wp.clamp(down * wp.float32(pattern.shape[0]) - 0.5, 0.0, wp.float32(pattern.shape[0] - 1))
    column = wp.int32(inside_x)
    row = wp.int32(inside_y)
    right = wp.min(column + 1, pattern.shape[1] - 1)
    below = wp.min(row + 1, pattern.shape[0] - 1)
    part = inside_x - wp.float32(column)
    upper = wp.lerp(pattern[row, column], pattern[row, right], part)
    lower = wp.lerp(pattern[below, column], pattern[below, right], part)
    return wp.lerp(upper, lower, inside_y - wp.float32(row))


@wp.func
def projected_light(projector: Projector, world: wp.int32, point: wp.vec3, normal: wp.vec3) -> wp.float32:
    """Light that a projector of intensity 1 sends to a surface, 0 in the shadow of what it sees before it."""
    view = projector.views[world]
    away = point - view.origin
    local = wp.transpose(view.rotation) * away
    ahead = -local[2]
    if ahead <= 0.0:
        return 0.0
    x = local[0] / (ahead * view.scale[0]) + view.center[0]
    y = view.center[1] - local[1] / (ahead * view.scale[1])
    height = projector.depth.shape[1]
    width = projector.depth.shape[2]
    if not (x >= 0.0 and x < wp.float32(width) and y >= 0.0 and y < wp.float32(height)):
        return 0.0
    # The surface that a pixel sees goes on between the middles of the pixels around.
    farthest = wp.float32(0.0)
    for i in range(3):
        row = wp.clamp(wp.int32(y) + i - 1, 0, height - 1)
        for j in range(3):
            farthest = wp.max(farthest, projector.depth[world, row, wp.clamp(wp.int32(x) + j - 1, 0, width - 1)])
    if ahead > farthest * wp.static(REACH):
        return 0.0
    distance = wp.length(away)
    facing = wp.max(-wp.dot(normal, away) / distance, 0.0)
    light = pattern_at(projector.pattern, x / wp.float32(width), y / wp.float32(height))
    return light * facing / (distance * distance)


@wp.func
def light_of(eye: Eye, projector: Projector, width: wp.int32, world: wp.int32, pixel: wp.int32) -> wp.float32:
    """Light of the dots that one pixel sees of a projector of intensity 1."""
    depth = eye.depth[world, pixel]
    if not (depth > 0.0 and depth < wp.inf):
        return 0.0
    view = eye.views[world]
    row, column = row_and_column(pixel, width)
    x = (wp.float32(column) + 0.5 - view.center[0]) * view.scale[0]
    y = (view.center[1] - wp.float32(row) - 0.5) * view.scale[1]
    ray = view.rotation * wp.vec3(x, y, -1.0)
    normal = wp.vec3(eye.normals[world, pixel, 0], eye.normals[world, pixel, 1], eye.normals[world, pixel, 2])
    if wp.dot(normal, ray) > 0.0:
        normal = -normal
    light = projected_light(projector, world, view.origin + depth * ray, normal)
    if light > 0.0:
        light *= luminance_of(eye.luminance, eye.albedo, world, pixel)
    return light


@wp.func
def with_noise(
    level: wp.float32,
    params: InfraredParams,
    randomness: Randomness,
    world: wp.int32,
    pixel: wp.int32,
) -> wp.float32:
    """Multiply by a number of a gamma distribution of mean 1, and add one of a normal distribution.

    Gamma by Marsaglia and Tsang, "A Simple Method for Generating Gamma Variables", 2000.
    """
    z, thermal, state = two_normals(element_state(randomness, world, pixel))
    factor = wp.float32(1.0)
    if params.speckle[world] > 0.0:
        shape = wp.max(1.0 / params.speckle[world], 1.0)
        d = shape - 1.0 / 3.0
        c = 1.0 / wp.sqrt(9.0 * d)
        tries = wp.int32(0)
        while tries < wp.static(TRIES):
            u = 1.0 - wp.randf(state)
            v = (1.0 + c * z) * (1.0 + c * z) * (1.0 + c * z)
            taken = v > 0.0 and u < 1.0 - 0.0331 * z * z * z * z  # as most are, without a logarithm
            if v > 0.0 and not taken:
                taken = wp.log(u) < 0.5 * z * z + d - d * v + d * wp.log(v)
            if taken:
                factor = d * v / shape
                tries = wp.static(TRIES)
            else:
                tries += 1
                z = wp.randn(state)
    return level * factor + params.offset[world] + params.sigma[world] * thermal


@wp.kernel(enable_backward=False)
def see_infrared(
    mask: wp.array(dtype=wp.uint8),
    eye: Eye,
    projector: Projector,
    params: InfraredParams,
    randomness: Randomness,
    width: wp.int32,
    has_noise: wp.int32,
    image: wp.array2d(dtype=wp.uint8),
    run: wp.int32,
    first: wp.int32,
):
    """Write pixels, as many one after another as ``run`` says."""
    pixels = image.shape[1]
    world, part = row_and_column(first + wp.tid(), (pixels + run - 1) // run)
    if mask[world] == wp.uint8(0):
        return
    begin = part * run
    for pixel in range(begin, wp.min(begin + run, pixels)):
        light = params.ambient[world] * luminance_of(eye.luminance, eye.colors, world, pixel)
        if projector.views.shape[0] > 0:
            light += params.intensity[world] * light_of(eye, projector, width, world, pixel)
        level = wp.clamp(255.0 * light, 0.0, 255.0)
        if has_noise != 0:
            level = with_noise(level, params, randomness, world, pixel)
        image[world, pixel] = wp.uint8(wp.clamp(level + 0.5, 0.0, 255.0))
