"""Shadows: for each pixel the lights that do not reach what it sees."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.shadow import ShadowKey, plan_shadow
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HeightFields, Lights, Materials, Meshes, Shapes, View


@functools.cache
def shaded_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Arrays that the shadow kernel reads and writes, each (world * height * width,)."""

    @wp.struct
    class Shaded:
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        depth: wp.array(dtype=wp.float32)  # planar depth [m]
        shape: wp.array(dtype=shape_dtype)  # shape id, or -1
        face: wp.array(dtype=face_dtype)  # see trace_target.target_struct; empty for a scene without meshes
        # bit k is set where light k does not reach the point, of those that are kept: native/lights/active_lights.h
        shadow: wp.array(dtype=wp.uint8)
        width: wp.int32
        height: wp.int32
        plane: wp.int32  # id of a plane, or -1: native/shadow/plane_receiver_cull.h

    return Shaded


@functools.cache
def _kernel(key: ShadowKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.bits, int(key.lens), key.capacity, key.region

    @wp.func_native(
        f"warpcam::{'cast_crowd' if key.many_casters else 'cast'}<{types}, {lens}, {capacity}, {width}, {height}>"
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


def bind(
    tables: SceneTables,
    lens: str,
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    face: wp.array | None,
    width: int,
    height: int,
    shadow: wp.array,
    device: wp.Device,
    group: Group | None = None,
) -> Stage:
    """Bind the shadow pass of one camera; it runs after the camera's trace.

    Args:
        tables: The scene.
        lens: "pinhole" or "orthographic".
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        depth: float32, (world, height, width, ...), as the trace wrote it.
        shape: Shape ids, likewise.
        face: Faces, likewise; only needed for scenes with meshes.
        width: Image width [pixels].
        height: Image height [pixels].
        shadow: uint8, likewise; written.
        device: Where all of these lie.
        group: Which worlds are shaded; None is all.
    """
    target_type = shaded_struct(shape.dtype, wp.int32 if face is None else face.dtype)
    target = target_type()
    target.mask, target.width, target.height = mask, width, height
    target.plane = tables.first_plane
    target.depth, target.shape, target.shadow = depth.flatten(), shape.flatten(), shadow.flatten()
    if face is not None:
        target.face = face.flatten()
    shapes = tables.shapes if tables.casters is None else tables.casters
    group = group or Group.of_all(views.shape[0])
    plan = plan_shadow(tables, lens, width, height, device, group)
    kernel, unit = _kernel(plan.key, target_type), plan.threads
    arguments = [shapes, tables.materials, tables.meshes, tables.height_fields, tables.lights, views, target]
    return bind_launch(
        kernel,
        len(group.worlds) * unit,
        arguments,
        device,
        start=group.worlds.start * unit,
        block_dim=THREADS,
        key=plan.key,
    )
