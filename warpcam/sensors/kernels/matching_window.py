"""Pixels of a depth image whose surroundings have about the same disparity: native/sensors/matching_window.h."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View

SIDE = 32  # pixels across and down of a tile, which a block of CUDA or a thread of a CPU works on
THREADS = 256  # of such a block
MAX_RADIUS = 15  # of a window [pixels]


@wp.struct
class MatchingRule:
    """Numbers of each world, (world,), and the size of the window."""

    views: wp.array(dtype=View)
    baseline: wp.array(dtype=wp.float32)  # [m]
    tolerance: wp.array(dtype=wp.float32)  # [pixels]
    share: wp.array(dtype=wp.float32)  # of the window
    focal: wp.array(dtype=wp.float32)  # [pixels], or 0
    radius: wp.int32  # [pixels]


keep_matches = make_kernel(
    "keep_matches",
    "warpcam::keep_matches(mask, width, height, rule, source, target, index);",
    {
        "mask": wp.array(dtype=wp.uint8),
        "width": wp.int32,
        "height": wp.int32,
        "rule": MatchingRule,
        "source": wp.array2d(dtype=wp.float32),
        "target": wp.array2d(dtype=wp.float32),
    },
    native_module("sensors/matching_window.h", THREADS),
)


def bind_matches(width: int, height: int, mask: wp.array, rule: Any, source: wp.array, target: wp.array) -> Stage:
    """Bind ``keep_matches`` for images (world, pixel) of that many pixels across and down."""
    tiles = len(mask) * -(-width // SIDE) * -(-height // SIDE)
    threads = THREADS if mask.device.is_cuda else 1
    inputs = [mask, width, height, rule, source, target]
    return bind_launch(keep_matches, tiles * threads, inputs, mask.device, block_dim=THREADS)
