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


@functools.cache
def _kernel(key: ListKey) -> wp.Kernel:
    types, lens, capacity, wanted = key.types.native, int(key.lens), key.capacity, int(key.outputs)
    function = f"list_worlds<{types}, {lens}, {capacity}, {wanted}>"

    @wp.func_native(f"warpcam::begin_listing<{capacity}, {wanted}>(shapes, lists, world, worlds, slot, shape, thread);")
    def begin_listing(
        shapes: Shapes,
        lists: wp.array(dtype=wp.vec4),
        world: int,
        worlds: int,
        slot: int,
        shape: int,
        thread: int,
    ): ...

    @wp.func_native(
        f"warpcam::{function}(now, state, shapes, materials, meshes, fields, history, lists, faults, columns, "
        "width, height, compact, world, worlds, slot, shape, thread);"
    )
    def list_worlds(
        now: View,
        state: int,
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        history: FlowHistory,
        lists: wp.array(dtype=wp.vec4),
        faults: wp.array(dtype=wp.uint8),
        columns: int,
        width: int,
        height: int,
        compact: int,
        world: int,
        worlds: int,
        slot: int,
        shape: int,
        thread: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(LIST_THREADS, key.blocks),
        module_options=native_module("traversal/view_shape_list.h"),
    )
    def write_views_and_lists(
        starts: wp.int32,
        frame_start: FrameStart,
        pose: CameraPose,
        lens: LensParams,
        mask: wp.array(dtype=wp.uint8),
        faults: wp.array(dtype=wp.uint8),
        views: wp.array(dtype=View),
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        history: FlowHistory,
        lists: wp.array(dtype=wp.vec4),
        columns: wp.int32,
        compact: wp.int32,
        worlds_each: wp.int32,
        rate: wp.int32,
        first: wp.int32,
    ):
        index = wp.uint32(first + wp.tid())
        block = wp.int32(index // wp.uint32(LIST_THREADS))
        thread = wp.int32(index) - block * LIST_THREADS
        begin = block * worlds_each
        worlds = wp.min(worlds_each, views.shape[0] - begin)
        slot = (thread * rate) >> 16
        shape = thread - slot * columns
        begin_listing(shapes, lists, begin, worlds, slot, shape, thread)
        now = View()
        state = wp.int32(0)
        if thread < worlds:
            world = begin + thread
            drawn = starts != 0 and frame_start.everything != 0
            if not drawn:
                drawn = mask[world] != wp.uint8(0)
            if drawn:
                state = wp.int32(1)
                if history.frame_state.shape[0] > 0:
                    state = wp.int32(history.frame_state[world])
                count = wp.int32(0)  # loaded with the rest: memory is waited for once
                known = wp.int32(0)
                time = wp.float32(0.0)
                if starts != 0:
                    count = frame_start.frames[world]
                    if frame_start.frame_state.shape[0] > 0:
                        known = wp.int32(frame_start.frame_state[world])
                    if world < frame_start.clock.shape[0]:
                        time = frame_start.clock[world]
                    faults[world] = wp.uint8(0)
                now = view_of(world, pose, lens, faults)
                views[world] = now
                if starts != 0:
                    mask[world] = wp.uint8(1)
                    frame_start.frames[world] = count + 1
                    if frame_start.frame_state.shape[0] > 0:
                        frame_start.frame_state[world] = wp.uint8(next_frame_state(known))
                    if world < frame_start.clock.shape[0]:
                        frame_start.times[world] = time
                    if history.frame_state.shape[0] > 0:
                        state = next_frame_state(state)
        list_worlds(
            now,
            state,
            shapes,
            materials,
            meshes,
            fields,
            history,
            lists,
            faults,
            columns,
            lens.width,
            lens.height,
            compact,
            begin,
            worlds,
            slot,
            shape,
            thread,
        )

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
    starts = int(frame_start is not None)
    frame_start = FrameStart() if frame_start is None else frame_start
    each = min(LANES, LIST_THREADS // tables.num_shapes)
    inputs = [starts, frame_start, pose, lens, mask, faults, views, tables.shapes, tables.materials, tables.meshes]
    inputs += [tables.height_fields, FlowHistory() if history is None else history, lists.flatten(), tables.num_shapes]
    inputs += [int(is_compact(tables)), each, 2**16 // tables.num_shapes + 1]
    threads = LIST_THREADS * -(-tables.num_worlds // each)
    return bind_launch(_kernel(key), threads, inputs, device, block_dim=LIST_THREADS, key=key)
