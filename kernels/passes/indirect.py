"""One bounce of light in the real-time look: what comes to a pixel's surface from the shapes around it."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.lit_rays import bind_lit_rays
from warpcam.kernels.passes.paths import THREADS
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.paths import IndirectFilterKey, IndirectKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import View


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
    """Bind the rays, whose light the filter takes: native/occlusion/indirect_rays.h."""
    return bind_lit_rays(planned, frame, "trace_indirect", "occlusion/indirect_rays.h", ("indirect_rays",))


@register("indirect filter", needs=("depth", "shape"))
def bind_filter(planned: PlannedPass[IndirectFilterKey], frame: CameraFrame) -> Stage:
    """Bind the filter of these rays."""
    frame_type, seen = frame.visible(planned, _filter_struct)
    seen.views = frame.views
    frame.fill(planned, seen, ("indirect_rays", "indirect"))
    return frame.launch(planned, _filter_kernel(planned.key, frame_type), [seen], THREADS)
