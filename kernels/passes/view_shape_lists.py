"""The stage that writes a camera's views and lists the shapes that each of its images may show, for the trace.

Only on CUDA, where a world has few shapes, none of them a mesh or a height field, and a block of the trace draws a
whole image or, without validity, whole rows of a larger one (native/traversal/view_shape_list.h). A block of the trace
would list them with one warp while the others wait.
"""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.passes.flow import FlowHistory
from warpcam.kernels.passes.views import CameraPose, FrameStart, LensParams, next_frame_state, view_of
from warpcam.kernels.plan.history import is_compact
from warpcam.kernels.plan.trace import LANES, ListKey
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View

LIST_THREADS = 160  # threads of a block, one for each shape of its worlds: native/traversal/view_shape_list.h


@wp.struct
class ListStage:
    """Arrays and sizes of the stage."""

    starts: wp.int32  # 1: it opens the frame
    mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world alone
    faults: wp.array(dtype=wp.uint8)  # (world,) set to 1 where a pose or size is not finite or 0
    views: wp.array(dtype=View)  # (world,) written
    lists: wp.array(dtype=wp.vec4)  # (world * row,) written
    columns: wp.int32  # shapes
    width: wp.int32  # of the image [pixels]
    height: wp.int32
    compact: wp.int32  # 1: words of the flow history have 16 bits
    worlds_each: wp.int32  # worlds of a block
    rate: wp.int32  # of worlds to threads, times 2^16


@wp.struct
class ListLane:
    """A thread of a block: it has a shape of one of the block's worlds, and the first threads a world's view each."""

    first_world: wp.int32  # of the block
    worlds: wp.int32  # of the block
    slot: wp.int32  # of the shape's world, among those of the block
    shape: wp.int32
    thread: wp.int32


@functools.cache
def _kernel(key: ListKey) -> wp.Kernel:
    types, lens, capacity, wanted = key.types.native, int(key.lens), key.capacity, int(key.outputs)
    function = f"list_worlds<{types}, {lens}, {capacity}, {wanted}>"

    @wp.func_native(f"warpcam::begin_listing<{capacity}, {wanted}>(stage, lane, shapes);")
    def begin_listing(stage: ListStage, lane: ListLane, shapes: Shapes): ...

    @wp.func_native(f"warpcam::{function}(now, state, stage, lane, shapes, materials, meshes, fields, history);")
    def list_worlds(
        now: View,
        state: int,
        stage: ListStage,
        lane: ListLane,
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        history: FlowHistory,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(LIST_THREADS, key.blocks),
        module_options=native_module("traversal/view_shape_list.h"),
    )
    def write_views_and_lists(
        stage: ListStage,
        frame_start: FrameStart,
        pose: CameraPose,
        lens: LensParams,
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        history: FlowHistory,
        first: wp.int32,
    ):
        index = wp.uint32(first + wp.tid())
        block = wp.int32(index // wp.uint32(LIST_THREADS))
        thread = wp.int32(index) - block * LIST_THREADS
        lane = ListLane()
        lane.first_world = block * stage.worlds_each
        lane.worlds = wp.min(stage.worlds_each, stage.views.shape[0] - lane.first_world)
        lane.slot = (thread * stage.rate) >> 16
        lane.shape = thread - lane.slot * stage.columns
        lane.thread = thread
        begin_listing(stage, lane, shapes)
        now = View()
        state = wp.int32(0)
        if thread < lane.worlds:
            world = lane.first_world + thread
            drawn = stage.starts != 0 and frame_start.everything != 0
            if not drawn:
                drawn = stage.mask[world] != wp.uint8(0)
            if drawn:
                state = wp.int32(1)
                if history.frame_state.shape[0] > 0:
                    state = wp.int32(history.frame_state[world])
                count = wp.int32(0)  # loaded with the rest: memory is waited for once
                known = wp.int32(0)
                time = wp.float32(0.0)
                if stage.starts != 0:
                    count = frame_start.frames[world]
                    if frame_start.frame_state.shape[0] > 0:
                        known = wp.int32(frame_start.frame_state[world])
                    if world < frame_start.clock.shape[0]:
                        time = frame_start.clock[world]
                    stage.faults[world] = wp.uint8(0)
                now = view_of(world, pose, lens, stage.faults)
                stage.views[world] = now
                if stage.starts != 0:
                    stage.mask[world] = wp.uint8(1)
                    frame_start.frames[world] = count + 1
                    if frame_start.frame_state.shape[0] > 0:
                        frame_start.frame_state[world] = wp.uint8(next_frame_state(known))
                    if world < frame_start.clock.shape[0]:
                        frame_start.times[world] = time
                    if history.frame_state.shape[0] > 0:
                        state = next_frame_state(state)
        list_worlds(now, state, stage, lane, shapes, materials, meshes, fields, history)

    return write_views_and_lists


def bind_lists(
    key: ListKey,
    frame_start: Any,
    pose: Any,
    lens: Any,
    mask: wp.array,
    faults: wp.array,
    views: wp.array,
    tables: SceneTables,
    lists: wp.array,
    history: Any,
    device: wp.Device,
) -> Stage:
    """Bind the stage, which does what that of ``bind_views`` does, too, and that of ``bind_motions``.

    Args:
        key: Of the kernel.
        frame_start: Of ``bind_views``, as ``pose``, ``lens``, ``mask``, ``faults`` and ``views``.
        tables: The scene.
        lists: vec4, (world, row); written.
        history: FlowHistory, whose motions are composed; None: none are.
        device: Where all of these lie.
    """
    each = min(LANES, LIST_THREADS // tables.num_shapes)
    stage = ListStage()
    stage.starts = int(frame_start is not None)
    stage.mask, stage.faults, stage.views, stage.lists = mask, faults, views, lists.flatten()
    stage.columns = tables.num_shapes
    stage.width, stage.height = lens.width * int(lens.parts[0]), lens.height * int(lens.parts[1])
    stage.compact = int(is_compact(tables))
    stage.worlds_each, stage.rate = each, 2**16 // tables.num_shapes + 1
    inputs = [stage, FrameStart() if frame_start is None else frame_start, pose, lens]
    inputs += [tables.shapes, tables.materials, tables.meshes, tables.height_fields]
    inputs += [FlowHistory() if history is None else history]
    threads = LIST_THREADS * -(-tables.num_worlds // each)
    return bind_launch(_kernel(key), threads, inputs, device, block_dim=LIST_THREADS, key=key)
