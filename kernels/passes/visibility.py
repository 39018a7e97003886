"""The trace: for each pixel of a camera's views the nearest shape, its face and its depth."""

import functools
from collections.abc import Mapping
from typing import Any

import warp as wp

from warpcam.kernels.flags import NO_FACTS, ShadingFlag, TraceFlag
from warpcam.kernels.passes.trace_target import (
    albedo_target_struct,
    flow_target_struct,
    opaque_target_struct,
    target_struct,
)
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.trace import ARRAYS, LABELS, TraceKey, plan_trace
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HeightFields, Materials, Meshes, Shapes, View


@functools.cache
def _kernel(key: TraceKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.bits, int(key.lens), key.capacity, key.region
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
            f"draw_painted<{types}, {capacity}, {width}, {height}, {outputs}, {int(key.facts)}>",
        )

    @wp.func_native(f"warpcam::{function}(shapes, materials, meshes, fields, views, target, index);")
    def draw(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        index: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(THREADS, key.blocks),
        module_options=native_module(header),
    )
    def visibility(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        first: wp.int32,
    ):
        draw(shapes, materials, meshes, fields, views, target, first + wp.tid())

    return visibility


def bind(
    tables: SceneTables,
    lens: str,
    views: wp.array,
    mask: wp.array,
    faults: wp.array,
    width: int,
    height: int,
    depth: wp.array | None,
    shape: wp.array | None,
    face: wp.array | None,
    images: Mapping[str, wp.array],
    device: wp.Device,
    group: Group | None = None,
    transparent_index: wp.array | None = None,
    flow_history: Any = None,
    facts: ShadingFlag = NO_FACTS,
    lists: wp.array | None = None,
) -> Stage:
    """Bind the trace of one camera.

    Args:
        tables: The scene.
        lens: One of ``launches.LENSES``. With a table of rays, depth is the distance along the ray, and "distance" the
            planar depth.
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        faults: uint8, (world,); set to 1 where a pose or size is not a number.
        width: Image width [pixels].
        height: Image height [pixels].
        depth: float32, (world, height, width, ...), or None if it is not wanted. A scene of more than MAX_LISTED
            shapes, on a CPU MANY_LISTED, is drawn in passes, which go on from each other's depth and shape: then both
            are needed.
        shape: An integer type that holds every shape id and -1, likewise.
        face: An integer type that holds every face, and of height fields one number more, likewise; see
            ``target_struct``.
        images: "distance", "points", "bodies", "ids", "normals", "instances", "semantics", "flow", "flow_valid" and
            "albedo", those that are wanted, (world, height, width, channels); normals only for scenes without meshes
            and height fields, albedo where ``plan.trace.traces_albedo`` says so.
        device: Where all of these lie.
        group: Which worlds are traced; None is all.
        transparent_index: int32, (shape,). With it shapes that are transparent are left out, of those where it is not
            -1; there are no ``images`` then.
        flow_history: FlowHistory, where flow is wanted.
        facts: Of the scene's looks, where albedo is: see shading.py.
        lists: vec4, (world, row): the shapes listed for these views, by view_shape_lists.py, if they are.
    """
    group = group or Group.of_all(views.shape[0])
    struct = target_struct if transparent_index is None else opaque_target_struct
    if "flow" in images or "flow_valid" in images:
        struct = flow_target_struct
    elif "albedo" in images:
        struct = albedo_target_struct
    target_type = struct(_dtype(shape), _dtype(face))
    target = target_type()
    target.mask, target.faults = mask, faults
    target.width, target.height = width, height
    arrays = {"depth": depth, "shape": shape, "face": face, **images}
    for name in ARRAYS:
        if arrays.get(name) is not None:
            setattr(target, name, flatten(arrays[name]))
    if struct is flow_target_struct:
        target.trail = flow_history
    elif struct is albedo_target_struct:
        target.albedo = flatten(images["albedo"])
        target.textures, target.plane = tables.textures, tables.first_plane
    if "ids" in images:
        target.ids = images["ids"].flatten()
    for name in LABELS:
        if name in images:
            setattr(target.labels, name, images[name].flatten())
    if "instances" in images:
        target.labels.instance_of = tables.labels["instances"]
    if "semantics" in images:
        target.labels.semantic_of = tables.labels["semantics"]
    if transparent_index is not None:
        target.veil_places = transparent_index
    if lists is not None:
        target.lists = lists.flatten()
    written = [name for name, array in arrays.items() if array is not None]
    opaque, listed = transparent_index is not None, lists is not None
    plan = plan_trace(tables, lens, width, height, written, facts, device, group, opaque=opaque, listed=listed)
    kernel, unit = _kernel(plan.key, target_type), plan.threads
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, views, target]
    return bind_launch(
        kernel,
        len(group.worlds) * unit,
        arguments,
        device,
        start=group.worlds.start * unit,
        block_dim=THREADS,
        key=plan.key,
    )


def _dtype(array: wp.array | None) -> Any:
    return wp.int32 if array is None else array.dtype
