"""Building the 4-wide tree over boxes: ``native/build/box_builder.h`` as a kernel of one CPU thread."""

import numpy as np
import warp as wp

from warpcam.kernels.build.bvh4 import SCRATCH, builder_options, run_builder
from warpcam.kernels.runtime.compile import building
from warpcam.kernels.runtime.kernels import make_kernel

_build = make_kernel(
    "build_boxes",
    """
#if !defined(__CUDA_ARCH__)
    warpcam::bvh4_build::Size size =
        warpcam::bvh4_build::build_boxes(boxes.data, count, scratch.data, nodes.data, order.data);
    sizes.data[0] = size.nodes;
#endif
""",
    {
        "boxes": wp.array(dtype=wp.float32),
        "count": wp.int32,
        "scratch": wp.array(dtype=wp.int32),
        "nodes": wp.array(dtype=wp.float32),
        "order": wp.array(dtype=wp.int32),
        "sizes": wp.array(dtype=wp.int32),
    },
    builder_options("box_builder.h"),
)


def build(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Build the tree over boxes, on one core.

    Args:
        lower: (box, 3) float32, finite; at least one box.
        upper: (box, 3) float32.

    Returns:
        Node rows (7 * node, 4) float32, as ``accel.bvh4.Bvh4`` has them, whose leaves count places in the second: the
        boxes in leaf order, (box,) int32.
    """
    count = len(lower)
    boxes = np.ascontiguousarray(np.concatenate((lower, upper), axis=1), np.float32)
    nodes = np.empty((7 * count, 4), np.float32)
    order = np.empty(count, np.int32)
    sizes = np.zeros(1, np.int32)
    scratch = np.empty(count * SCRATCH // 4, np.int32)

    with building:
        run_builder(_build, boxes, count, scratch, nodes, order, sizes)
    return nodes[: 7 * sizes[0]].copy(), order
