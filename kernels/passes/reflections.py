"""Reflections of the real-time look: what smooth surfaces mirror, and what is seen through clear ones."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.lit_rays import bind_lit_rays
from warpcam.kernels.passes.paths import THREADS
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.paths import ReflectionFilterKey, ReflectionKey
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import View

# vec4, (pixel,): "glossy" is what a pixel's rays have seen, with its normal and roughness in w; "glossy_share" what of
# their mean is added to the pixel's light, and in w what its own is multiplied by before; "reflections" what is added
# beside, and after the filter all of it, with that factor in w.
RESULTS = ("glossy", "glossy_share", "reflections")


@functools.cache
def _filter_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of what the filter reads and writes."""
    fields = {"views": wp.array(dtype=View)} | dict.fromkeys(RESULTS, wp.array(dtype=wp.vec4))
    return make_struct("ReflectionFilterFrame", fields | visible_fields(shape_dtype, face_dtype))


@functools.cache
def _filter_kernel(key: ReflectionFilterKey, frame_type: Any) -> wp.Kernel:
    return make_kernel(
        "filter_reflections",
        f"warpcam::filter_reflections<{int(key.lens)}>(frame, index);",
        {"frame": frame_type},
        native_module("occlusion/reflection_filter.h"),
        (THREADS, key.blocks),
    )


@register("reflections", needs=("shape",))
def bind(planned: PlannedPass[ReflectionKey], frame: CameraFrame) -> Stage:
    """Bind the rays, whose light the filter takes: native/occlusion/reflection_rays.h."""
    return bind_lit_rays(planned, frame, "trace_reflections", "occlusion/reflection_rays.h", RESULTS)


@register("reflection filter", needs=("depth", "shape"))
def bind_filter(planned: PlannedPass[ReflectionFilterKey], frame: CameraFrame) -> Stage:
    """Bind the filter of these rays."""
    frame_type, seen = frame.visible(planned, _filter_struct)
    seen.views = frame.views
    frame.fill(planned, seen, RESULTS)
    return frame.launch(planned, _filter_kernel(planned.key, frame_type), [seen], THREADS)
