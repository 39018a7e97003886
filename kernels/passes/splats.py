"""Clouds of Gaussians, blended over the finished images; where half the light is lost, they are the surface."""

import functools
from typing import Any

import warp as wp

from warpcam.kernels.flags import SplatFlag
from warpcam.kernels.outputs import OUTPUTS
from warpcam.kernels.passes.camera_frame import CameraFrame
from warpcam.kernels.passes.flow import FlowHistory
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.passes import register
from warpcam.kernels.plan.planned_pass import PlannedPass
from warpcam.kernels.plan.splats import IMAGES, SplatKey
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.kernels import make_kernel
from warpcam.kernels.runtime.launch import BLOCK_DIM, Stage
from warpcam.kernels.runtime.structs import make_struct
from warpcam.kernels.types import Shapes, Splats, View

wp.set_module_options(compiler_flags())


@functools.cache
def _images_struct() -> Any:
    """Struct of the images that Gaussians are drawn over, channel after channel of pixel after pixel.

    Those that were not asked for are empty.
    """
    labels = {name: wp.array2d(dtype=wp.int32) for name in ("instance_of", "semantic_of")}  # (world or 1, shape)
    return make_struct("SplatImages", {name: wp.array(dtype=OUTPUTS[name].dtype) for name in IMAGES} | labels)


@functools.cache
def _frame_struct(kind: str, shape_dtype: Any) -> Any:
    """Struct of one camera's visibility in all worlds: what the clouds are in front of.

    Args:
        kind: "plain"; "flow": with its history; "exposed": with exposures, too; "solid": with the limits of solid
            clouds, too. What was not asked for of these is empty.
        shape_dtype: Integer type of shape ids.
    """
    fields: dict[str, Any] = {
        "views": wp.array(dtype=View),  # (world,)
        "mask": wp.array(dtype=wp.uint8),  # (world,) 0 leaves the world's images alone
        "depth": wp.array(dtype=wp.float32),  # (pixel,) planar depth [m]
        "shape": wp.array(dtype=shape_dtype),  # (pixel,) or -1 where nothing was hit
        "width": wp.int32,
        "height": wp.int32,
    }
    if kind != "plain":
        fields["history"] = FlowHistory
    if kind in ("exposed", "solid"):
        fields["exposures"] = wp.array(dtype=wp.float32)  # (world,) power of two that all light is multiplied by
        fields["gains"] = wp.array(dtype=wp.vec3)  # (world,) factors of red, green and blue
    if kind == "solid":
        fields["limits"] = wp.array(dtype=wp.vec2)  # (1,) see SceneTables.splat_limits
    return make_struct(f"{kind.capitalize()}SplatFrame", fields)


@functools.cache
def _kernel(key: SplatKey, frame_type: Any, images_type: Any) -> wp.Kernel:
    return make_kernel(
        "blend_splats",
        f"warpcam::draw_splats<{int(key.lens)}, {key.capacity}, {key.wanted}>"
        "(warpcam::SplatScene{frame, images, shapes, splats}, index);",
        {"frame": frame_type, "images": images_type, "shapes": Shapes, "splats": Splats},
        native_module("splats/gaussian_blend.h"),
        (THREADS, key.blocks),
    )


@wp.kernel(enable_backward=False)
def find_broken(
    shapes: Shapes,
    splats: Splats,
    mask: wp.array(dtype=wp.uint8),
    faults: wp.array(dtype=wp.uint8),
    views: wp.array(dtype=View),
    first: wp.int32,
):
    world = first + wp.tid()
    if mask[world] == wp.uint8(0):
        return
    for i in range(splats.columns.shape[0]):
        shape = splats.columns[i]
        color = shapes.colors[world % shapes.colors.shape[0], shape]
        if color[3] > 0.0:
            position = shapes.positions[world, shape]
            rotation = shapes.rotations[world, shape]
            size = shapes.sizes[world % shapes.sizes.shape[0], shape]
            total = position[0] + position[1] + position[2] + size[0] + size[1] + size[2]
            for j in range(3):
                for k in range(3):
                    total += rotation[j, k]
            if wp.ddot(rotation, rotation) == 0.0 or wp.dot(size, size) == 0.0:
                faults[world] = wp.uint8(1)
            if not wp.isfinite(total):
                faults[world] = wp.uint8(1)
                view = views[world]
                view.origin = wp.vec3(wp.nan, wp.nan, wp.nan)
                views[world] = view


@register("check of Gaussians")
def bind_check(planned: PlannedPass[None], frame: CameraFrame) -> Stage:
    """Bind the stage that breaks the views of worlds where a cloud's pose or size is not a number.

    Clouds whose rotation or size is 0 are missing there, which is a fault, too.
    """
    inputs = [frame.tables.shapes, frame.tables.splats, frame.mask, frame.faults, frame.views]
    return frame.launch(planned, find_broken, inputs, BLOCK_DIM)


@register("Gaussians", needs=("depth", "shape"))
def bind(planned: PlannedPass[SplatKey], frame: CameraFrame) -> Stage:
    """Bind the stage that draws clouds over one camera's images, which are else finished."""
    tables, key = frame.tables, planned.key
    exposed, solid = bool(key.images & SplatFlag.EXPOSED), bool(key.images & SplatFlag.SOLID)
    kind = "solid" if solid else "exposed" if exposed else "flow" if key.flow else "plain"
    shape = frame.get(planned, "seen shape")
    frame_type, images_type = _frame_struct(kind, shape.dtype), _images_struct()
    behind = frame_type()
    if exposed:
        behind.exposures, behind.gains = tables.world_overrides.exposures, tables.world_overrides.gains
    if solid:
        behind.limits = tables.splat_limits
    if key.flow:
        behind.history = frame.flow_history
    behind.views, behind.mask = frame.views, frame.mask
    behind.depth, behind.shape = frame.get(planned, "seen depth"), shape
    behind.width, behind.height = frame.width, frame.height
    changed = frame.fill(planned, images_type(), IMAGES)
    changed.instance_of, changed.semantic_of = tables.labels["instances"], tables.labels["semantics"]
    arguments = [behind, changed, tables.shapes, tables.splats]
    return frame.launch(planned, _kernel(key, frame_type, images_type), arguments)
