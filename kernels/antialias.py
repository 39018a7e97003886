"""Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.

What the trace has found in the pixels' centres says where edges are. These pixels are traced once more for each sample,
with the view moved by a part of a pixel. A sample has the colour of the nearest pixel whose centre shows the same
surface, so that nothing is lit anew: whatever made the image, its edges become smooth.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from .launch import Group, Stage, record
from .types import View

# Where samples lie in a pixel, right and down of its centre [pixels]: those of OpenGL's implementations.
SAMPLES: Mapping[int, Sequence[tuple[float, float]]] = {
    4: ((-0.125, 0.375), (0.375, 0.125), (-0.375, -0.125), (0.125, -0.375)),
}
# A surface has an edge where its slope, of depth over width, changes by more than this from pixel to pixel.
CREASE = wp.constant(0.5)
# Of the pixels that may show a sample's surface one whose plane lies apart from it by so many pixels' widths in depth
# is as bad as one that lies a pixel's width aside.
STEEP = wp.constant(1.0)
CENTRE = wp.constant(4)  # of the nine pixels, in their rows
MAX_DISTANCE = wp.constant(1.0e30)


@wp.kernel(enable_backward=False)
def move_views(
    views: wp.array(dtype=View),
    mask: wp.array(dtype=wp.uint8),
    offset: wp.vec2,
    moved: wp.array(dtype=View),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] == wp.uint8(0):
        return
    view = views[world]
    view.center = view.center - offset
    moved[world] = view


@wp.func
def turns(before: wp.float32, here: wp.float32, after: wp.float32, scale: wp.float32, pinhole: wp.int32) -> wp.bool:
    """Whether three depths in a row are not on one plane. Of a plane 1 / depth is linear in a pinhole's image."""
    if pinhole != 0:
        return wp.abs(here / before + here / after - 2.0) > CREASE * scale
    return wp.abs(before + after - 2.0 * here) > CREASE * scale


@wp.func
def level(depth: wp.float32, pinhole: wp.int32) -> wp.float32:
    """What is linear in the image of a plane."""
    return wp.where(pinhole != 0, 1.0 / depth, depth)


@wp.kernel(enable_backward=False)
def find_edges(
    views: wp.array(dtype=View),
    mask: wp.array(dtype=wp.uint8),
    depth: wp.array(dtype=wp.float32),
    shape: wp.array(dtype=Any),
    pinhole: wp.int32,
    width: wp.int32,
    height: wp.int32,
    edges: wp.array(dtype=wp.uint8),
    first: wp.int32,
):
    pixel = first + wp.tid()
    line = pixel // width
    column = pixel - line * width
    world = line // height
    row = line - world * height
    if mask[world] == wp.uint8(0):
        return
    here = shape[pixel]
    left, right, up, down = pixel, pixel, pixel, pixel
    if column > 0:
        left = pixel - 1
    if column < width - 1:
        right = pixel + 1
    if row > 0:
        up = pixel - width
    if row < height - 1:
        down = pixel + width
    edge = shape[left] != here or shape[right] != here or shape[up] != here or shape[down] != here
    if not edge and here >= shape.dtype(0):
        scale = views[world].scale
        middle = depth[pixel]
        if left < pixel and right > pixel:
            edge = turns(depth[left], middle, depth[right], scale[0], pinhole)
        if not edge and up < pixel and down > pixel:
            edge = turns(depth[up], middle, depth[down], scale[1], pinhole)
    edges[pixel] = wp.where(edge, wp.uint8(1), wp.uint8(0))


