"""Images as other systems pack them: copied into buffers of theirs, several cameras to a row."""

from typing import Any

import warp as wp

from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import Stage, bind_launch

wp.set_module_options(native_module("output/pack.h"))

RUN = 4  # numbers that a thread copies: native/output/pack.h

RGBA = (0, 16)  # red in the lowest byte
BGRA = (16, 0)  # blue in the lowest byte
OPAQUE = 255


@wp.func_native("warpcam::color_run(image, red, blue, miss_alpha, offset, out, index);")
def color_run(
    image: wp.array3d(dtype=wp.uint8),
    red: int,
    blue: int,
    miss_alpha: int,
    offset: int,
    out: wp.array2d(dtype=wp.uint32),
    index: int,
): ...


@wp.kernel(enable_backward=False)
def pack_color(
    image: wp.array3d(dtype=wp.uint8),
    red: wp.int32,
    blue: wp.int32,
    miss_alpha: wp.int32,
    offset: wp.int32,
    out: wp.array2d(dtype=wp.uint32),
    first: wp.int32,
):
    color_run(image, red, blue, miss_alpha, offset, out, first + wp.tid())


@wp.func_native("warpcam::copy_run(image, offset, out, index);")
def copy_run(image: wp.array2d(dtype=wp.float32), offset: int, out: wp.array2d(dtype=wp.float32), index: int): ...


@wp.kernel(enable_backward=False)
def pack_values(
    image: wp.array2d(dtype=wp.float32),
    offset: wp.int32,
    out: wp.array2d(dtype=wp.float32),
    first: wp.int32,
):
    copy_run(image, offset, out, first + wp.tid())


@wp.func_native("warpcam::name_run(image, objects, offset, out, index);")
def name_run(
    image: wp.array2d(dtype=wp.int32),
    objects: wp.array(dtype=wp.vec2i),
    offset: int,
    out: wp.array2d(dtype=wp.vec2i),
    index: int,
): ...


@wp.kernel(enable_backward=False)
def pack_objects(
    image: wp.array2d(dtype=wp.int32),
    objects: wp.array(dtype=wp.vec2i),
    offset: wp.int32,
    out: wp.array2d(dtype=wp.vec2i),
    first: wp.int32,
):
    name_run(image, objects, offset, out, first + wp.tid())


def bind_color(
    image: wp.array, order: tuple[int, int], out: wp.array, offset: int, device: wp.Device, miss_alpha: int = OPAQUE
) -> Stage:
    """Bind the stage that writes a colour image as one number a pixel.

    Args:
        image: uint8 (world, height, width, 3 or 4). Its alpha only says where nothing was hit.
        order: ``RGBA`` or ``BGRA``.
        out: uint32 (world, pixel); written from ``offset`` on. Its highest byte is 255.
        offset: Of the camera in each row of ``out`` [pixels].
        device: Where all of these lie.
        miss_alpha: The highest byte where nothing was hit, for an image with alpha.
    """
    flat = image.reshape((image.shape[0], -1, image.shape[3]))
    return _bind(pack_color, flat, [*order, miss_alpha, offset, out], device)


def bind_values(image: wp.array, out: wp.array, offset: int, device: wp.Device) -> Stage:
    """Bind the stage that copies float32 (world, height, width, 1) into rows of ``out``, (world, pixel)."""
    return _bind(pack_values, image.reshape((image.shape[0], -1)), [offset, out], device)


def bind_objects(image: wp.array, objects: wp.array, out: wp.array, offset: int, device: wp.Device) -> Stage:
    """Bind the stage that writes what each id stands for.

    Args:
        image: int32 (world, height, width, 1).
        objects: vec2i, (id + 1,); its last row is for -1.
        out: vec2i (world, pixel); written from ``offset`` on.
        offset: Of the camera in each row of ``out`` [pixels].
        device: Where all of these lie.
    """
    return _bind(pack_objects, image.reshape((image.shape[0], -1)), [objects, offset, out], device)


