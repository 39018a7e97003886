"""Depth of field: circles of confusion, and the light that they bring to a pixel."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.types import View

wp.set_module_options(compiler_flags())

TILE = 8  # width and height of a tile [pixels]
SHARP = 0.5  # a circle of this radius or less stays in its pixel [pixels]
SAME_LAYER = 0.5  # pixels whose signed radii differ by less blur as one surface [pixels]


@wp.struct
class ThinLens:
    """A lens in each world."""

    focus_distance: wp.array(dtype=wp.float32)  # (world,) from the lens to what is sharp [m]
    f_number: wp.array(dtype=wp.float32)  # (world,) focal length over diameter of the aperture
    focal_length: wp.array(dtype=wp.float32)  # (world,) [m]
    max_radius: wp.float32  # of a circle [pixels]


@wp.struct
class Circles:
    """Circles of confusion of an image."""

    # (world, pixel) signed radius, negative before the focus [pixels], and 1 over the area of the circle [1 / pixels]
    circle: wp.array2d(dtype=wp.vec2)
    largest: wp.array2d(dtype=wp.float32)  # (world, tile) of the radii in it
    reach: wp.array2d(dtype=wp.float32)  # (world, tile) of the radii whose circles touch it
    width: wp.int32  # of the image [pixels]
    height: wp.int32


@wp.func
def area_of(radius: wp.float32) -> wp.float32:
    """Area of a disc whose rim is one pixel wide, or of a pixel that keeps its light [pixels]."""
    return wp.where(wp.abs(radius) > SHARP, wp.pi * (radius * radius + 1.0 / 12.0), 1.0)


@wp.kernel(enable_backward=False)
def find_circles(
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    lens: ThinLens,
    depth: wp.array2d(dtype=wp.float32),
    circles: Circles,
    first: wp.int32,
):
    """Find the signed radius of each pixel's circle of confusion."""
    world, pixel = row_and_column(first + wp.tid(), depth.shape[1])
    if mask[world] == wp.uint8(0):
        return
    focus = lens.focus_distance[world]
    focal = lens.focal_length[world]
    scale = views[world].scale
    pixels = 1.0 / wp.sqrt(scale[0] * scale[1])  # focal length
    away = wp.float32(1.0)  # (d - d_f) / d, of what is infinitely far
    if depth[world, pixel] > 0.0:
        away -= focus / depth[world, pixel]
    diameter = focal / lens.f_number[world] * pixels * away / wp.max(focus - focal, 0.0)
    radius = wp.clamp(0.5 * diameter, -lens.max_radius, lens.max_radius)
    if wp.isnan(diameter):
        radius = 0.0
    circles.circle[world, pixel] = wp.vec2(radius, 1.0 / area_of(radius))


@wp.kernel(enable_backward=False)
def find_largest(mask: wp.array(dtype=wp.uint8), circles: Circles, first: wp.int32):
    """Find the largest radius of each tile."""
    world, tile = row_and_column(first + wp.tid(), circles.largest.shape[1])
    if mask[world] == wp.uint8(0):
        return
    top, left = row_and_column(tile, (circles.width + TILE - 1) // TILE)
    largest = wp.float32(0.0)
    for row in range(top * TILE, wp.min((top + 1) * TILE, circles.height)):
        for column in range(left * TILE, wp.min((left + 1) * TILE, circles.width)):
            largest = wp.max(largest, wp.abs(circles.circle[world, row * circles.width + column][0]))
    circles.largest[world, tile] = largest


@wp.kernel(enable_backward=False)
def find_reach(mask: wp.array(dtype=wp.uint8), max_radius: wp.float32, circles: Circles, first: wp.int32):
    """Find the largest radius among those that bring light to each tile."""
    world, tile = row_and_column(first + wp.tid(), circles.reach.shape[1])
    if mask[world] == wp.uint8(0):
        return
    across = (circles.width + TILE - 1) // TILE
    down = (circles.height + TILE - 1) // TILE
    top, left = row_and_column(tile, across)
    tiles = wp.int32(wp.ceil((max_radius + 0.5) / wp.float32(TILE)))
    reach = wp.float32(0.0)
    for row in range(wp.max(top - tiles, 0), wp.min(top + tiles + 1, down)):
        for column in range(wp.max(left - tiles, 0), wp.min(left + tiles + 1, across)):
            rows = wp.float32(wp.max((wp.abs(row - top) - 1) * TILE + 1, 0))  # between the nearest pixels of both
            columns = wp.float32(wp.max((wp.abs(column - left) - 1) * TILE + 1, 0))
            largest = circles.largest[world, row * across + column]
            if rows * rows + columns * columns < (largest + 0.5) * (largest + 0.5):
                reach = wp.max(reach, largest)
    circles.reach[world, tile] = reach


@wp.func
def covered(radius: wp.float32, square: wp.float32) -> wp.float32:
    """Part of a pixel, at a distance given by its square, that a disc with a rim of one pixel covers [pixels]."""
    return wp.clamp(wp.max(wp.abs(radius), SHARP) + 0.5 - wp.sqrt(square), 0.0, 1.0)


@wp.kernel(enable_backward=False)
def gather_light(
    mask: wp.array(dtype=wp.uint8),
    circles: Circles,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Collect the light of all pixels whose circles touch a pixel.

    What is nearer than the pixel's own surface lies over it and covers it by the sum of its shares. Below is the mean
    of the rest: the own surface, which spreads by its circles, and what is farther, which the own surface lets through
    within the pixel's own circle, so that nothing farther runs over a sharp surface.
    """
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    row, column = row_and_column(pixel, circles.width)
    reach = circles.reach[world, row // TILE * ((circles.width + TILE - 1) // TILE) + column // TILE]
    if reach <= SHARP:
        target[world, pixel] = source[world, pixel]
        return
    own = circles.circle[world, pixel]
    over = wp.vec3()
    cover = wp.float32(0.0)
    rest = wp.vec3()
    weights = wp.float32(0.0)
    limit = (reach + 0.5) * (reach + 0.5)
    rows = wp.int32(reach + 0.5)
    for i in range(wp.max(row - rows, 0), wp.min(row + rows + 1, circles.height)):
        down = wp.float32((i - row) * (i - row))
        columns = wp.int32(wp.sqrt(wp.max(limit - down, 0.0)))
        for j in range(wp.max(column - columns, 0), wp.min(column + columns + 1, circles.width)):
            other = i * circles.width + j
            circle = circles.circle[world, other]
            square = down + wp.float32((j - column) * (j - column))
            if circle[0] > own[0] + SAME_LAYER:
                circle = own
            share = covered(circle[0], square) * circle[1]
            if share > 0.0:
                light = share * source[world, other]
                if circle[0] < own[0] - SAME_LAYER:
                    over += light
                    cover += share
                else:
                    rest += light
                    weights += share
    result = rest / weights
    if cover > 0.0:
        result = wp.lerp(result, over / cover, wp.min(cover, 1.0))
    target[world, pixel] = result
