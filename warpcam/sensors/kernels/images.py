"""Kernels that begin and end a measurement: counters, copies, display colours to linear light and back."""

import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.indices import row_and_column, strip_of
from warpcam.kernels.types import View
from warpcam.sensors.kernels.curves import decode, encode_byte

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


@wp.kernel(enable_backward=False, grid_stride=False)
def exchange_misses(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    views: wp.array(dtype=View),
    hides: wp.int32,
    source: wp.array2d(dtype=wp.float32),
    target: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    """Depth that is infinite where nothing is hit, whatever the camera has there; or, if ``hides`` is 0, that again."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    before = views[world].miss
    after = wp.float32(wp.inf)
    if hides == 0:
        after = before
        before = wp.float32(wp.inf)
    for row in range(top, bottom):
        pixel = row * size[0] + column
        depth = source[world, pixel]
        target[world, pixel] = wp.where(depth == before, after, depth)


@wp.kernel(enable_backward=False, grid_stride=False)
def decode_bytes(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    light_of_bytes: wp.array(dtype=wp.float32),
    source: wp.array3d(dtype=wp.uint8),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Display colours as linear light, white is 1, by the table of ``light_table``."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        target[world, pixel] = wp.vec3(
            light_of_bytes[wp.int32(source[world, pixel, 0])],
            light_of_bytes[wp.int32(source[world, pixel, 1])],
            light_of_bytes[wp.int32(source[world, pixel, 2])],
        )


@wp.kernel(enable_backward=False, grid_stride=False)
def decode_light(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    source: wp.array2d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec3),
    first: wp.int32,
):
    """Display values without an upper bound as linear light."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = source[world, pixel]
        target[world, pixel] = wp.vec3(decode(value[0]), decode(value[1]), decode(value[2]))


@wp.kernel(enable_backward=False, grid_stride=False)
def store_light(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    bytes_of_light: wp.array(dtype=wp.int32),
    source: wp.array2d(dtype=wp.vec3),
    truth: wp.array3d(dtype=wp.uint8),
    target: wp.array3d(dtype=wp.uint8),
    first: wp.int32,
):
    """Linear light as bytes, by the table of ``byte_table``; an alpha is that of the truth."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        light = source[world, pixel]
        for k in range(3):
            target[world, pixel, k] = wp.uint8(encode_byte(bytes_of_light, light[k]))
        if target.shape[2] == 4:
            target[world, pixel, 3] = truth[world, pixel, 3]


@wp.kernel(enable_backward=False, grid_stride=False)
def store_display(
    mask: wp.array(dtype=wp.uint8),
    size: wp.vec2i,
    source: wp.array2d(dtype=wp.vec3),
    truth: wp.array3d(dtype=wp.uint8),
    target: wp.array3d(dtype=wp.uint8),
    first: wp.int32,
):
    """Display values as bytes; an alpha is that of the truth."""
    world, column, top, bottom = strip_of(first + wp.tid(), size)
    if mask[world] == wp.uint8(0):
        return
    for row in range(top, bottom):
        pixel = row * size[0] + column
        value = source[world, pixel]
        for k in range(3):
            target[world, pixel, k] = wp.uint8(wp.clamp(value[k], 0.0, 1.0) * 255.0 + 0.5)
        if target.shape[2] == 4:
            target[world, pixel, 3] = truth[world, pixel, 3]
