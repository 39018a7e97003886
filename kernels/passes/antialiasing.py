"""Smooth edges: a pixel that an edge runs through shows the mean of what its samples hit, as in OpenGL.

What the trace has found in the pixels' centres says where edges are, and which shapes a sample near them may hit. A
sample has the colour of the nearest pixel whose centre shows the same surface, so that nothing is lit anew: whatever
made the image, its edges become smooth.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.edges import EdgeKey
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.shading import LIT
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Meshes, Shapes, View

# Where samples lie in a pixel, right and down of its centre [pixels]: those of OpenGL's implementations.
# native/antialiasing/edge_test.h has the same numbers.
SAMPLES: Mapping[int, Sequence[tuple[float, float]]] = {
    4: ((-0.125, 0.375), (0.375, 0.125), (-0.375, -0.125), (0.125, -0.375)),
}


@functools.cache
def _target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of one camera's images in all worlds. Arrays that were not asked for are empty."""
    fields = visible_fields(shape_dtype, face_dtype)  # in the pixels' centres
    # (world * height * width * channels,) as lit
    fields |= {name: wp.array(dtype=OUTPUTS[name].dtype) for name in LIT}
    # written: the same with smooth edges
    fields |= {f"smooth_{name}": wp.array(dtype=OUTPUTS[name].dtype) for name in LIT}
    return make_struct("SmoothTarget", fields)


@functools.cache
def _kernel(key: EdgeKey, target_type: Any) -> wp.Kernel:
    types, lens, (width, height), images = key.types.native, int(key.lens), key.region, int(key.images)
    how = f"{int(key.by_words)}, {int(key.in_place)}"
    return make_kernel(
        "smooth_edges",
        f"warpcam::smooth<{types}, {lens}, {width}, {height}, {images}, {how}>"
        "(shapes, meshes, fields, views, target, index);",
        {
            "shapes": Shapes,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "target": target_type,
        },
        native_module("antialiasing/edge_resolve.h", key.threads),
        (key.threads, key.blocks),
    )


@register("smooth edges", needs=("depth", "shape", "face"))
def bind(planned: PlannedPass[EdgeKey], frame: CameraFrame) -> Stage:
    """Bind the stage that smooths the edges of one camera's images.

    What is left out of the trace no sample hits.
    """
    tables, key = frame.tables, planned.key
    target_type, target = frame.visible(planned, _target_struct)
    for name in LIT:
        if (image := frame.find(planned, f"smooth {name}")) is not None:
            setattr(target, name, frame.get(planned, name))
            setattr(target, f"smooth_{name}", image)
    arguments = [tables.shapes, tables.meshes, tables.height_fields, frame.views, target]
    return frame.launch(planned, _kernel(key, target_type), arguments, key.threads)
