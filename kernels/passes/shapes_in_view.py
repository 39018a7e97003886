"""The pass that lists the shapes each view may show, nearest first, in scenes of many: the trace chooses from them."""

import functools

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.trace import InViewKey
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View


@wp.struct
class InViewStage:
    """Arrays and sizes of the pass."""

    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world alone
    faults: wp.array(dtype=wp.uint8)  # (world,) set to 1 where a pose or size is not finite or 0
    lists: wp.array2d(dtype=wp.vec4)  # (world, row) written
    width: wp.int32  # of the image [pixels]
    height: wp.int32


@functools.cache
def _kernel(key: InViewKey) -> wp.Kernel:
    function = f"list_in_view<{key.types.native}, {int(key.lens)}, {key.room}>"
    return make_kernel(
        "shapes_in_view",
        f"warpcam::{function}(shapes, materials, meshes, fields, views, stage, index);",
        {
            "shapes": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
            "views": wp.array(dtype=View),
            "stage": InViewStage,
        },
        native_module("traversal/shapes_in_view.h"),
        (THREADS, key.blocks),
    )


@register("shapes in view")
def bind(planned: PlannedPass[InViewKey], frame: CameraFrame) -> Stage:
    """Bind the pass of one camera."""
    tables, stage = frame.tables, InViewStage()
    stage.mask, stage.faults, stage.lists = frame.mask, frame.faults, frame.lists
    stage.width, stage.height = frame.width, frame.height
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, frame.views, stage]
    return frame.launch(planned, _kernel(planned.key), arguments)
