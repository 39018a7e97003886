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

from warpcam.kernels.layers import Mirror
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.closest_hit import closest_hit_kernel
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.passes.views import is_finite
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.trace import MirrorKey
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.kernels.runtime.launch import BLOCK_DIM, Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import BOX, Materials, Shapes, View

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
def _target_struct(seen_dtype: Any, shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of the arrays that the trace of the mirrored view reads and writes. No image is mirrored.

    ``shape`` is -2 where the mirror shows nothing and -1 where no mirror is seen; ``depth`` is from the mirrored view.
    """
    fields = visible_fields(shape_dtype, face_dtype) | {
        "faults": wp.array(dtype=wp.uint8),  # (world,) set to 1 where a pose or size is not finite or 0
        "mirrors": wp.array(dtype=Mirror),  # (world,)
        "transparent_index": wp.array(dtype=wp.int32),  # (shape,) not -1 for shapes that may be transparent
        "seen_depth": wp.array(dtype=wp.float32),  # planar depth of what the view itself sees [m]
        "seen_shape": wp.array(dtype=seen_dtype),  # shape id of it
    }
    return make_struct("MirrorTarget", fields)


@functools.cache
def _kernel(key: MirrorKey, target_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.native, int(key.lens), key.capacity, key.region
    flag, face = ("true" if key.several else "false"), ("true" if key.faces else "false")
    function = f"draw_mirrored<{types}, {lens}, {capacity}, {flag}, {width}, {height}, {face}>"
    return closest_hit_kernel("shading_pass/mirror_visibility.h", function, key.blocks, target_type)


@register("mirrors")
def bind_mirrors(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the stage that finds each world's mirror, and writes the view from behind it where there is one."""
    tables, layers = frame.tables, frame.layers
    arguments = [tables.shapes, tables.materials, layers.mirrors, layers.reflectance, frame.mask, frame.views]
    return frame.launch(planned, write_mirrors, [*arguments, frame.width, frame.mirrors, frame.mirrored], BLOCK_DIM)


@register("trace in mirrors")
def bind_trace(planned: PlannedPass[MirrorKey], frame: CameraFrame) -> Stage:
    """Bind the trace of what one camera sees in mirrors; see ``_target_struct`` for the buffers."""
    tables = frame.tables
    seen_shape = frame.get(planned, "seen shape")
    target_type, target = frame.visible(planned, functools.partial(_target_struct, seen_shape.dtype))
    target.faults, target.mirrors = frame.faults, frame.mirrors
    target.transparent_index = frame.layers.transparent_index
    target.seen_depth, target.seen_shape = frame.get(planned, "seen depth"), seen_shape
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, frame.mirrored, target]
    return frame.launch(planned, _kernel(planned.key, target_type), arguments)
