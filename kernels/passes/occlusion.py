"""Occlusion by rays: how much of the light from all around, and of each light, reaches what a pixel shows."""

import functools
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.flags import ShadingFlag
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.frame import PlannedPass
from warpcam.kernels.plan.launches import SceneTypes
from warpcam.kernels.plan.occlusion import NORMAL_BYTES, OccluderKey, OcclusionFilterKey, OcclusionKey, pixel_bytes
from warpcam.kernels.plan.passes import register
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Materials, Meshes, Physical, Shapes, View

THREADS = 64  # of a CUDA block: rays are long or short, and a block waits for its longest
SHAPE_ROWS = 6  # PATH_SHAPE_ROWS of native/path/path_shapes.h


@dataclass(frozen=True, eq=False)
class OcclusionArrays:
    """What one camera keeps for its rays.

    Attributes:
        rows: vec4, (world, row): the shapes that hide light, SHAPE_ROWS each.
        counts: int32, (world,): how many there are.
        radius: Within which shapes hide light from all around [m]; may be infinite.
    """

    rows: wp.array
    counts: wp.array
    radius: float


@wp.struct
class OccluderFrame:
    """Arrays of one camera that the list of its shapes needs."""

    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world alone
    views: wp.array(dtype=View)  # (world,)
    rows: wp.array2d(dtype=wp.vec4)
    counts: wp.array(dtype=wp.int32)


@functools.cache
def _frame_struct(num_shares: int, shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what one camera's rays and their filter read and write, with so many shares of each pixel."""
    fields = visible_fields(shape_dtype, face_dtype) | {
        "views": wp.array(dtype=View),  # (world,)
        "rows": wp.array2d(dtype=wp.vec4),
        "counts": wp.array(dtype=wp.int32),
        "radius": wp.float32,
        "backs": wp.int32,  # 1: rays meet meshes from behind, too
        "rays": wp.array(dtype=pixel_bytes(NORMAL_BYTES + num_shares)),  # (pixel,) native/occlusion/occlusion_rays.h
        "visible": wp.array(dtype=pixel_bytes(num_shares)),  # (pixel,) shares of 255; undefined where nothing is hit
    }
    return make_struct("OcclusionFrame", fields)


@functools.cache
def _list_kernel(types: SceneTypes, blocks: int) -> wp.Kernel:
    return make_kernel(
        "list_occluders",
        f"warpcam::list_occluders<{types.native}>(frame, casters, materials, meshes, fields, index);",
        {
            "frame": OccluderFrame,
            "casters": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
        },
        native_module("occlusion/occluders.h"),
        (THREADS, blocks),
    )


@functools.cache
def _ray_kernel(key: OcclusionKey, frame_type: Any) -> wp.Kernel:
    ambient, lights = (bool(key.shares & flag) for flag in (ShadingFlag.AMBIENT_OCCLUSION, ShadingFlag.SOFT_SHADOWS))
    return make_kernel(
        "trace_occlusion",
        f"warpcam::trace_occlusion<{key.types.native}, {int(key.lens)}, {int(ambient)}, {int(lights)}>"
        "(frame, shapes, meshes, fields, physical, index);",
        {"frame": frame_type, "shapes": Shapes, "meshes": Meshes, "fields": HeightFields, "physical": Physical},
        native_module("occlusion/occlusion_rays.h", THREADS),
        (THREADS, key.blocks),
    )


@functools.cache
def _filter_kernel(key: OcclusionFilterKey, frame_type: Any) -> wp.Kernel:
    return make_kernel(
        "filter_occlusion",
        f"warpcam::filter_occlusion<{int(key.lens)}, {key.num_shares}>(frame, index);",
        {"frame": frame_type},
        native_module("occlusion/occlusion_filter.h"),
        (THREADS, key.blocks),
    )


@register("occluders")
def bind_occluders(planned: PlannedPass[OccluderKey], frame: CameraFrame) -> Stage:
    """Bind the list of the shapes that hide light."""
    tables, lists = frame.tables, frame.occlusion
    arrays: Any = OccluderFrame()
    arrays.mask, arrays.views, arrays.rows, arrays.counts = frame.mask, frame.views, lists.rows, lists.counts
    casters = tables.shapes if tables.casters is None else tables.casters
    arguments = [arrays, casters, tables.materials, tables.meshes, tables.height_fields]
    return frame.launch(planned, _list_kernel(planned.key.types, planned.key.blocks), arguments, THREADS)


def _frame(planned: PlannedPass[Any], frame: CameraFrame) -> tuple[Any, Any]:
    """The struct of one camera's rays: its type, and the struct."""
    frame_type, arrays = frame.visible(planned, functools.partial(_frame_struct, planned.key.num_shares))
    lists = frame.occlusion
    arrays.views, arrays.rows, arrays.counts, arrays.radius = frame.views, lists.rows, lists.counts, lists.radius
    arrays.backs = int(frame.tables.backs_shade)
    return frame_type, frame.fill(planned, arrays, ("rays", "visible"))


@register("occlusion rays", needs=("depth", "shape", "face"))
def bind_rays(planned: PlannedPass[OcclusionKey], frame: CameraFrame) -> Stage:
    """Bind the rays of one camera's pixels, after its trace and the list of shapes."""
    tables = frame.tables
    frame_type, arrays = _frame(planned, frame)
    kernel = _ray_kernel(planned.key, frame_type)
    arguments = [arrays, tables.shapes, tables.meshes, tables.height_fields, tables.physical]
    return frame.launch(planned, kernel, arguments, THREADS)


@register("occlusion filter", needs=("depth", "shape"))
def bind_filter(planned: PlannedPass[OcclusionFilterKey], frame: CameraFrame) -> Stage:
    """Bind the filter of these rays."""
    frame_type, arrays = _frame(planned, frame)
    return frame.launch(planned, _filter_kernel(planned.key, frame_type), [arrays], THREADS)
