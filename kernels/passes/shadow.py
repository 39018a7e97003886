"""Shadows: for each pixel the lights that do not reach what it sees."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.shadow import ShadowKey
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Lights, Materials, Meshes, Shapes, View


@functools.cache
def shaded_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of the arrays that the shadow kernel reads and writes."""
    fields = visible_fields(shape_dtype, face_dtype) | {
        # (world * height * width,) bit k is set where light k does not reach the point, of those that are kept:
        # native/lights/active_lights.h
        "shadow": wp.array(dtype=wp.uint8),
        "plane": wp.int32,  # id of a plane, or -1: native/shadow/plane_receiver_cull.h
    }
    return make_struct("Shaded", fields)


@functools.cache
def _kernel(key: ShadowKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.native, int(key.lens), key.capacity, key.region

    function, header = ("cast_many", "many_casters") if key.many_casters else ("cast", "shadow_pass")
    return make_kernel(
        "shadow",
        f"warpcam::{function}<{types}, {lens}, {capacity}, {width}, {height}>"
        "(shapes, materials, meshes, fields, lights, views, target, index);",
        {
            "shapes": Shapes,
            "materials": Materials,
            "meshes": Meshes,
            "fields": HeightFields,
            "lights": Lights,
            "views": wp.array(dtype=View),
            "target": target_type,
        },
        native_module(f"shadow/{header}.h"),
        (THREADS, key.blocks),
    )


@register("shadow", needs=("depth", "shape", "face"))
def bind(planned: PlannedPass[ShadowKey], frame: CameraFrame) -> Stage:
    """Bind the shadow pass of one camera; it runs after the camera's trace."""
    tables = frame.tables
    target_type, target = frame.visible(planned, shaded_struct)
    target.plane, target.shadow = tables.first_plane, frame.get(planned, "shadow")
    shapes = tables.shapes if tables.casters is None else tables.casters
    arguments = [shapes, tables.materials, tables.meshes, tables.height_fields, tables.lights, frame.views, target]
    return frame.launch(planned, _kernel(planned.key, target_type), arguments)
