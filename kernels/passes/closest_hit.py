"""Kernels that trace rays to the closest hit and write a target."""

from typing import Any

import warp as wp

from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View


def closest_hit_kernel(header: str, function: str, blocks: int, target_type: Any) -> wp.Kernel:
    """Make the kernel whose threads draw a part of an image each.

    Args:
        header: Of ``kernels/native``.
        function: Name and template arguments of the native function.
        blocks: That a multiprocessor is to hold.
        target_type: Struct of what is written.
    """

    @wp.func_native(f"warpcam::{function}(shapes, materials, meshes, fields, views, target, index);")
    def draw(
        shapes: Shapes,
        materials: Materials,
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
        launch_bounds=(THREADS, blocks),
        module_options=native_module(header),
    )
    def visibility(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        first: wp.int32,
    ):
        draw(shapes, materials, meshes, fields, views, target, first + wp.tid())

    return visibility
