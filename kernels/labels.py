"""Labels of what was hit: a table looked up by world and shape."""

from typing import Any

import warp as wp

from .launch import Group, Stage, compiler_flags
from .launch import record as record_stage

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def write_labels(
    mask: wp.array(dtype=wp.uint8),
    shape: wp.array(dtype=Any),
    labels: wp.array2d(dtype=wp.int32),
    miss: wp.int32,
    pixels: wp.int32,
    image: wp.array(dtype=wp.int32),
    first: wp.int32,
):
    index = first + wp.tid()
    world = index // pixels
    if mask[world] == wp.uint8(0):
        return
    hit = wp.int32(shape[index])
    label = miss
    if hit >= 0:
        label = labels[world % labels.shape[0], hit]
    image[index] = label


for _dtype in (wp.int8, wp.int16, wp.int32):  # compiled with the module, whichever a scene has
    wp.overload(
        write_labels,
        {"shape": wp.array(dtype=_dtype)},
    )


def record(
    labels: wp.array, miss: int, mask: wp.array, shape: wp.array, image: wp.array, device: wp.Device, group: Group
) -> Stage:
    """Bind the stage that writes one image of labels.

    Args:
        labels: int32, (world or 1, shape).
        miss: The label where nothing is hit.
        mask: uint8, (world,); worlds with 0 are left alone.
        shape: Shape ids, int8, int16 or int32 (world, height, width, 1), -1 where nothing is hit.
        image: int32 (world, height, width, 1); written.
        device: Where all of these lie.
        group: Which worlds are drawn.
    """
    pixels = shape.shape[1] * shape.shape[2]
    inputs = [mask, shape.flatten(), labels, miss, pixels, image.flatten()]
    return record_stage(write_labels, len(group.worlds) * pixels, inputs, device, start=group.worlds.start * pixels)
