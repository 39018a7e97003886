"""Loss of JPEG: steps of quantisation, and blocks of 8 x 8 numbers by native code."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.indices import row_and_column
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.sensors.kernels.color_images import ColorSource, ColorTarget

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


def _coder(image: str, scale: int, colors: str, kind: Any) -> wp.Kernel:
    """Kernel of native/sensors/jpeg_blocks.h for chroma that is ``scale`` times smaller: a thread a block, or LANES."""
    return make_kernel(
        f"code_{image}_{scale}",
        f"warpcam::code_jpeg_{image}<{scale}>(mask, image, {colors}, index);",
        {"mask": wp.array(dtype=wp.uint8), "image": CodedImage, colors: kind},
        native_module("sensors/jpeg_blocks.h"),
    )


# They write luma and code chroma of a source; and code luma and write colours of it with the chroma.
code_full_chroma, code_half_chroma = (_coder("chroma", scale, "source", ColorSource) for scale in (1, 2))
code_full_luma, code_half_luma = (_coder("luma", scale, "target", ColorTarget) for scale in (1, 2))
