"""Means of finer images: what a camera with many samples shows, of which each part of a pixel is drawn as one."""

from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import BLOCK_DIM, Stage

wp.set_module_options(compiler_flags())


@wp.struct
class Parts:
    """Sizes of an image, and of the finer one whose means it shows."""

    width: wp.int32  # of the image [pixels]
    height: wp.int32
    across: wp.int32  # parts of a pixel
    down: wp.int32
    channels: wp.int32
    rounding: wp.float32  # is added to means of whole numbers


@wp.kernel(enable_backward=False)
def write_means(
    parts: wp.array(dtype=Any),
    mean: wp.array(dtype=Any),
    mask: wp.array(dtype=wp.uint8),
    sizes: Parts,
    first: wp.int32,
):
    """A thread for each pixel; images lie channel after channel."""
    pixel = first + wp.tid()
    row = pixel // sizes.width  # of all worlds
    column = pixel - row * sizes.width
    if mask[row // sizes.height] == wp.uint8(0):
        return
    count = wp.float32(sizes.across * sizes.down)
    for channel in range(sizes.channels):
        total = wp.float32(0.0)
        for k in range(sizes.down):
            line = wp.int64(row * sizes.down + k) * wp.int64(sizes.width)
            begin = (line + wp.int64(column)) * wp.int64(sizes.across)
            for i in range(sizes.across):
                total += wp.float32(parts[(begin + wp.int64(i)) * wp.int64(sizes.channels) + wp.int64(channel)])
        at = wp.int64(pixel) * wp.int64(sizes.channels) + wp.int64(channel)
        mean[at] = mean.dtype(total / count + sizes.rounding)


_KERNELS = {
    dtype: wp.overload(
        write_means, [wp.array(dtype=dtype), wp.array(dtype=dtype), wp.array(dtype=wp.uint8), Parts, wp.int32]
    )
    for dtype in (wp.uint8, wp.float32)
}


@register("mean of parts")
def bind(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the stage that averages one finer image."""
    parts, mean = frame.get(planned, "parts"), frame.get(planned, "mean")
    image = frame.images[planned.name_of("mean") or ""]
    sizes = Parts()
    sizes.width, sizes.height, sizes.channels = frame.width, frame.height, image.shape[-1]
    sizes.across, sizes.down = frame.parts
    sizes.rounding = 0.5 if mean.dtype == wp.uint8 else 0.0
    return frame.launch(planned, _KERNELS[mean.dtype], [parts, mean, frame.mask, sizes], BLOCK_DIM)
