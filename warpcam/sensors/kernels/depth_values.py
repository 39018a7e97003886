"""Depth values, rays and focal lengths, as kernels of depth cameras read them."""

import warp as wp

from warpcam.kernels.types import View

LEAST_SLOPE = 0.017453292  # between a ray and the surface that it meets, where a formula divides by it [rad]


@wp.func
def is_measured(depth: wp.float32) -> wp.bool:
    """False for 0, infinity and NaN, which are no measurement."""
    return depth > 0.0 and depth < wp.inf


@wp.func
def focal_length(given: wp.float32, view: View) -> wp.float32:
    """Focal length across [pixels]: the given one, or that of the view where it is 0; NaN where the given one is."""
    return wp.where(given <= 0.0, 1.0 / view.scale[0], given)


@wp.func
def resolution(across: wp.float32, down: wp.float32, view: View) -> wp.vec2:
    """Pixels of the view across and down for each pixel of a sensor with the given focal lengths [pixels].

    That down is equal to that across where it is 0. 1 where neither is given; NaN where what is given is NaN.
    """
    focal_y = wp.where(down <= 0.0, across, down)
    return wp.vec2(
        wp.where(across <= 0.0, 1.0, 1.0 / (view.scale[0] * across)),
        wp.where(focal_y <= 0.0, 1.0, 1.0 / (view.scale[1] * focal_y)),
    )


@wp.func
def not_negative(sigma: wp.float32) -> wp.float32:
    """The number, or 0 where it is below; NaN stays, which ``wp.max`` takes for 0."""
    return wp.where(sigma < 0.0, 0.0, sigma)


@wp.func
def happens(draw: wp.float32, probability: wp.float32) -> wp.bool:
    """Whether a draw from [0, 1) is below a probability; always if that is NaN."""
    return not (draw >= probability)


@wp.func
def incidence(
    view: View, normals: wp.array4d(dtype=wp.float32), world: wp.int32, row: wp.int32, column: wp.int32
) -> wp.float32:
    """Angle between a pixel's ray, turned around, and the normal of the surface that it meets [rad].

    0 where it meets none: its depth is then a neighbour's, of an earlier lookup, or of what has no normal.
    """
    x = (wp.float32(column) + 0.5 - view.center[0]) * view.scale[0]
    y = (view.center[1] - wp.float32(row) - 0.5) * view.scale[1]
    ray = wp.normalize(view.rotation * wp.vec3(x, y, -1.0))
    normal = wp.vec3(normals[world, row, column, 0], normals[world, row, column, 1], normals[world, row, column, 2])
    facing = wp.where(wp.length_sq(normal) > 0.0, -wp.dot(ray, normal), 1.0)
    return wp.acos(wp.clamp(facing, 0.0, 1.0))


@wp.func
def grazing_ratio(angle: wp.float32) -> wp.float32:
    """``angle / (pi / 2 - angle)``, of at most 89 degrees."""
    return angle / wp.max(wp.HALF_PI - angle, LEAST_SLOPE)


@wp.func
def cell_side(size: wp.float32) -> wp.int32:
    """Side of the square cells of an image [pixels]: ``size``, rounded, and at least 1."""
    return wp.max(wp.int32(size + 0.5), 1)


@wp.func
def cell_of(row: wp.int32, column: wp.int32, width: wp.int32, side: wp.int32) -> wp.int32:
    """Number of the square cell of an image that a pixel lies in."""
    if side == 1:
        return row * width + column
    return (row // side) * width + column // side
