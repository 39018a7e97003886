"""Shadows: for each pixel the lights that do not reach what it sees."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.visibility import LENSES, SHARED_MEMORY, THREADS, in_order, region_size
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch, native_module
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import (
    GLASS,
    MESH,
    SHADING_BACKS,
    SHUTTERED,
    HeightFields,
    Lights,
    Materials,
    Meshes,
    Shapes,
    View,
)

BLOCKS = 8  # on a multiprocessor: bounds the registers of a thread
MANY_CASTERS_BLOCKS = 6  # the same in crowds, for which those of 8 are too few
LISTED_BYTES = 140  # of its shared memory for each shape of a list with meshes: shadow/casters.h, CasterList
BESIDE = 16  # up to so many shapes there are two lists: shadow/shadow_pass.h, lists_beside
CASTER_BOUNDS_BYTES = 16  # more where meshes have outlines: shadow/casters.h, CasterList::OUTLINED
REST_BYTES = 3400  # what else a block has, and what is reserved for it
# and for the rays of a warp, also for each 32 shapes: shadow/mesh_any_hit.h, ShadowRays
WALKED_BYTES, WORD_BYTES = 3232, 256
WALK_BYTES, WALK_SHAPES = 1280, 64  # more up to so many shapes, ShadowRays::KEEPS
CAPACITIES = (16, 32, 64, 128, 192)  # how many shapes a pass lists: few sizes, so that scenes share kernels
MANY_CASTERS_CAPACITIES = (512, 1024)  # the same in scenes of many shapes without meshes: native/shadow/many_casters.h
MANY = 384  # shapes; more are such a crowd
MOST = 2**20  # shapes that can be told apart there


@functools.cache
def shaded_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """What the shadow kernel reads and writes, each (world * height * width,)."""

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
def _kernel(
    crowded: bool, types: int, lens: int, capacity: int, width: int, height: int, target_type: Any
) -> wp.Kernel:
    @wp.func_native(
        f"warpcam::{'cast_crowd' if crowded else 'cast'}<{types}, {lens}, {capacity}, {width}, {height}>"
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
        launch_bounds=(THREADS, MANY_CASTERS_BLOCKS if crowded else blocks(types, capacity)),
        module_options=native_module("shadow/many_casters.h" if crowded else "shadow/shadow_pass.h"),
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
    types = sum(1 << t for t in tables.shape_types)
    if MESH in tables.shape_types:
        types |= (1 << SHADING_BACKS) * (tables.physical is None or tables.backs_shade)
        types |= (1 << SHUTTERED) * (tables.physical is None and has_occluder_boxes(tables))
    if tables.layers is not None and tables.layers.has_transparent:
        types |= 1 << GLASS
    shapes = tables.shapes if tables.casters is None else tables.casters
    num_casters = shapes.drawn.shape[0]
    crowded = MANY < num_casters <= MOST and MESH not in tables.shape_types
    capacities = MANY_CASTERS_CAPACITIES if crowded else CAPACITIES
    capacity = next(size for size in capacities if size >= min(num_casters, capacities[-1]))
    group = group or Group.of_all(views.shape[0])
    region = region_size(tables, group.concurrent_worlds, width, height, device)
    unit = -(-width // region[0]) * -(-height // region[1]) * (THREADS if device.is_cuda else 1)  # threads a world
    types = in_order(types, len(group.worlds) * unit, device)
    kernel = _kernel(crowded, types, LENSES[lens], capacity, *region, target_type)
    arguments = [shapes, tables.materials, tables.meshes, tables.height_fields, tables.lights, views, target]
    return bind_launch(
        kernel, len(group.worlds) * unit, arguments, device, start=group.worlds.start * unit, block_dim=THREADS
    )


def has_occluder_boxes(tables: SceneTables) -> bool:
    """Whether its meshes have shutters: pack_meshes of accel/meshes.py."""
    return tables.meshes.shutters is not None and tables.meshes.shutters.size > 0


def blocks(types: int, capacity: int) -> int:
    """Blocks that a multiprocessor is to hold: no more than its shared memory has room for."""
    if not types >> MESH & 1:
        return BLOCKS
    walked = WALKED_BYTES + WORD_BYTES * -(-capacity // 32) + (WALK_BYTES if capacity <= WALK_SHAPES else 0)
    rays = THREADS // 32 * walked
    listed = (LISTED_BYTES + (CASTER_BOUNDS_BYTES if types >> SHUTTERED & 1 else 0)) * capacity
    listed *= 2 if capacity <= BESIDE else 1
    return min(BLOCKS, SHARED_MEMORY // (listed + rays + REST_BYTES))
