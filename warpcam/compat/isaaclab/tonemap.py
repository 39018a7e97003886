"""A tone curve: linear light, however bright, as bytes for a display."""

import warp as wp

from warpcam.core.color import encode_srgb
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(compiler_flags())


@wp.func
def tonemapped(light: wp.float32) -> wp.uint8:
    """Bent by Narkowicz's curve in the manner of films ("ACES Filmic Tone Mapping Curve", 2016), encoded as sRGB."""
    bright = wp.max(light, 0.0)
    bent = wp.min(bright * (2.51 * bright + 0.03) / (bright * (2.43 * bright + 0.59) + 0.14), 1.0)
    return wp.uint8(255.0 * encode_srgb(bent) + 0.5)


@wp.kernel(enable_backward=False)
def write_tonemapped(light: wp.array3d(dtype=wp.float32), out: wp.array3d(dtype=wp.uint8), first: wp.int32):
    index = first + wp.tid()
    world = index // light.shape[1]
    pixel = index - world * light.shape[1]
    for channel in range(3):
        out[world, pixel, channel] = tonemapped(light[world, pixel, channel])


def bind_tonemap(image: wp.array, out: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that writes linear light as a display shows it.

    Args:
        image: float32 (world, height, width, 3).
        out: uint8 of the same shape.
        device: Where both lie.
    """
    flat = (image.shape[0], image.shape[1] * image.shape[2], 3)
    return bind_launch(write_tonemapped, flat[0] * flat[1], [image.reshape(flat), out.reshape(flat)], device)
