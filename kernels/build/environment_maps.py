"""Maps of images of light: mipmaps, and what lobes of rising roughness see. See native/shading/environment_map.h."""

import functools
import math

import numpy as np
import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import bind_launch, run

LEAST_SIDE, MOST_SIDE, LAST_SIDE = 512, 1024, 16  # of the first level, and of the last one
MAX_LEVELS = 8  # MAX_MAP_LEVELS of native/shading/environment_map.h
SIDE, LEVELS, MIPS = 4, 5, 6  # EnvironmentLayout there: texels, width, height, sums come first
LOBES = MIPS + MAX_LEVELS
SUN = LOBES + MAX_LEVELS
NUMBERS = SUN + 5
NO_SUN = (0.0, 0.0, 1.0, 2.0, 0.0)  # of a layout, from SUN on: direction, cosine, luminance
HALVE, FILTER = 0, -1  # in place of a number of parts: see build_environment() of native/build/environment_builder.h


@functools.cache
def _kernel() -> wp.Kernel:
    return make_kernel(
        "build_environment",
        "warpcam::build_environment(source, width, height, texels, layouts, image, number, parts, index);",
        {
            "source": wp.array(dtype=wp.vec4),
            "width": wp.int32,
            "height": wp.int32,
            "texels": wp.array(dtype=wp.vec4),
            "layouts": wp.array(dtype=wp.int32),
            "image": wp.int32,
            "number": wp.int32,
            "parts": wp.int32,
        },
        native_module("build/environment_builder.h"),
    )


def map_side(height: int) -> int:
    """Side of the first level for an image of so many rows: its texels are no larger than the image's."""
    wanted = 2.0 * height / math.pi
    return min(max(1 << max(math.ceil(math.log2(wanted)), 0), LEAST_SIDE), MOST_SIDE)


def lay_out(side: int, start: int) -> tuple[np.ndarray, int]:
    """Return the numbers of a layout from SIDE on, int32, for maps that begin at the texel ``start``, and their end."""
    levels = (side // LAST_SIDE).bit_length()
    numbers = np.zeros(NUMBERS - SIDE, np.int32)
    numbers[0], numbers[1] = side, levels
    numbers[SUN - SIDE :] = np.array(NO_SUN, np.float32).view(np.int32)
    for place, first in ((MIPS, 0), (LOBES, 1)):
        for level in range(first, levels):
            numbers[place - SIDE + level] = start
            start += _padded(side >> level)
    return numbers, start


def build_environment_maps(
    source: wp.array,
    size: tuple[int, int],
    texels: wp.array,
    layouts: wp.array,
    image: int,
    device: wp.Device,
    lobes: bool = True,
) -> None:
    """Write the maps of one image.

    Args:
        source: vec4, (height * width,): the image, linear radiance by longitude and latitude.
        size: Its height and width.
        texels: vec4, (texel,): of all maps; those of the image are written.
        layouts: int32, (image * NUMBERS,): where they are.
        image: Its number.
        device: Where the arrays lie.
        lobes: False writes the mipmaps alone.
    """
    height, width = size
    side = map_side(height)
    levels = (side // LAST_SIDE).bit_length()
    parts = max(math.ceil(4.0 * height / (math.pi * side)), 2)  # places of a texel that are half a texel of the image
    steps = [
        (0, parts),
        *((level, HALVE) for level in range(1, levels)),
        *((level, FILTER) for level in range(1, levels if lobes else 1)),
    ]
    run(
        [
            bind_launch(
                _kernel(), _padded(side >> level), [source, width, height, texels, layouts, image, level, what], device
            )
            for level, what in steps
        ]
    )


def _padded(side: int) -> int:
    """Texels of a level, with those around it."""
    return (side + 2) ** 2
