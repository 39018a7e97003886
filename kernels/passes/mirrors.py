"""Mirrors: what of a scene reflects in one view, and the view from behind it.

MuJoCo's rule: of a frame one surface reflects, the first of the shapes in their order that is a solid plane, seen from
its front, or a solid box, by its +z side, and whose material has reflectance. It shows its own colour and, added to
that, the mirrored scene without shadows, its colours but not its highlights times the reflectance.

The mirrored view is a camera of the usual kind, on the other side of the mirror. Its image is the other way round from
left to right, and what lies between it and the mirror is not seen.
"""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.layers import LayerTables, Mirror
from warpcam.kernels.passes.views import is_finite
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.trace import MirrorKey, plan_mirror
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import BOX, HeightFields, Materials, Meshes, Shapes, View

wp.set_module_options(compiler_flags())

OPAQUE_ABOVE = 0.995  # opacity from which MuJoCo draws a shape solid


@wp.func
def opacity_of(shapes: Shapes, materials: Materials, world: int, shape: int) -> wp.float32:
    """MuJoCo's rule of which colour counts: native/shading/appearance.h."""
    color = shapes.colors[world % shapes.colors.shape[0], shape]
    material = shapes.materials[world % shapes.materials.shape[0], shape]
    if (
        material >= 0
        and material < materials.color.shape[1]
        and color[0] == 0.5
        and color[1] == 0.5
        and color[2] == 0.5
        and color[3] == 1.0
    ):
        color = materials.color[world % materials.color.shape[0], material]
    return color[3]


@wp.kernel(enable_backward=False)
def write_mirrors(
    shapes: Shapes,
    materials: Materials,
    candidates: wp.array(dtype=wp.int32),
    reflectance: wp.array(dtype=wp.float32),
    mask: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    width: wp.int32,
    mirrors: wp.array(dtype=Mirror),
    mirrored: wp.array(dtype=View),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] == wp.uint8(0):
        return
    view = views[world]
    found = wp.int32(-1)
    reflects = wp.float32(0.0)
    point = wp.vec3()
    normal = wp.vec3()
    for i in range(candidates.shape[0]):
        shape = candidates[i]
        material = shapes.materials[world % shapes.materials.shape[0], shape]
        if found < 0 and material >= 0 and material < reflectance.shape[0]:
            rotation = shapes.rotations[world, shape]
            axis = wp.vec3(rotation[0, 2], rotation[1, 2], rotation[2, 2])
            place = shapes.positions[world, shape]
            box = shapes.types[shape] == BOX
            strength = reflectance[material]
            seen = box or wp.dot(axis, view.origin - place) >= 0.0
            if seen and strength > 0.0 and opacity_of(shapes, materials, world, shape) >= OPAQUE_ABOVE:
                found = shape
                reflects = strength
                normal = axis
                point = place
                if box:
                    point = place + shapes.sizes[world % shapes.sizes.shape[0], shape][2] * axis
    mirror = Mirror()
    mirror.shape = -1
    height = wp.dot(normal, view.origin - point)
    if found >= 0 and height > 0.0 and is_finite(view.origin + point, view.rotation, view.scale, view.center):
        mirror.shape = found
        mirror.strength = reflects
        behind = View()
        behind.near = view.near
        behind.far = view.far
        behind.miss = wp.inf
        behind.scale = view.scale
        behind.center = wp.vec2(wp.float32(width) - view.center[0], view.center[1])
        behind.origin = view.origin - 2.0 * height * normal
        turned = view.rotation - 2.0 * wp.outer(normal, wp.transpose(view.rotation) * normal)
        for row in range(3):
            turned[row, 0] = -turned[row, 0]
        behind.rotation = turned
        mirrored[world] = behind
        mirror.normal = wp.transpose(turned) * normal
        mirror.distance = height
        backward = wp.vec3(view.rotation[0, 2], view.rotation[1, 2], view.rotation[2, 2])
        mirror.headlight = wp.transpose(turned) * backward
        mirror.eye = view.origin
    mirrors[world] = mirror