def _bind(kernel: wp.Kernel, flat: wp.array, inputs: list[Any], device: wp.Device) -> Stage:
    return bind_launch(kernel, flat.shape[0] * -(-flat.shape[1] // RUN), [flat, *inputs], device)


@wp.kernel(enable_backward=False)
def unpack_colors(packed: wp.array2d(dtype=wp.uint32), start: wp.int32, colors: wp.array3d(dtype=wp.vec3)):
    """BGRA to red, green and blue in [0, 1]."""
    world, row, column = wp.tid()
    pixel = packed[world, start + row * colors.shape[2] + column]
    byte = wp.uint32(255)
    red = wp.float32((pixel >> wp.uint32(16)) & byte)
    green = wp.float32((pixel >> wp.uint32(8)) & byte)
    blue = wp.float32(pixel & byte)
    colors[world, row, column] = wp.vec3(red, green, blue) / 255.0


@wp.kernel(enable_backward=False)
def scale_depth(
    depth: wp.array2d(dtype=wp.float32), start: wp.int32, scale: wp.float32, scaled: wp.array3d(dtype=wp.float32)
):
    """Depth over ``scale``, at most 1."""
    world, row, column = wp.tid()
    scaled[world, row, column] = wp.clamp(depth[world, start + row * scaled.shape[2] + column] / scale, 0.0, 1.0)


@wp.kernel(enable_backward=False)
def copy_pairs(pairs: wp.array2d(dtype=wp.vec2i), start: wp.int32, image: wp.array3d(dtype=wp.vec2i)):
    """One camera's part of a row as an image."""
    world, row, column = wp.tid()
    image[world, row, column] = pairs[world, start + row * image.shape[2] + column]


@wp.func_native("warpcam::clip_run(image, beyond, out, index);")
def clip_run(image: wp.array2d(dtype=wp.float32), beyond: float, out: wp.array2d(dtype=wp.float32), index: int): ...


@wp.kernel(enable_backward=False)
def clip_values(
    image: wp.array2d(dtype=wp.float32), beyond: wp.float32, out: wp.array2d(dtype=wp.float32), first: wp.int32
):
    clip_run(image, beyond, out, first + wp.tid())


@wp.func_native("warpcam::look_up_run(image, table, miss, other, out, index);")
def look_up_run(
    image: wp.array2d(dtype=wp.int32),
    table: wp.array(dtype=wp.int32),
    miss: int,
    other: int,
    out: wp.array2d(dtype=wp.int32),
    index: int,
): ...


@wp.kernel(enable_backward=False)
def look_up(
    image: wp.array2d(dtype=wp.int32),
    table: wp.array(dtype=wp.int32),
    miss: wp.int32,
    other: wp.int32,
    out: wp.array2d(dtype=wp.int32),
    first: wp.int32,
):
    look_up_run(image, table, miss, other, out, first + wp.tid())


@wp.func_native("warpcam::negate_run(image, out, index);")
def negate_run(image: wp.array2d(dtype=wp.float32), out: wp.array2d(dtype=wp.float32), index: int): ...


@wp.kernel(enable_backward=False)
def negate(image: wp.array2d(dtype=wp.float32), out: wp.array2d(dtype=wp.float32), first: wp.int32):
    negate_run(image, out, first + wp.tid())


@wp.kernel(enable_backward=False)
def place_cameras(
    positions: wp.array(dtype=wp.vec3),
    orientations: wp.array(dtype=wp.quat),
    turn: wp.quat,
    matrices: wp.array(dtype=wp.mat33),
    out_positions: wp.array(dtype=wp.vec3),
    out_rotations: wp.array(dtype=wp.vec4),
    out_lenses: wp.array(dtype=wp.vec4),
):
    """Poses whose axes are turned, and matrices of intrinsics, to what cameras of one's own have."""
    world = wp.tid()
    q = orientations[world] * turn
    out_positions[world] = positions[world]
    out_rotations[world] = wp.vec4(q[3], q[0], q[1], q[2])
    matrix = matrices[world]
    out_lenses[world] = wp.vec4(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])


def bind_clipped(image: wp.array, beyond: float, out: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that copies float32 images (world, height, width, 1), with another number in place of inf."""
    return _bind(clip_values, image.reshape((image.shape[0], -1)), [float(beyond), out], device)


def bind_look_up(image: wp.array, table: wp.array, miss: int, other: int, out: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that writes a number for each id.

    Args:
        image: int32 (world, height, width, 1).
        table: int32 (id,).
        miss: For -1.
        other: For every id that the table lacks.
        out: int32 (world, pixel); written.
        device: Where all of these lie.
    """
    return _bind(look_up, image.reshape((image.shape[0], -1)), [table, miss, other, out], device)


def bind_negated(image: wp.array, out: wp.array, device: wp.Device) -> Stage:
    """Bind the stage that writes float32 images (world, height, width, n) with other signs."""
    return _bind(negate, image.reshape((image.shape[0], -1)), [out], device)
