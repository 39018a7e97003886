"""The stage that puts the image of light from all around in its place in each world, once a frame."""

import math
from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import SKY_TERMS

wp.set_module_options(compiler_flags())

ROWS = 4  # ENVIRONMENT_ROWS of native/shading/environment_map.h
TERMS = wp.constant(SKY_TERMS)
RADIANS = wp.constant(math.pi / 180.0)
MOST = wp.constant(1.0e18)  # numbers whose squares are finite


@wp.struct
class PlacedEnvironments:
    """Which image each world has, and how it stands there."""

    index: wp.array(dtype=wp.int32)  # (world,) number of the image; others than those there are: none
    yaw: wp.array(dtype=wp.float32)  # (world,) about the image's own upright axis, to the left [degrees]
    rotation: wp.array(dtype=wp.vec4)  # (world,) then from the image's axes to the world's, quaternion wxyz
    intensity: wp.array(dtype=wp.vec3)  # (world,) factors of red, green and blue
    terms: wp.array2d(dtype=wp.vec3)  # (image, SKY_TERMS) in the image's axes: native/shading/environment.h


@wp.func
def rotated_form(turn: wp.mat33, xy: float, yz: float, zz: float, xz: float, difference: float):
    """The terms of xy, yz, 3z^2 - 1, xz and x^2 - y^2 in another frame, as a symmetric matrix."""
    form = wp.mat33(
        difference - zz, 0.5 * xy, 0.5 * xz, 0.5 * xy, -difference - zz, 0.5 * yz, 0.5 * xz, 0.5 * yz, 2.0 * zz
    )
    return turn * form * wp.transpose(turn)


@wp.func
def rotate_terms(
    terms: wp.array2d(dtype=wp.vec3),
    image: wp.int32,
    turn: wp.mat33,
    gain: wp.vec3,
    sky: wp.array2d(dtype=wp.vec3),
    world: wp.int32,
):
    """Write a world's sky from an image's terms."""
    for channel in range(3):
        factor = gain[channel]
        sky[world, 0][channel] = factor * terms[image, 0][channel]
        along = turn * wp.vec3(terms[image, 1][channel], terms[image, 2][channel], terms[image, 3][channel])
        for axis in range(3):
            sky[world, 1 + axis][channel] = factor * along[axis]
        form = rotated_form(
            turn,
            terms[image, 4][channel],
            terms[image, 5][channel],
            terms[image, 6][channel],
            terms[image, 7][channel],
            terms[image, 8][channel],
        )
        sky[world, 4][channel] = factor * 2.0 * form[0, 1]
        sky[world, 5][channel] = factor * 2.0 * form[1, 2]
        sky[world, 6][channel] = factor * 0.5 * form[2, 2]
        sky[world, 7][channel] = factor * 2.0 * form[0, 2]
        sky[world, 8][channel] = factor * 0.5 * (form[0, 0] - form[1, 1])


@wp.kernel(enable_backward=False)
def place_environments(
    placed: PlacedEnvironments, rows: wp.array2d(dtype=wp.vec4), sky: wp.array2d(dtype=wp.vec3), first: wp.int32
):
    world = first + wp.tid()
    image = placed.index[world]
    given = placed.rotation[world]
    yaw = placed.yaw[world]
    factors = placed.intensity[world]
    gain = wp.max(factors, wp.vec3(0.0))
    length = wp.length(given)
    finite = length > 0.0 and length < MOST and wp.abs(yaw) < MOST and wp.length(factors) < MOST
    sky[world, TERMS] = wp.vec3(0.0)
    if finite and image >= 0 and image < placed.terms.shape[0]:
        unit = given / length
        own = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), RADIANS * yaw)
        turn = wp.quat_to_matrix(wp.quat(unit[1], unit[2], unit[3], unit[0]) * own)
        for axis in range(3):
            rows[world, axis] = wp.vec4(turn[0, axis], turn[1, axis], turn[2, axis], float(image))
        rows[world, 3] = wp.vec4(gain[0], gain[1], gain[2], 0.0)
        rotate_terms(placed.terms, image, turn, gain, sky, world)
    else:
        for row in range(4):
            rows[world, row] = wp.vec4(0.0, 0.0, 0.0, -1.0)
        for term in range(TERMS):
            sky[world, term] = wp.vec3(0.0)


def bind_environments(placed: Any, rows: wp.array, sky: wp.array, device: wp.Device) -> Stage:
    """Bind the stage.

    Args:
        placed: PlacedEnvironments.
        rows: vec4, (world, ROWS); written: EnvironmentMaps.rows.
        sky: vec3, (world, SKY_TERMS + 1); written: Physical.sky.
        device: Where all of these lie.
    """
    return bind_launch(place_environments, sky.shape[0], [placed, rows, sky], device)
