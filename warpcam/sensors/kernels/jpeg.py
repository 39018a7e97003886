"""Loss of JPEG: steps of quantisation, and blocks of 8 x 8 numbers by native code."""

import functools

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.kernels import make_kernel

wp.set_module_options(compiler_flags())

LANES = 8  # threads of CUDA that work on a block


@wp.struct
class CodedImage:
    """Images of some worlds on their way through blocks."""

    width: wp.int32  # [pixels]
    height: wp.int32
    luma_across: wp.int32  # [blocks]
    luma_down: wp.int32
    chroma_across: wp.int32  # [blocks]
    chroma_down: wp.int32
    is_linear: wp.int32  # colours are linear light
    bytes_of_light: wp.array(dtype=wp.int32)  # see ``curves.byte_table``
    steps: wp.array2d(dtype=wp.float32)  # (world, 128) of luma and chroma, row by row
    luma: wp.array2d(dtype=wp.uint8)  # (world, pixel) before it is coded
    chroma: wp.array2d(dtype=wp.vec2ub)  # (world, pixel of whole blocks) coded: to blue and to red


@wp.kernel(enable_backward=False, grid_stride=False)
def find_steps(
    mask: wp.array(dtype=wp.uint8),
    tables: wp.array(dtype=wp.float32),
    quality: wp.array(dtype=wp.float32),
    steps: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Steps of a quality, as libjpeg scales the tables."""
    world, entry = row_and_column(first + wp.tid(), tables.shape[0])
    if mask[world] == wp.uint8(0):
        return
    exact = wp.clamp(wp.floor(quality[world] + 0.5), 1.0, 100.0)
    percent = wp.where(exact < 50.0, wp.floor(5000.0 / exact), 200.0 - 2.0 * exact)
    steps[world, entry] = wp.clamp(wp.floor((tables[entry] * percent + 50.0) / 100.0), 1.0, 255.0)


@functools.cache
def code_chroma(scale: int) -> wp.Kernel:
    """Kernel that writes luma, and codes chroma of images that are ``scale`` times smaller.

    A block has a thread, on CUDA LANES.
    """
    return make_kernel(
        f"code_chroma_{scale}",
        f"warpcam::code_jpeg_chroma<{scale}>(mask, image, source, index);",
        {"mask": wp.array(dtype=wp.uint8), "image": CodedImage, "source": wp.array2d(dtype=wp.vec3)},
        native_module("sensors/jpeg_blocks.h"),
    )


@functools.cache
def code_luma(scale: int) -> wp.Kernel:
    """Kernel that codes luma, and writes colours of it with the chroma; likewise."""
    return make_kernel(
        f"code_luma_{scale}",
        f"warpcam::code_jpeg_luma<{scale}>(mask, image, target, index);",
        {"mask": wp.array(dtype=wp.uint8), "image": CodedImage, "target": wp.array2d(dtype=wp.vec3)},
        native_module("sensors/jpeg_blocks.h"),
    )
