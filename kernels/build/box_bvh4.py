"""Building the 4-wide tree over boxes: ``native/build/box_builder.h`` as a kernel of one CPU thread."""

import numpy as np
import warp as wp

from warpcam.kernels.build.bvh4 import SCRATCH, builder_options


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    warpcam::bvh4_build::Size size =
        warpcam::bvh4_build::build_boxes(boxes.data, count, scratch.data, nodes.data, order.data);
    sizes.data[0] = size.nodes;
#endif
""")
def _build(
    boxes: wp.array(dtype=wp.float32),
    count: wp.int32,
    scratch: wp.array(dtype=wp.int32),
    nodes: wp.array(dtype=wp.float32),
    order: wp.array(dtype=wp.int32),
    sizes: wp.array(dtype=wp.int32),
): ...


@wp.kernel(module="unique", enable_backward=False, module_options=builder_options("box_builder.h"))
def _build_kernel(
    boxes: wp.array(dtype=wp.float32),
    count: wp.int32,
    scratch: wp.array(dtype=wp.int32),
    nodes: wp.array(dtype=wp.float32),
    order: wp.array(dtype=wp.int32),
    sizes: wp.array(dtype=wp.int32),
):
    _build(boxes, count, scratch, nodes, order, sizes)


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

    def flat(values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(values.reshape(-1), dtype=dtype, device="cpu", copy=False)

    inputs = [flat(boxes, wp.float32), count, flat(scratch, wp.int32)]
    outputs = [flat(nodes, wp.float32), flat(order, wp.int32), flat(sizes, wp.int32)]
    wp.launch(_build_kernel, dim=1, inputs=inputs, outputs=outputs, device="cpu")
    return nodes[: 7 * sizes[0]].copy(), order
