"""Shadows: for each pixel the lights that do not reach what it sees."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.camera_frame import CameraFrame, dtype_of
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.plan.frame import PlannedPass
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.shadow import ShadowKey
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import HeightFields, Lights, Materials, Meshes, Shapes, View


@functools.cache
def shaded_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of the arrays that the shadow kernel reads and writes."""
    fields = {"mask": wp.array(dtype=wp.uint8)}  # (world,) 0 leaves the world's images alone
    fields |= visible_fields(shape_dtype, face_dtype) | {
        # (world * height * width,) bit k is set where light k does not reach the point, of those that are kept:
        # native/lights/active_lights.h
        "shadow": wp.array(dtype=wp.uint8),
        "width": wp.int32,
        "height": wp.int32,
        "plane": wp.int32,  # id of a plane, or -1: native/shadow/plane_receiver_cull.h
    }
    return make_struct("Shaded", fields)


@functools.cache
def _kernel(key: ShadowKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.native, int(key.lens), key.capacity, key.region

    @wp.func_native(
        f"warpcam::{'cast_many' if key.many_casters else 'cast'}<{types}, {lens}, {capacity}, {width}, {height}>"
        "(shapes, materials, meshes, fields, lights, views, target, index);"
    )
    def cast(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        lights: Lights,
        views: wp.array(dtype=View),
        target: target_type,
        index: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(THREADS, key.blocks),
        module_options=native_module("shadow/many_casters.h" if key.many_casters else "shadow/shadow_pass.h"),
    )
    def shadow(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        lights: Lights,
        views: wp.array(dtype=View),
        target: target_type,
        first: wp.int32,
    ):
        cast(shapes, materials, meshes, fields, lights, views, target, first + wp.tid())

    return shadow


@register("shadow", needs=("depth", "shape", "face"))
def bind(planned: PlannedPass[ShadowKey], frame: CameraFrame) -> Stage:
    """Bind the shadow pass of one camera; it runs after the camera's trace."""
    tables = frame.tables
    shape, face = frame.get(planned, "shape"), frame.find(planned, "face")
    target_type = shaded_struct(shape.dtype, dtype_of(face))
    target = target_type()
    target.mask, target.width, target.height = frame.mask, frame.width, frame.height
    target.plane = tables.first_plane
    target.depth, target.shape, target.shadow = frame.get(planned, "depth"), shape, frame.get(planned, "shadow")
    if face is not None:
        target.face = face
    shapes = tables.shapes if tables.casters is None else tables.casters
    arguments = [shapes, tables.materials, tables.meshes, tables.height_fields, tables.lights, frame.views, target]
    return frame.launch(planned, _kernel(planned.key, target_type), arguments)