@functools.cache
def _target_struct(shape_dtype: Any, face_dtype: Any, seen_dtype: Any) -> Any:
    """Arrays that the trace of the mirrored view reads and writes.

    Each image is (world * height * width,) and not mirrored.
    """

    @wp.struct
    class MirrorTarget:
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        faults: wp.array(dtype=wp.uint8)  # (world,) set to 1 where a pose or size is not a number
        mirrors: wp.array(dtype=Mirror)  # (world,)
        veil_places: wp.array(dtype=wp.int32)  # (shape,) not -1 for shapes that may be transparent
        seen_depth: wp.array(dtype=wp.float32)  # planar depth of what the view itself sees [m]
        seen_shape: wp.array(dtype=seen_dtype)  # shape id of it
        depth: wp.array(dtype=wp.float32)  # planar depth of what is seen in the mirror, from the mirrored view [m]
        shape: wp.array(dtype=shape_dtype)  # shape id, -2 where the mirror shows nothing, -1 where no mirror is seen
        face: wp.array(dtype=face_dtype)  # as trace_target.target_struct has it; empty for a scene without meshes
        width: wp.int32
        height: wp.int32

    return MirrorTarget


@functools.cache
def _kernel(key: MirrorKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.bits, int(key.lens), key.capacity, key.region
    flag, face = ("true" if key.several else "false"), ("true" if key.faces else "false")

    @wp.func_native(
        f"warpcam::draw_mirrored<{types}, {lens}, {capacity}, {flag}, {width}, {height}, {face}>"
        "(shapes, materials, meshes, fields, views, target, index);"
    )
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
        module_options=native_module("shading_pass/mirror_visibility.h"),
    )
    def reflection(
        shapes: Shapes,
        materials: Materials,
        meshes: Meshes,
        fields: HeightFields,
        views: wp.array(dtype=View),
        target: target_type,
        first: wp.int32,
    ):
        draw(shapes, materials, meshes, fields, views, target, first + wp.tid())

    return reflection


def bind_mirrors(
    tables: SceneTables,
    layers: LayerTables,
    views: wp.array,
    mask: wp.array,
    width: int,
    mirrors: wp.array,
    mirrored: wp.array,
    device: wp.Device,
    group: Group,
) -> Stage:
    """Bind the stage that finds each world's mirror and the view from behind it.

    Args:
        tables: The scene.
        layers: What of it reflects.
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        width: Of the image [pixels].
        mirrors: Mirror, (world,); written.
        mirrored: View, (world,); written where there is a mirror.
        device: Where all of these lie.
        group: Which worlds.
    """
    arguments = [
        tables.shapes, tables.materials, layers.mirrors, layers.reflectance, mask, views, width, mirrors, mirrored
    ]  # fmt: skip
    return bind_launch(write_mirrors, len(group.worlds), arguments, device, start=group.worlds.start)


def bind_trace(
    tables: SceneTables,
    layers: LayerTables,
    lens: str,
    mirrored: wp.array,
    mirrors: wp.array,
    mask: wp.array,
    faults: wp.array,
    seen_depth: wp.array,
    seen_shape: wp.array,
    depth: wp.array,
    shape: wp.array,
    face: wp.array | None,
    width: int,
    height: int,
    device: wp.Device,
    group: Group,
) -> Stage:
    """Bind the trace of what one camera sees in mirrors; see ``_target_struct`` for the buffers."""
    target_type = _target_struct(shape.dtype, wp.int32 if face is None else face.dtype, seen_shape.dtype)
    target = target_type()
    target.mask, target.faults, target.mirrors = mask, faults, mirrors
    target.veil_places = layers.transparent_index
    target.seen_depth, target.seen_shape = seen_depth.flatten(), seen_shape.flatten()
    target.depth, target.shape = depth.flatten(), shape.flatten()
    if face is not None:
        target.face = face.flatten()
    target.width, target.height = width, height
    plan = plan_mirror(tables, lens, width, height, face is not None, device, group)
    kernel, unit = _kernel(plan.key, target_type), plan.threads
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, mirrored, target]
    return bind_launch(
        kernel,
        len(group.worlds) * unit,
        arguments,
        device,
        start=group.worlds.start * unit,
        block_dim=THREADS,
        key=plan.key,
    )
