"""Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.

What the trace has found in the pixels' centres says where edges are, and which shapes a sample near them may hit. A
sample has the colour of the nearest pixel whose centre shows the same surface, so that nothing is lit anew: whatever
made the image, its edges become smooth.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from warpcam.kernels.plan.edges import EdgeKey, plan_edges
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HeightFields, Meshes, Shapes, View

# Where samples lie in a pixel, right and down of its centre [pixels]: those of OpenGL's implementations.
# native/antialiasing/edge_test.h has the same numbers.
SAMPLES: Mapping[int, Sequence[tuple[float, float]]] = {
    4: ((-0.125, 0.375), (0.375, 0.125), (-0.375, -0.125), (0.125, -0.375)),
}
# The images whose edges can be smooth, with dtype and channels.
IMAGES: Mapping[str, tuple[type, int]] = {"rgb": (wp.uint8, 3), "rgba": (wp.uint8, 4), "hdr": (wp.float32, 3)}


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


@functools.cache
def _kernel(key: EdgeKey, target_type: Any) -> wp.Kernel:
    types, lens, (width, height), images = key.types.bits, int(key.lens), key.region, int(key.images)

    @wp.func_native(
        f"warpcam::smooth<{types}, {lens}, {width}, {height}, {images}, {int(key.by_words)}, {int(key.in_place)}>"
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
        launch_bounds=(key.threads, key.blocks),
        module_options=native_module("antialiasing/edge_resolve.h", key.threads),
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
    for name in IMAGES:
        if name in images:
            setattr(target, name, flatten(lit[name]))
            setattr(target, f"smooth_{name}", flatten(images[name]))
    plan = plan_edges(tables, lens, width, height, tuple(images), shape.dtype is wp.int8, device, group)
    kernel, unit, threads = _kernel(plan.key, target_type), plan.threads, plan.key.threads
    arguments = [tables.shapes, tables.meshes, tables.height_fields, views, target]
    start, count = group.worlds.start, len(group.worlds)
    return bind_launch(kernel, count * unit, arguments, device, start=start * unit, block_dim=threads, key=plan.key)
