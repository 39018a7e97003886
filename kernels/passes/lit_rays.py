"""Rays that begin at what pixels show, in the real-time look, and light what they meet: native/path/lit_surface.h."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.paths import THREADS
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.passes.world_overrides import WorldOverrides
from warpcam.kernels.plan.paths import IndirectKey, ReflectionKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import Background, HeightFields, Materials, Meshes, Physical, Shapes, Textures, View


@functools.cache
def _frame_struct(results: tuple[str, ...], shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the trace has found in one camera's images, of the shapes that rays meet, and of the results."""
    fields = {
        "horizon": wp.float32,  # see SceneTables
        "overrides": WorldOverrides,
        "backs": wp.int32,  # 1: rays meet meshes from behind, too
        "rows": wp.array2d(dtype=wp.vec4),  # (world, row) the shapes, as PathFrame has them
        "heads": wp.array2d(dtype=wp.int32),
        "face_starts": wp.array(dtype=wp.int32),
        "faces": wp.array(dtype=wp.int32),
        "face_sums": wp.array(dtype=wp.float32),
        "face_shares": wp.array(dtype=wp.float32),
    }
    fields |= dict.fromkeys(results, wp.array(dtype=wp.vec4))  # (pixel,)
    return make_struct("LitRayFrame", fields | visible_fields(shape_dtype, face_dtype))


@functools.cache
def _kernel(function: str, header: str, key: IndirectKey | ReflectionKey, frame_type: Any) -> wp.Kernel:
    return make_kernel(
        function,
        f"warpcam::{function}<{key.types.native}, {int(key.lens)}, {int(key.flags)}>("
        "warpcam::PhysicalScene { warpcam::Scene { frame, frame, shapes, meshes, fields, materials, textures, "
        "background }, physical }, views, index);",
        {
            "frame": frame_type,
            "shapes": Shapes,
            "meshes": Meshes,
            "fields": HeightFields,
            "materials": Materials,
            "textures": Textures,
            "physical": Physical,
            "background": Background,
            "views": wp.array(dtype=View),
        },
        native_module(header, THREADS),
        (THREADS, key.blocks),
    )


def bind_lit_rays(
    planned: PlannedPass[Any], frame: CameraFrame, function: str, header: str, results: tuple[str, ...]
) -> Stage:
    """Bind the rays of one camera's pixels, after its trace and the list of shapes.

    Args:
        planned: The pass.
        frame: The camera's.
        function: Of the header, which does a pixel.
        header: Of the native code.
        results: Names of the arrays that are written, vec4, (pixel,).
    """
    tables, lists = frame.tables, frame.paths.frame
    frame_type, seen = frame.visible(planned, functools.partial(_frame_struct, results))
    seen.horizon, seen.backs, seen.rows, seen.heads = tables.horizon, int(tables.backs_shade), lists.rows, lists.heads
    seen.face_starts, seen.faces = lists.face_starts, lists.faces
    seen.face_sums, seen.face_shares = lists.face_sums, lists.face_shares
    if tables.world_overrides is not None:
        seen.overrides = tables.world_overrides
    frame.fill(planned, seen, results)
    scene = (tables.shapes, tables.meshes, tables.height_fields, tables.materials, tables.textures)
    arguments = [seen, *scene, tables.physical, tables.background, frame.views]
    return frame.launch(planned, _kernel(function, header, planned.key, frame_type), arguments, THREADS)
