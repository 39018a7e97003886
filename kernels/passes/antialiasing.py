"""Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.

What the trace has found in the pixels' centres says where edges are, and which shapes a sample near them may hit. A
sample has the colour of the nearest pixel whose centre shows the same surface, so that nothing is lit anew: whatever
made the image, its edges become smooth.
"""

import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import warp as wp

from warpcam.kernels.passes.visibility import LENSES, THREADS, region_size
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch, native_module
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HEIGHT_FIELD, MESH, HeightFields, Meshes, Shapes, View

# Where samples lie in a pixel, right and down of its centre [pixels]: those of OpenGL's implementations.
# native/antialiasing/edge_test.h has the same numbers.
SAMPLES: Mapping[int, Sequence[tuple[float, float]]] = {
    4: ((-0.125, 0.375), (0.375, 0.125), (-0.375, -0.125), (0.125, -0.375)),
}
# The images whose edges can be smooth, with dtype and channels, in the order of their bits in
# native/antialiasing/edge_resolve.h.
IMAGES: Mapping[str, tuple[type, int]] = {"rgb": (wp.uint8, 3), "rgba": (wp.uint8, 4), "hdr": (wp.float32, 3)}
# Pixels of which a thread block of a GPU smooths the edges, at most, in scenes without meshes and height fields. With
# them a block has as many as the trace's, or a whole image: the more samples it has, the fewer of its lanes wait for
# the longest ones.
REGION = (32, 32)
# Whole images of scenes with meshes are smoothed where they were lit if there are so many worlds for each
# multiprocessor: a block for each image fills the device then, even one group's.
WORTH_PLACE = 40
SIDE = 64  # of a region that is a whole image [pixels]
THREADS_IN_PLACE = 160  # of a block of them
# Blocks that a multiprocessor is to hold: without meshes and height fields, where ids have a byte, and more; with them;
# and of those in place.
BLOCKS, MANY_BLOCKS, WALK_BLOCKS, BLOCKS_IN_PLACE = 7, 8, 5, 4


@functools.cache
def _target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """One camera's images in all worlds. Arrays that were not asked for are empty."""

    @wp.struct
    class SmoothTarget:
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        depth: wp.array(dtype=wp.float32)  # (world * height * width,) planar depth in the pixels' centres [m]
        shape: wp.array(dtype=shape_dtype)  # (world * height * width,) shape id there, negative where nothing is hit
        face: wp.array(dtype=face_dtype)  # (world * height * width,) of a mesh, in leaf order; empty without meshes
        rgb: wp.array(dtype=wp.uint8)  # (world * height * width * channels,) as lit, as the following
        rgba: wp.array(dtype=wp.uint8)
        hdr: wp.array(dtype=wp.float32)
        smooth_rgb: wp.array(dtype=wp.uint8)  # written: the same with smooth edges
        smooth_rgba: wp.array(dtype=wp.uint8)
        smooth_hdr: wp.array(dtype=wp.float32)
        width: wp.int32
        height: wp.int32

    return SmoothTarget


def _by_words(tables: SceneTables, images: Collection[str], width: int, height: int) -> bool:
    """Whether colours are loaded by words, of scenes that gain by it."""
    return MESH in tables.shape_types and "hdr" not in images and width * height % 4 == 0 and width >= 3


def in_place(tables: SceneTables, images: Collection[str], width: int, height: int, device: wp.Device) -> bool:
    """Whether images are smoothed where they were lit, without a buffer of their colours."""
    if not device.is_cuda or not _by_words(tables, images, width, height):
        return False
    return width <= SIDE and height <= SIDE and tables.num_worlds >= WORTH_PLACE * device.sm_count


def wave(device: wp.Device) -> int:
    """How many images a device smooths in place at once: worlds that are drawn together are a multiple of them."""
    return device.sm_count * BLOCKS_IN_PLACE


def _block(tables: SceneTables, shape_dtype: Any, placed: bool) -> tuple[int, int]:
    """Threads of a thread block, and how many blocks a multiprocessor is to hold."""
    if placed:
        return THREADS_IN_PLACE, BLOCKS_IN_PLACE
    if not {MESH, HEIGHT_FIELD}.isdisjoint(tables.shape_types):
        return THREADS, WALK_BLOCKS
    return THREADS, BLOCKS if shape_dtype is wp.int8 else MANY_BLOCKS


@functools.cache
def _kernel(
    types: int,
    lens: int,
    width: int,
    height: int,
    images: int,
    by_words: bool,
    placed: bool,
    block: tuple[int, int],
    target_type: Any,
) -> wp.Kernel:

    @wp.func_native(
        f"warpcam::smooth<{types}, {lens}, {width}, {height}, {images}, {int(by_words)}, {int(placed)}>"
        "(shapes, meshes, fields, views, target, index);"
    )
    def smooth(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        index: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=block,
        module_options=native_module("antialiasing/edge_resolve.h", block[0]),
    )
    def smooth_edges(
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        first: wp.int32,
    ):
        smooth(shapes, meshes, fields, views, target, first + wp.tid())

    return smooth_edges


def bind(
    images: Mapping[str, wp.array],
    lit: Mapping[str, wp.array],
    tables: SceneTables,
    lens: str,
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    face: wp.array,
    device: wp.Device,
    group: Group,
) -> Stage:
    """Bind the stage that smooths the edges of one camera's images.

    Args:
        images: Those of ``IMAGES`` that are there, (world, height, width, channels); written.
        lit: Likewise: the same with the colours of the pixels' centres; the same arrays where ``in_place()``.
        tables: The scene.
        lens: "pinhole" or "orthographic".
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        depth: Planar depth in the pixels' centres [m], float32 (world, height, width, 1).
        shape: Shape ids there, likewise, negative where nothing is hit. What is left out of it no sample hits.
        face: Faces there, likewise, as the trace wrote them; empty if there are no meshes.
        device: Where all of these lie.
        group: Which worlds.
    """
    height, width = depth.shape[1:3]
    target_type = _target_struct(shape.dtype, face.dtype)
    target = target_type()
    target.mask, target.width, target.height = mask, width, height
    target.depth, target.shape = depth.flatten(), shape.flatten()
    target.face = face.flatten()
    wanted = 0
    for bit, name in enumerate(IMAGES):
        if name in images:
            setattr(target, name, flatten(lit[name]))
            setattr(target, f"smooth_{name}", flatten(images[name]))
            wanted |= 1 << bit
    types = sum(1 << t for t in tables.shape_types)
    region = region_size(tables, group.concurrent_worlds, width, height, device)
    if device.is_cuda and {MESH, HEIGHT_FIELD}.isdisjoint(tables.shape_types):
        region = min(region, REGION)
    placed = in_place(tables, images, width, height, device)
    if placed:
        region = (SIDE, SIDE)
    block = _block(tables, shape.dtype, placed)
    threads = block[0]
    unit = -(-width // region[0]) * -(-height // region[1]) * (threads if device.is_cuda else 1)  # threads a world
    by_words = device.is_cuda and _by_words(tables, images, width, height)
    kernel = _kernel(types, LENSES[lens], *region, wanted, by_words, placed, block, target_type)
    arguments = [tables.shapes, tables.meshes, tables.height_fields, views, target]
    start, count = group.worlds.start, len(group.worlds)
    return bind_launch(kernel, count * unit, arguments, device, start=start * unit, block_dim=threads)
