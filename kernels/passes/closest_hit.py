"""Kernels that trace rays to the closest hit and write a target."""

from typing import Any

import warp as wp

from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View


def closest_hit_kernel(header: str, function: str, blocks: int, target_type: Any) -> wp.Kernel:
    """Make the kernel whose threads draw a part of an image each.

    Args:
        header: Of ``kernels/native``.
        function: Name and template arguments of the native function.
        blocks: That a multiprocessor is to hold.
        target_type: Struct of what is written.
    """
    return make_kernel(
        "visibility",
        f"warpcam::{function}(shapes, materials, meshes, fields, views, target, index);",
        {
            "shapes": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "target": target_type,
        },
        native_module(header),
        (THREADS, blocks),
    )
