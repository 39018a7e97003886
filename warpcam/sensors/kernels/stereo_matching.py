"""Stages of stereo matching: census, costs, paths, disparities and their checks, and depth."""

from collections.abc import Sequence

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View

wp.set_module_options(compiler_flags())

MAX_DISPARITIES = 256  # as in native/sensors/matching_costs.h
TEAM = 32  # threads of a CUDA block that work on a line together
ALONG_ROWS, ALONG_COLUMNS, ALONG_FALLING_DIAGONALS, ALONG_RISING_DIAGONALS = range(4)


@wp.struct
class Matcher:
    """Two images of some worlds on their way to disparities."""

    width: wp.int32  # of an image [pixels]
    height: wp.int32
    disparities: wp.int32  # a multiple of 16, at most MAX_DISPARITIES
    bits: wp.int32  # of a census word, at most 31
    contrast: wp.int32  # of a census window, without which a pixel has no disparity [levels]
    census_radius_x: wp.int32
    census_radius_y: wp.int32
    block_radius_x: wp.int32
    block_radius_y: wp.int32
    p1: wp.int32  # for a whole block
    p2: wp.int32
    uniqueness: wp.int32  # [%]
    is_equiangular: wp.int32  # two lines, and no parabola, run through three costs
    max_difference: wp.int32  # of the two images' disparities, -1: they are not compared
    median: wp.int32  # pixels of a side
    left: wp.array2d(dtype=wp.uint32)  # (world, pixel) census words
    right: wp.array2d(dtype=wp.uint32)
    costs: wp.array2d(dtype=wp.uint16)  # (world, pixel * disparities)
    totals: wp.array2d(dtype=wp.uint16)  # likewise: sums along the rows of blocks, then sums over all paths
    found: wp.array2d(dtype=wp.float32)  # (world, pixel) disparities of the left image [pixels], -1 for none
    found_right: wp.array2d(dtype=wp.int32)  # of the right one
    checked: wp.array2d(dtype=wp.float32)  # of the left one, those on which both images agree


@wp.struct
class MeasuredDepth:
    """Results of some worlds, and what makes depth of a disparity."""

    views: wp.array(dtype=View)  # (world,) of the left imager
    baseline: wp.array(dtype=wp.float32)  # (world,) [m]
    min_depth: wp.array(dtype=wp.float32)  # (world,) [m]
    max_depth: wp.array(dtype=wp.float32)
    depth: wp.array2d(dtype=wp.float32)  # (world, pixel) [m], 0 for none
    disparity: wp.array2d(dtype=wp.float32)  # (world, pixel) [pixels], 0 for none


take_census = make_kernel(
    "take_census",
    "warpcam::take_census(mask, matcher, images, words, index);",
    {
        "mask": wp.array(dtype=wp.uint8),
        "matcher": Matcher,
        "images": wp.array2d(dtype=wp.uint8),
        "words": wp.array2d(dtype=wp.uint32),
    },
    native_module("sensors/census.h"),
)
sum_rows = make_kernel(
    "sum_rows",
    "warpcam::sum_matching_rows(mask, matcher, index);",
    {"mask": wp.array(dtype=wp.uint8), "matcher": Matcher},
    native_module("sensors/matching_costs.h"),
)
sum_columns = make_kernel(
    "sum_columns",
    "warpcam::sum_matching_columns(mask, matcher, index);",
    {"mask": wp.array(dtype=wp.uint8), "matcher": Matcher},
    native_module("sensors/matching_costs.h"),
)
add_paths = make_kernel(
    "add_paths",
    "warpcam::add_matching_paths(mask, matcher, axis, index);",
    {"mask": wp.array(dtype=wp.uint8), "matcher": Matcher, "axis": wp.int32},
    native_module("sensors/matching_paths.h"),
)
choose = make_kernel(
    "choose",
    "warpcam::choose_disparities(mask, matcher, index);",
    {"mask": wp.array(dtype=wp.uint8), "matcher": Matcher},
    native_module("sensors/disparities.h"),
)
finish = make_kernel(
    "finish",
    "warpcam::measure_depth(mask, matcher, out, index);",
    {"mask": wp.array(dtype=wp.uint8), "matcher": Matcher, "out": MeasuredDepth},
    native_module("sensors/disparities.h"),
)


@wp.kernel(enable_backward=False)
def compare_images(mask: wp.array(dtype=wp.uint8), matcher: Matcher, first: wp.int32):
    """Keep disparities of the left image where the pixel of the right one that they lead to has nearly the same."""
    world, pixel = row_and_column(first + wp.tid(), matcher.found.shape[1])
    if mask[world] == wp.uint8(0):
        return
    disparity = matcher.found[world, pixel]
    if disparity >= 0.0 and matcher.max_difference >= 0:
        whole = wp.int32(disparity + 0.5)
        column = pixel % matcher.width
        if whole > column or wp.abs(whole - matcher.found_right[world, pixel - whole]) > matcher.max_difference:
            disparity = wp.float32(-1.0)
    matcher.checked[world, pixel] = disparity


def bind_matching(
    mask: wp.array,
    matcher: Matcher,
    images: Sequence[wp.array],
    out: MeasuredDepth,
    axes: int,
    device: wp.Device,
) -> list[Stage]:
    """Bind the stages from two images, left and right, uint8 (world, pixel), to depth.

    Args:
        mask: uint8, (world,); worlds with 0 are left alone.
        matcher: Settings and scratch memory of as many worlds.
        images: Of the two imagers.
        out: Results.
        axes: Lines along which costs are added up, there and back: 2, or 4 with the diagonals.
        device: Where all of these lie.
    """
    worlds, pixels = images[0].shape
    width, height = matcher.width, matcher.height
    team, places = (TEAM, pixels) if device.is_cuda else (1, height)
    lines = (height, width, width + height - 1, width + height - 1)

    def bind(kernel: wp.Kernel, threads: int, *inputs: object) -> Stage:
        return bind_launch(kernel, worlds * threads, [mask, matcher, *inputs], device)

    return [
        bind(take_census, places, images[0], matcher.left),
        bind(take_census, places, images[1], matcher.right),
        bind(sum_rows, team * height),
        bind(sum_columns, team * width),
        *(bind(add_paths, team * lines[axis], axis) for axis in range(axes)),
        bind(choose, pixels),
        bind(compare_images, pixels),
        bind(finish, pixels, out),
    ]