@wp.kernel(enable_backward=False)
def choose(
    views: wp.array(dtype=View),
    mask: wp.array(dtype=wp.uint8),
    edges: wp.array(dtype=wp.uint8),
    depth: wp.array(dtype=wp.float32),
    shape: wp.array(dtype=Any),
    sample_depth: wp.array(dtype=wp.float32),
    sample_shape: wp.array(dtype=Any),
    offset: wp.vec2,
    bit: wp.int32,
    pinhole: wp.int32,
    width: wp.int32,
    height: wp.int32,
    choices: wp.array(dtype=wp.uint16),
    first: wp.int32,
):
    """Which of the nine pixels around shows the surface that a sample has hit: the nearest, by place and by depth."""
    pixel = first + wp.tid()
    line = pixel // width
    column = pixel - line * width
    world = line // height
    row = line - world * height
    if mask[world] == wp.uint8(0) or edges[pixel] == wp.uint8(0):
        return
    hit = wp.int32(sample_shape[pixel])
    there = sample_depth[pixel]
    best = float(MAX_DISTANCE)
    chosen = int(CENTRE)
    for k in range(9):
        right = k % 3 - 1
        down = k // 3 - 1
        i = column + right
        j = row + down
        if i >= 0 and i < width and j >= 0 and j < height:
            other = pixel + down * width + right
            if wp.int32(shape[other]) == hit:
                x = wp.float32(right) - offset[0]
                y = wp.float32(down) - offset[1]
                cost = x * x + y * y
                if hit >= 0:  # by its plane, which the pixels on the side away from the sample tell
                    here = level(depth[other], pinhole)
                    found = here
                    beside = i + int(wp.sign(x))
                    if beside >= 0 and beside < width:
                        at = other + beside - i
                        if wp.int32(shape[at]) == hit:
                            found += wp.abs(x) * (here - level(depth[at], pinhole))
                    beside = j + int(wp.sign(y))
                    if beside >= 0 and beside < height:
                        at = other + (beside - j) * width
                        if wp.int32(shape[at]) == hit:
                            found += wp.abs(y) * (here - level(depth[at], pinhole))
                    apart = found - level(there, pinhole)
                    if pinhole != 0:
                        apart *= there
                    cost += wp.abs(apart) / (STEEP * views[world].scale[0])
                if cost < best:
                    best = cost
                    chosen = k
    if bit == 0:
        choices[pixel] = wp.uint16(chosen)
    else:
        choices[pixel] = wp.uint16(int(choices[pixel]) | chosen << bit)


