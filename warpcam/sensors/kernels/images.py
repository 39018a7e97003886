"""Kernels that begin and end a measurement: counters, copies, display colours to linear light and back."""

import warp as wp

from warpcam.core.color import decode_srgb, encode_srgb
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column

wp.set_module_options(compiler_flags())


@wp.kernel(enable_backward=False)
def count_frames(mask: wp.array(dtype=wp.uint8), frames: wp.array(dtype=wp.int32), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        frames[world] = frames[world] + 1


@wp.kernel(enable_backward=False)
def clear(mask: wp.array(dtype=wp.uint8), words: wp.array2d(dtype=wp.int32), first: wp.int32):
    world, word = row_and_column(first + wp.tid(), words.shape[1])
    if mask[world] != wp.uint8(0):
        words[world, word] = 0


@wp.kernel(enable_backward=False)
def decode_bytes(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array3d(dtype=wp.uint8),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Display colours as linear light, white is 1."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    light = wp.vec3()
    for k in range(3):
        light[k] = decode_srgb(wp.float32(source[world, pixel, k]) / 255.0)
    target[world, pixel] = light


@wp.kernel(enable_backward=False)
def decode_light(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Display values without an upper bound as linear light."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    light = source[world, pixel]
    for k in range(3):
        light[k] = decode_srgb(light[k])
    target[world, pixel] = light


@wp.kernel(enable_backward=False)
def encode_light(
    mask: wp.array(dtype=wp.uint8),
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Linear light as display values, cut off at white."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    light = source[world, pixel]
    for k in range(3):
        light[k] = encode_srgb(wp.clamp(light[k], 0.0, 1.0))
    target[world, pixel] = light


@wp.kernel(enable_backward=False)
def store_colors(
    mask: wp.array(dtype=wp.uint8),
    is_linear: wp.int32,
    source: wp.array2d(dtype=wp.vec3),
    truth: wp.array3d(dtype=wp.uint8),
    target: wp.array3d(dtype=wp.uint8),
    first: wp.int32,
):
    """Linear light or display values as bytes; an alpha is that of the truth."""
    world, pixel = row_and_column(first + wp.tid(), source.shape[1])
    if mask[world] == wp.uint8(0):
        return
    value = source[world, pixel]
    for k in range(3):
        display = wp.clamp(value[k], 0.0, 1.0)
        if is_linear != 0:
            display = encode_srgb(display)
        target[world, pixel, k] = wp.uint8(display * 255.0 + 0.5)
    if target.shape[2] == 4:
        target[world, pixel, 3] = truth[world, pixel, 3]
