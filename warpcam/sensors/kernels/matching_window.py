"""Pixels of a depth image whose surroundings have about the same disparity: native/sensors/matching_window.h."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View

SIDE = 32  # pixels across and down of a tile, which a block of CUDA or a thread of a CPU works on
THREADS = 256  # of such a block
BLOCKS = 5  # that a multiprocessor is to hold
USUAL_RADIUS = 4  # of windows that have a kernel of their own [pixels]
RADII = (7, 15)  # greatest of other windows that a kernel has room for
MAX_RADIUS = RADII[-1]
BUSY_BLOCKS = 4096  # that keep a GPU busy; blocks take several tiles where there are more


@wp.struct
class MatchingRule:
    """Numbers of each world, (world,), and the size of the window."""

    views: wp.array(dtype=View)
    baseline: wp.array(dtype=wp.float32)  # [m]
    tolerance: wp.array(dtype=wp.float32)  # [pixels]
    share: wp.array(dtype=wp.float32)  # of the window
    focal: wp.array(dtype=wp.float32)  # [pixels], or 0
    radius: wp.int32  # [pixels]


def _keeper(most: int, is_fixed: bool) -> wp.Kernel:
    """The kernel for windows of that radius, or of at most that radius."""
    kinds = f"{most}, {str(is_fixed).lower()}"
    return make_kernel(
        f"keep_matches_{most}",
        f"warpcam::keep_matches<{kinds}>(mask, width, height, run, rule, source, target, index);",
        {
            "mask": wp.array(dtype=wp.uint8),
            "width": wp.int32,
            "height": wp.int32,
            "run": wp.int32,
            "rule": MatchingRule,
            "source": wp.array2d(dtype=wp.float32),
            "target": wp.array2d(dtype=wp.float32),
        },
        native_module("sensors/matching_window.h", THREADS),
        launch_bounds=(THREADS, BLOCKS),
    )


keep_matches = {most: _keeper(most, most == USUAL_RADIUS) for most in (USUAL_RADIUS, *RADII)}


def bind_matches(width: int, height: int, mask: wp.array, rule: Any, source: wp.array, target: wp.array) -> Stage:
    """Bind the kernel that keeps matches in images (world, pixel) of that many pixels across and down."""
    tiles, worlds = -(-width // SIDE) * -(-height // SIDE), len(mask)
    run = min(max(worlds * tiles // BUSY_BLOCKS, 1), tiles) if mask.device.is_cuda else 1
    blocks, threads = worlds * -(-tiles // run), THREADS if mask.device.is_cuda else 1
    radius = rule.radius
    kernel = keep_matches[radius if radius == USUAL_RADIUS else next(most for most in RADII if most >= radius)]
    inputs = [mask, width, height, run, rule, source, target]
    return bind_launch(kernel, blocks * threads, inputs, mask.device, block_dim=THREADS)
