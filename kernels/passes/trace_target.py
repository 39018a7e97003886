"""Targets of the trace: a struct for each kind of trace."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.flow import FlowHistory
from warpcam.kernels.types import Textures


@wp.struct
class LabelImages:
    """Images of labels, (world * height * width,), and the tables that they are looked up in, (world or 1, shape)."""

    instances: wp.array(dtype=wp.int32)  # -1 where nothing is hit
    semantics: wp.array(dtype=wp.int32)  # 0 where nothing is hit
    instance_of: wp.array2d(dtype=wp.int32)
    semantic_of: wp.array2d(dtype=wp.int32)


@functools.cache
def target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Target of the trace. Arrays that were not asked for are empty."""

    @wp.struct
    class Target:
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        faults: wp.array(dtype=wp.uint8)  # (world,) set to 1 where a pose or size is not a number
        depth: wp.array(dtype=wp.float32)  # (world * height * width,) planar depth [m]; View.miss where nothing is hit
        shape: wp.array(dtype=shape_dtype)  # (world * height * width,) shape id, or -1
        # (world * height * width,) mesh: row / 3 of the face in the mesh's part of Meshes.faces; height field:
        # 2 * cell + k, where k = 0 is the triangle below the cell's diagonal, all bits on sides and base; else
        # undefined
        face: wp.array(dtype=face_dtype)
        distance: wp.array(dtype=wp.float32)  # (world * height * width,) along the ray [m]; inf where nothing is hit
        points: wp.array(dtype=wp.float32)  # (world * height * width * 3,) world frame [m]; inf where nothing is hit
        bodies: wp.array(dtype=wp.int32)  # (world * height * width,) body id, or -1
        ids: wp.array(dtype=wp.int32)  # (world * height * width,) as Shapes.ids has it, or -1
        # (world * height * width * 3,) unit, world frame, towards the camera; 0 where nothing is hit. Only for scenes
        # without meshes and height fields
        normals: wp.array(dtype=wp.float32)
        width: wp.int32
        height: wp.int32
        labels: LabelImages
        lists: wp.array(dtype=wp.vec4)  # of view_shape_lists.py; may be empty

    return Target


@functools.cache
def opaque_target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Target of a trace that leaves out transparent shapes."""

    @wp.struct
    class OpaqueTarget:
        mask: wp.array(dtype=wp.uint8)
        faults: wp.array(dtype=wp.uint8)
        veil_places: wp.array(dtype=wp.int32)  # (shape,) not -1 for shapes that may be transparent
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        face: wp.array(dtype=face_dtype)
        distance: wp.array(dtype=wp.float32)  # this and what follows: empty
        points: wp.array(dtype=wp.float32)
        bodies: wp.array(dtype=wp.int32)
        ids: wp.array(dtype=wp.int32)
        normals: wp.array(dtype=wp.float32)
        width: wp.int32
        height: wp.int32

    return OpaqueTarget


@functools.cache
def albedo_target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Target of a trace that writes albedo."""

    @wp.struct
    class PaintedTarget:
        mask: wp.array(dtype=wp.uint8)
        faults: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        face: wp.array(dtype=face_dtype)
        distance: wp.array(dtype=wp.float32)
        points: wp.array(dtype=wp.float32)
        bodies: wp.array(dtype=wp.int32)
        ids: wp.array(dtype=wp.int32)
        normals: wp.array(dtype=wp.float32)
        width: wp.int32
        height: wp.int32
        labels: LabelImages
        albedo: wp.array(dtype=wp.uint8)  # (world * height * width * 3,) 0 where nothing is hit
        textures: Textures
        plane: wp.int32  # id of the plane whose texture is looked up at once, or -1

    return PaintedTarget


@functools.cache
def flow_target_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Target of a trace that writes flow."""

    @wp.struct
    class FlowTarget:
        mask: wp.array(dtype=wp.uint8)
        faults: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        face: wp.array(dtype=face_dtype)
        distance: wp.array(dtype=wp.float32)
        points: wp.array(dtype=wp.float32)
        bodies: wp.array(dtype=wp.int32)
        ids: wp.array(dtype=wp.int32)
        normals: wp.array(dtype=wp.float32)
        width: wp.int32
        height: wp.int32
        trail: FlowHistory
        labels: LabelImages
        lists: wp.array(dtype=wp.vec4)  # of view_shape_lists.py; may be empty

    return FlowTarget
