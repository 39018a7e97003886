"""From the visibility buffer to images: one kernel per camera writes every output that was asked for."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.flags import ShadingFlag
from warpcam.kernels.layers import Haze, Mirror
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame, dtype_of
from warpcam.kernels.passes.trace_target import visible_fields
from warpcam.kernels.passes.world_overrides import WorldOverrides
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.shading import IMAGES, LAYER_FLAGS, OVERRIDE_FLAGS, ShadingKey
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import (
    Background,
    HeightFields,
    Lights,
    Materials,
    Meshes,
    Physical,
    Shapes,
    Textures,
    View,
)

# Images of light that earlier passes found, with the flags of kernels that read them. "indirect": from shapes, the mean
# by cosine, and in w the share of light from beyond them; "reflections": light that is added to a pixel's, and in w
# what its own is multiplied by before.
LIGHT_IMAGES = {"indirect": ShadingFlag.INDIRECT_LIGHT, "reflections": ShadingFlag.HAS_REFLECTIONS}


@functools.cache
def frame_struct(kind: str, visible_dtype: Any, light: tuple[str, ...], shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of one camera's visibility in all worlds: what the kernel reads.

    Args:
        kind: "plain"; "layered": with mirrors, transparent shapes and haze; "overridden": with what worlds have each
            for themselves, too. What was not asked for of these is empty.
        visible_dtype: Type of the shares of light that reach a pixel, see occlusion.py; None where there are none.
        light: Of LIGHT_IMAGES, those that there are.
        shape_dtype: Integer type of shape ids.
        face_dtype: Integer type of faces.
    """
    fields = {"views": wp.array(dtype=View)}  # (world,)
    fields |= visible_fields(shape_dtype, face_dtype) | {
        "shadow": wp.array(dtype=wp.uint8),  # (pixel,) as the shadow pass wrote it; empty without shadows
        "horizon": wp.float32,  # how far the camera of MuJoCo's renderer sees [m]; see native/shading/plane_grid.h
        # id of the plane whose corners are kept, or -1; native/shading/plane_vertex_lighting.h. With several planes it
        # is the first one, and CUDA's regions may choose another.
        "plane": wp.int32,
        "planes": wp.int32,  # how many there are
    }
    if visible_dtype is not None:
        fields["visible"] = wp.array(dtype=visible_dtype)  # (pixel,)
    fields |= dict.fromkeys(light, wp.array(dtype=wp.vec4))  # (pixel,)
    if kind != "plain":
        fields |= {
            "mirrors": wp.array(dtype=Mirror),  # (world,)
            "transparent_shapes": wp.array(dtype=wp.int32),  # ids of the shapes that may be transparent
            "reach": wp.array(dtype=wp.float32),  # (shape,) see layers.py
            "haze": Haze,
        }
    if kind == "overridden":
        fields["overrides"] = WorldOverrides
    return make_struct(f"{kind.capitalize()}Frame", fields)


@functools.cache
def images_struct() -> Any:
    """Struct of the images that the kernel writes, channel after channel; empty if not asked for."""
    return make_struct("ShadedImages", {name: wp.array(dtype=OUTPUTS[name].dtype) for name in IMAGES})


@functools.cache
def _kernel(key: ShadingKey, frame_type: Any) -> wp.Kernel:
    images_type = images_struct()
    types, lens, capacity, (width, height) = key.types.native, int(key.lens), key.capacity, key.region
    written, flags = int(key.images), int(key.flags)
    more = f", {key.transparent}" if key.transparent else ""
    lights_type: Any = Lights
    scene = "warpcam::Scene { frame, images, shapes, meshes, fields, materials, textures, background }"
    if key.flags & ShadingFlag.PHYSICAL:
        lights_type = Physical
        scene = f"warpcam::PhysicalScene {{ {scene}, lights }}"

    return make_kernel(
        "write_images",
        f"warpcam::resolve<{types}, {lens}, {capacity}, {width}, {height}, {written}, {flags}{more}>"
        f"({scene}, lights, index);",
        {
            "frame": frame_type,
            "images": images_type,
            "shapes": Shapes,
            "meshes": Meshes,
            "fields": HeightFields,
            "materials": Materials,
            "textures": Textures,
            "lights": lights_type,
            "background": Background,
        },
        native_module("shading_pass/shading_pass.h"),
        (THREADS, key.blocks),
    )


@register("shading", needs=("depth", "shape", "face"), writes=tuple(IMAGES))
def bind(planned: PlannedPass[ShadingKey], frame: CameraFrame) -> Stage:
    """Bind the kernel that writes one camera's derived images.

    Of the view from behind mirrors the images are what the mirrors show, black where they show nothing. In the view
    itself that lies in the images already, and is added to.
    """
    tables, flags = frame.tables, planned.key.flags
    more, varied = flags & LAYER_FLAGS, flags & OVERRIDE_FLAGS and tables.world_overrides is not None
    light = tuple(name for name, flag in LIGHT_IMAGES.items() if flags & flag)
    kind = "overridden" if varied else "layered" if more else "plain"
    visible = dtype_of(frame.find(planned, "visible"), None)
    frame_type, seen = frame.visible(planned, functools.partial(frame_struct, kind, visible, light))
    if varied:
        seen.overrides = tables.world_overrides
    if more:
        seen.transparent_shapes, seen.reach = frame.layers.transparent_shapes, frame.layers.reach
        seen.mirrors = frame.mirrors
        if frame.layers.haze is not None:
            seen.haze = frame.layers.haze
    seen.views = frame.mirrored if flags & ShadingFlag.MIRROR_VIEW else frame.views
    frame.fill(planned, seen, ("shadow", "visible", *light))
    seen.horizon, seen.plane, seen.planes = tables.horizon, tables.first_plane, len(tables.planes)
    images = frame.fill(planned, images_struct()(), IMAGES)
    lights, scene = tables.physical or tables.lights, (tables.shapes, tables.meshes, tables.height_fields)
    arguments = [seen, images, *scene, tables.materials, tables.textures, lights, tables.background]
    return frame.launch(planned, _kernel(planned.key, frame_type), arguments)
