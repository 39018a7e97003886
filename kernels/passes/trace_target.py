"""Targets of the trace: a struct for each kind of trace."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.flow import FlowHistory
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import Textures


@wp.struct
class LabelImages:
    """Images of labels, (world * height * width,), and the tables that they are looked up in, (world or 1, shape)."""

    instances: wp.array(dtype=wp.int32)  # -1 where nothing is hit
    semantics: wp.array(dtype=wp.int32)  # 0 where nothing is hit
    instance_of: wp.array2d(dtype=wp.int32)
    semantic_of: wp.array2d(dtype=wp.int32)


def visible_fields(shape_dtype: Any, face_dtype: Any) -> dict[str, Any]:
    """Fields of every struct of one camera's visibility in all worlds; images are (world * height * width,)."""
    return {
        "mask": wp.array(dtype=wp.uint8),  # (world,) 0 leaves the world's images alone
        "width": wp.int32,
        "height": wp.int32,
        "depth": wp.array(dtype=wp.float32),  # planar depth [m]; View.miss where nothing is hit
        "shape": wp.array(dtype=shape_dtype),  # shape id, or -1
        # mesh: row / 3 of the face in the mesh's part of Meshes.faces; height field: 2 * cell + k, where k = 0 is the
        # triangle below the cell's diagonal, all bits on sides and base; else undefined. Empty for a scene without them
        "face": wp.array(dtype=face_dtype),
    }


@functools.cache
def target_struct(kind: str, shape_dtype: Any, face_dtype: Any) -> Any:
    """Target of the trace. Arrays that were not asked for are empty.

    Args:
        kind: "plain"; "opaque": transparent shapes are left out, and no images are written; "albedo" or "flow": these
            are written, too.
        shape_dtype: Integer type that holds every shape id and -1.
        face_dtype: Integer type that holds every face, and of height fields one number more.
    """
    fields: dict[str, Any] = {
        "faults": wp.array(dtype=wp.uint8),  # (world,) set to 1 where a pose or size is not finite or 0
    }
    if kind == "opaque":
        fields["transparent_index"] = wp.array(dtype=wp.int32)  # (shape,) not -1 for shapes that may be transparent
    fields |= visible_fields(shape_dtype, face_dtype) | {
        "distance": wp.array(dtype=wp.float32),  # (world * height * width,) along the ray [m]; inf where nothing is hit
        "points": wp.array(dtype=wp.float32),  # (world * height * width * 3,) world frame [m]; inf where nothing is hit
        "bodies": wp.array(dtype=wp.int32),  # (world * height * width,) body id, or -1
        "ids": wp.array(dtype=wp.int32),  # (world * height * width,) as Shapes.ids has it, or -1
        # (world * height * width * 3,) unit, world frame, towards the camera; 0 where nothing is hit. Only for scenes
        # without meshes and height fields
        "normals": wp.array(dtype=wp.float32),
    }
    if kind == "flow":
        fields["history"] = FlowHistory
    if kind != "opaque":
        fields["labels"] = LabelImages
    if kind != "albedo":
        fields["lists"] = wp.array2d(dtype=wp.vec4)  # (world, row): CameraFrame.lists; may be empty
    if kind == "albedo":
        fields["albedo"] = wp.array(dtype=wp.uint8)  # (world * height * width * 3,) 0 where nothing is hit
        fields["textures"] = Textures
        fields["plane"] = wp.int32  # id of the plane whose texture is looked up at once, or -1
    return make_struct(f"{kind.capitalize()}Target", fields)
