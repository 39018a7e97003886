"""Visibility: what each pixel sees, and the outputs that follow from it at once."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.flags import TraceFlag
from warpcam.kernels.passes.camera_frame import CameraFrame, dtype_of
from warpcam.kernels.passes.closest_hit import closest_hit_kernel
from warpcam.kernels.passes.trace_target import target_struct
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.trace import ARRAYS, TraceKey
from warpcam.kernels.runtime.launch import Stage


@functools.cache
def _kernel(key: TraceKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.native, int(key.lens), key.capacity, key.region
    flag, outputs = "true" if key.several else "false", int(key.outputs)
    header, function = (
        "traversal/visibility.h",
        f"draw<{types}, {lens}, {capacity}, {flag}, {width}, {height}, {outputs}>",
    )
    if key.outputs & TraceFlag.LISTED_AHEAD:
        header, function = "traversal/visibility_listed.h", function.replace("draw", "draw_listed")
    if key.outputs & TraceFlag.TRACE_ALBEDO:
        header, function = (
            "shading_pass/visibility_albedo.h",
            f"draw_with_albedo<{types}, {capacity}, {width}, {height}, {outputs}, {int(key.flags)}>",
        )
    return closest_hit_kernel(header, function, key.blocks, target_type)


def _kind(outputs: TraceFlag) -> str:
    """Kind of the target: see ``target_struct``."""
    if outputs & (TraceFlag.FLOW | TraceFlag.FLOW_VALID):
        return "flow"
    if outputs & TraceFlag.TRACE_ALBEDO:
        return "albedo"
    return "opaque" if outputs & TraceFlag.OPAQUE else "plain"


@register("trace")
def bind(planned: PlannedPass[TraceKey], frame: CameraFrame) -> Stage:
    """Bind the trace of one camera."""
    key, tables = planned.key, frame.tables
    kind = _kind(key.outputs)
    shape, face = frame.find(planned, "shape"), frame.find(planned, "face")
    target_type = target_struct(kind, dtype_of(shape), dtype_of(face))
    target = frame.fill(planned, target_type(), (*ARRAYS, "ids"))
    target.mask, target.faults = frame.mask, frame.faults
    target.width, target.height = frame.width, frame.height
    if kind == "flow":
        target.history = frame.flow_history
    elif kind == "albedo":
        target.albedo = frame.get(planned, "albedo")
        target.textures, target.plane = tables.textures, tables.first_plane
    for role, table in (("instances", "instance_of"), ("semantics", "semantic_of")):
        if (image := frame.find(planned, role)) is not None:
            setattr(target.labels, role, image)
            setattr(target.labels, table, tables.labels[role])
    if key.outputs & TraceFlag.OPAQUE:
        target.transparent_index = frame.layers.transparent_index
    if frame.lists is not None and kind != "albedo":
        target.lists = frame.lists
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, frame.views, target]
    return frame.launch(planned, _kernel(key, target_type), arguments)
