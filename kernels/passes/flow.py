"""Optical flow: state of the previous frame, and the motion of shapes in a camera's image since then.

The trace itself writes ``flow`` and ``flow_valid`` (native/flow/optical_flow.h). Before it one thread for each shape
composes how it has moved (native/flow/shape_motion.h), where shapes are few in its own blocks or in the stage of
view_shape_lists.py; after it what is seen now becomes what was.
"""

from typing import Any

import warp as wp

from warpcam.kernels.flags import SceneFlag
from warpcam.kernels.plan.history import is_compact
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import MeshReads, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import Shapes, View

wp.set_module_options(compiler_flags())


@wp.struct
class FlowHistory:
    """Arrays of the flow history that the trace reads and writes."""

    flow: wp.array(dtype=wp.float32)  # (pixel * 2,) may be empty
    flow_valid: wp.array(dtype=wp.uint8)  # (pixel,) may be empty
    # (word / 2 or word,) what was seen, and in the other what is seen, 16 or 32 bits a pixel; see
    # native/flow/optical_flow.h
    first_words: wp.array(dtype=wp.uint32)
    second_words: wp.array(dtype=wp.uint32)
    # (part,) of images whose blocks look at floors: native/flow/plane_history.h
    floor_first: wp.array(dtype=wp.uint8)
    floor_second: wp.array(dtype=wp.uint8)
    frame_state: wp.array(dtype=wp.uint8)  # (world,) which of these two has what was seen, or NEW: see views.py
    # (world, ROWS or MOVING_ROWS of each shape; of cameras whose shapes are listed the first row of all shapes, the
    # second, ...). Three rows take what pixel (column, row) sees to where it was: column,
    # row and 1 times the planar depth then, or for parallel rays column, row, depth. Each is
    # depth * (x column + y row + z) + w, or for parallel rays x column + y row + z depth + w. A fourth: a part of the
    # depth then and what is added to it [m], and nothing nearer than that may have been seen there; nearest planar
    # depth then [m]; as int bits twice the first corner of a mesh that moves, or -2, and 1 more where the three rows
    # lead to the same pixel. Three more: what a shift in the own frame of such a mesh adds to the first three. Of a
    # motion that is not known the rows lead to the same pixel, but to a depth behind the camera. Of compact words
    # the fourth has: part and shift in the steps that the depth then was counted in, the shift with TO_WHOLE added;
    # nearest depth, or -1 where the rows lead to the same pixel; how many steps a metre of the depth now has.
    motions: wp.array2d(dtype=wp.vec4)
    corners: wp.array(dtype=wp.vec3)  # VertexHistory.corners; this and what follows only where meshes move
    faces: wp.array(dtype=wp.vec4)  # Meshes.faces
    face_start: wp.array(dtype=wp.int32)  # Meshes.face_start
    # (world, 4 for each shape, the first row of all shapes, the second, ...): a shape's position and the rows of its
    # rotation as they were, with its size and asset
    before: wp.array2d(dtype=wp.vec4)
    # The same as they are, where the trace or the stage of views composes motions; then both change places, as words do
    after: wp.array2d(dtype=wp.vec4)
    views_before: wp.array(dtype=View)  # (world,)
    corner_starts: wp.array(dtype=wp.int32)  # VertexHistory.starts; empty where no mesh moves
    keep: wp.int32  # 1: the trace writes `after`
    columns: wp.int32  # shapes
    width: wp.int32
    height: wp.int32


write_motions = make_kernel(
    "write_motions",
    "warpcam::write_motion(shapes, views, mask, history, pinhole, scaled, compact, keep, moves, index);",
    {
        "shapes": Shapes,
        "views": wp.array(dtype=View),
        "mask": wp.array(dtype=wp.uint8),
        "history": FlowHistory,
        **dict.fromkeys(("pinhole", "scaled", "compact", "keep", "moves"), wp.int32),
    },
    native_module("flow/shape_motion.h"),
)


@wp.kernel(enable_backward=False)
def reset_history(known: wp.array(dtype=wp.uint8), mask: wp.array(dtype=wp.uint8), first: wp.int32):
    world = first + wp.tid()
    if mask[world] != wp.uint8(0):
        known[world] = wp.uint8(0)


def bind_motions(
    tables: SceneTables, views: wp.array, mask: wp.array, lens: str, keep: bool, history: Any, device: wp.Device
) -> Stage:
    """Bind the stage that composes how shapes have moved in one camera's image.

    Args:
        tables: The scene.
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        lens: "pinhole" or "orthographic".
        keep: ``FlowHistory.before`` becomes what is now: so for the last camera.
        history: FlowHistory; its motions are written.
        device: Where all of these lie.
    """
    facts = (
        lens == "pinhole",
        SceneFlag.PER_SHAPE_SCALE in tables.flags,
        is_compact(tables),
        keep,
        bool(tables.moving),
    )
    inputs = [tables.shapes, views, mask, history, *map(int, facts)]
    stage = bind_launch(write_motions, tables.num_worlds * tables.num_shapes, inputs, device)
    stage.reads = MeshReads.FACES
    return stage


def bind_reset(known: wp.array, mask: wp.array, device: wp.Device) -> Stage:
    """Bind the stage after which nothing is known of the worlds that a mask has."""
    return bind_launch(reset_history, known.shape[0], [known, mask], device)
