"""One bounce of light in the real-time look: what comes to a pixel's surface from the shapes around it."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.paths import THREADS
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.passes.world_overrides import WorldOverrides
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.paths import IndirectFilterKey, IndirectKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import Background, HeightFields, Materials, Meshes, Physical, Shapes, Textures, View


@functools.cache
def _ray_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the trace has found in one camera's images, of the shapes that rays meet, and of the result."""
    fields = {
        "horizon": wp.float32,  # see SceneTables
        "overrides": WorldOverrides,
        "backs": wp.int32,  # 1: rays meet meshes from behind, too
        "rows": wp.array2d(dtype=wp.vec4),  # (world, row) the shapes, as PathFrame has them
        "heads": wp.array2d(dtype=wp.int32),
        "indirect_rays": wp.array(dtype=wp.vec4),  # (pixel,) native/occlusion/indirect_rays.h
    }
    return make_struct("IndirectFrame", fields | visible_fields(shape_dtype, face_dtype))


@functools.cache
def _filter_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the filter reads and writes."""
    fields = {
        "views": wp.array(dtype=View),  # (world,)
        "indirect_rays": wp.array(dtype=wp.vec4),
        # (pixel,) light from shapes, and in w the share of light from beyond them; undefined where nothing is hit
        "indirect": wp.array(dtype=wp.vec4),
    }
    return make_struct("IndirectFilterFrame", fields | visible_fields(shape_dtype, face_dtype))


@functools.cache
def _ray_kernel(key: IndirectKey, frame_type: Any) -> wp.Kernel:
    return make_kernel(
        "trace_indirect",
        f"warpcam::trace_indirect<{key.types.native}, {int(key.lens)}, {int(key.flags)}>("
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
        native_module("occlusion/indirect_rays.h", THREADS),
        (THREADS, key.blocks),
    )


@functools.cache
def _filter_kernel(key: IndirectFilterKey, frame_type: Any) -> wp.Kernel:
    return make_kernel(
        "filter_indirect",
        f"warpcam::filter_indirect<{int(key.lens)}>(frame, index);",
        {"frame": frame_type},
        native_module("occlusion/indirect_filter.h"),
        (THREADS, key.blocks),
    )


@register("indirect rays", needs=("depth", "shape", "face"))
def bind_rays(planned: PlannedPass[IndirectKey], frame: CameraFrame) -> Stage:
    """Bind the rays of one camera's pixels, after its trace and the list of shapes."""
    tables, lists = frame.tables, frame.paths.frame
    frame_type, seen = frame.visible(planned, _ray_struct)
    seen.horizon, seen.backs, seen.rows, seen.heads = tables.horizon, int(tables.backs_shade), lists.rows, lists.heads
    if tables.world_overrides is not None:
        seen.overrides = tables.world_overrides
    frame.fill(planned, seen, ("indirect_rays",))
    scene = (tables.shapes, tables.meshes, tables.height_fields, tables.materials, tables.textures)
    arguments = [seen, *scene, tables.physical, tables.background, frame.views]
    return frame.launch(planned, _ray_kernel(planned.key, frame_type), arguments, THREADS)


@register("indirect filter", needs=("depth", "shape"))
def bind_filter(planned: PlannedPass[IndirectFilterKey], frame: CameraFrame) -> Stage:
    """Bind the filter of these rays."""
    frame_type, seen = frame.visible(planned, _filter_struct)
    seen.views = frame.views
    frame.fill(planned, seen, ("indirect_rays", "indirect"))
    return frame.launch(planned, _filter_kernel(planned.key, frame_type), [seen], THREADS)