@functools.cache
def _blend(dtype: Any, channels: int) -> wp.Kernel:
    rounding = wp.constant(0.5 if dtype is wp.uint8 else 0.0)

    @wp.kernel(module="unique", enable_backward=False)
    def blend(
        mask: wp.array(dtype=wp.uint8),
        edges: wp.array(dtype=wp.uint8),
        choices: wp.array(dtype=wp.uint16),
        image: wp.array2d(dtype=dtype),
        width: wp.int32,
        pixels: wp.int32,
        blended: wp.array2d(dtype=dtype),
        first: wp.int32,
    ):
        pixel = first + wp.tid()
        if mask[pixel // pixels] == wp.uint8(0) or edges[pixel] == wp.uint8(0):
            return
        chosen = int(choices[pixel])
        for channel in range(channels):
            total = float(0.0)  # noqa: UP018 - a variable of Warp's, not a constant
            for sample in range(wp.static(4)):
                k = chosen >> 4 * sample & 15
                total += wp.float32(image[pixel + (k // 3 - 1) * width + k % 3 - 1, channel])
            blended[pixel, channel] = dtype(0.25 * total + rounding)

    return blend


@functools.cache
def _put(dtype: Any, channels: int) -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False)
    def put(
        mask: wp.array(dtype=wp.uint8),
        edges: wp.array(dtype=wp.uint8),
        blended: wp.array2d(dtype=dtype),
        pixels: wp.int32,
        image: wp.array2d(dtype=dtype),
        first: wp.int32,
    ):
        pixel = first + wp.tid()
        if mask[pixel // pixels] != wp.uint8(0) and edges[pixel] != wp.uint8(0):
            for channel in range(channels):
                image[pixel, channel] = blended[pixel, channel]

    return put


for _dtype in (wp.int16, wp.int32):
    wp.overload(find_edges, {"shape": wp.array(dtype=_dtype)})
    for _other in (wp.int16, wp.int32):
        wp.overload(choose, {"shape": wp.array(dtype=_dtype), "sample_shape": wp.array(dtype=_other)})


def record_views(
    views: wp.array, mask: wp.array, offset: tuple[float, float], moved: wp.array, device: wp.Device, group: Group
) -> Stage:
    """Bind the stage that moves the views of a group of worlds by a part of a pixel, right and down.

    Args:
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        offset: [pixels].
        moved: View, (world,); written.
        device: Where all of these lie.
        group: Which worlds.
    """
    inputs = [views, mask, wp.vec2(*offset), moved]
    return record(move_views, len(group.worlds), inputs, device, start=group.worlds.start)


def record_edges(
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    pinhole: bool,
    edges: wp.array,
    device: wp.Device,
    group: Group,
) -> Stage:
    """Bind the stage that finds the pixels that need more than one sample.

    Args:
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        depth: Planar depth [m], float32 (world, height, width, 1).
        shape: Shape ids, likewise, negative where nothing is hit.
        pinhole: Else the lens is orthographic.
        edges: uint8, likewise; written: 1 where there is one.
        device: Where all of these lie.
        group: Which worlds.
    """
    height, width = depth.shape[1:3]
    inputs = [views, mask, depth.flatten(), shape.flatten(), int(pinhole), width, height, edges.flatten()]
    start = group.worlds.start * width * height
    return record(find_edges, len(group.worlds) * width * height, inputs, device, start=start)


def record_choice(
    views: wp.array,
    mask: wp.array,
    edges: wp.array,
    depth: wp.array,
    shape: wp.array,
    sample_depth: wp.array,
    sample_shape: wp.array,
    samples: int,
    number: int,
    pinhole: bool,
    choices: wp.array,
    device: wp.Device,
    group: Group,
) -> Stage:
    """Bind the stage that finds the pixels which show what one sample of each edge has hit.

    Args:
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        edges: uint8, (world, height, width, 1), as ``record_edges`` has it.
        depth: Planar depth [m] in the pixels' centres, float32, likewise.
        shape: Shape ids there, likewise.
        sample_depth: The same for the sample.
        sample_shape: The same for the sample.
        samples: Of a pixel.
        number: Of the sample.
        pinhole: Else the lens is orthographic.
        choices: uint16, likewise; written, sample after sample: four bits for each, 3 * row + column of the chosen.
        device: Where all of these lie.
        group: Which worlds.
    """
    height, width = depth.shape[1:3]
    flat = [array.flatten() for array in (edges, depth, shape, sample_depth, sample_shape)]
    offset = wp.vec2(*SAMPLES[samples][number])
    inputs = [views, mask, *flat, offset, 4 * number, int(pinhole), width, height, choices.flatten()]
    start = group.worlds.start * width * height
    return record(choose, len(group.worlds) * width * height, inputs, device, start=start)


def record_blend(
    edges: wp.array,
    choices: wp.array,
    mask: wp.array,
    image: wp.array,
    blended: wp.array,
    device: wp.Device,
    group: Group,
) -> list[Stage]:
    """Bind the stages that write into an image's edges the mean of the pixels that were chosen.

    Args:
        edges: uint8, (world, height, width, 1), as ``record_edges`` has it.
        choices: uint16, likewise, as ``record_choice`` has it.
        mask: uint8, (world,); worlds with 0 are left alone.
        image: (world, height, width, channels), uint8 or float32; written.
        blended: Likewise: room for the edges.
        device: Where all of these lie.
        group: Which worlds.
    """
    height, width, channels = image.shape[1:]
    pixels, kind = height * width, (image.dtype, channels)
    image, blended = (array.reshape((-1, channels)) for array in (image, blended))
    start, dim = group.worlds.start * pixels, len(group.worlds) * pixels
    blend = [mask, edges.flatten(), choices.flatten(), image, width, pixels, blended]
    put = [mask, edges.flatten(), blended, pixels, image]
    return [
        record(_blend(*kind), dim, blend, device, start=start),
        record(_put(*kind), dim, put, device, start=start),
    ]
