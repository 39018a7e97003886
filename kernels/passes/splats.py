"""Clouds of Gaussians, blended over the finished images; where half the light is lost, they are the surface."""

import functools
from collections.abc import Mapping
from typing import Any

import warp as wp

from warpcam.kernels.flags import SplatFlag
from warpcam.kernels.passes.flow import FlowHistory
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.splats import SplatKey, plan_splats
from warpcam.kernels.runtime.compile import compiler_flags, native_module
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import Shapes, Splats, View

wp.set_module_options(compiler_flags())

# The images that clouds change, and the dtypes of their arrays.
OUTPUTS: Mapping[str, type] = {
    "rgb": wp.uint8,
    "rgba": wp.uint8,
    "hdr": wp.float32,
    "albedo": wp.uint8,
    "depth": wp.float32,
    "distance": wp.float32,
    "points": wp.float32,
    "normals": wp.float32,
    "segmentation": wp.int32,
    "bodies": wp.int32,
    "instances": wp.int32,
    "semantics": wp.int32,
}


@wp.struct
class SplatImages:
    """Images that Gaussians are drawn over, channel after channel of pixel after pixel; empty if not asked for."""

    rgb: wp.array(dtype=wp.uint8)
    rgba: wp.array(dtype=wp.uint8)
    hdr: wp.array(dtype=wp.float32)
    albedo: wp.array(dtype=wp.uint8)
    depth: wp.array(dtype=wp.float32)
    distance: wp.array(dtype=wp.float32)
    points: wp.array(dtype=wp.float32)
    normals: wp.array(dtype=wp.float32)
    segmentation: wp.array(dtype=wp.int32)
    bodies: wp.array(dtype=wp.int32)
    instances: wp.array(dtype=wp.int32)
    semantics: wp.array(dtype=wp.int32)
    instance_of: wp.array2d(dtype=wp.int32)  # (world or 1, shape) labels
    semantic_of: wp.array2d(dtype=wp.int32)  # (world or 1, shape)


@functools.cache
def _frame_struct(shape_dtype: Any) -> Any:
    """One camera's visibility in all worlds: what the clouds are in front of."""

    @wp.struct
    class Frame:
        views: wp.array(dtype=View)  # (world,)
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        depth: wp.array(dtype=wp.float32)  # (pixel,) planar depth [m]
        shape: wp.array(dtype=shape_dtype)  # (pixel,) or -1 where nothing was hit
        width: wp.int32
        height: wp.int32

    return Frame


@functools.cache
def _flow_frame_struct(shape_dtype: Any) -> Any:
    """Struct of one camera's images with the history of flow."""

    @wp.struct
    class FlowFrame:
        views: wp.array(dtype=View)
        mask: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        width: wp.int32
        height: wp.int32
        trail: FlowHistory

    return FlowFrame


@functools.cache
def _exposed_frame_struct(shape_dtype: Any) -> Any:
    """Struct of one camera's images with its exposures; the history of flow may be empty."""

    @wp.struct
    class ExposedFrame:
        views: wp.array(dtype=View)
        mask: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        width: wp.int32
        height: wp.int32
        trail: FlowHistory
        exposures: wp.array(dtype=wp.float32)  # (world,) power of two that all light is multiplied by
        gains: wp.array(dtype=wp.vec3)  # (world,) factors of red, green and blue

    return ExposedFrame


@functools.cache
def _solid_frame_struct(shape_dtype: Any) -> Any:
    """Struct of one camera's images for solid clouds; the history of flow and the exposures may be empty."""

    @wp.struct
    class SolidFrame:
        views: wp.array(dtype=View)
        mask: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        width: wp.int32
        height: wp.int32
        trail: FlowHistory
        exposures: wp.array(dtype=wp.float32)
        gains: wp.array(dtype=wp.vec3)
        limits: wp.array(dtype=wp.vec2)  # (1,) see SceneTables.splat_limits

    return SolidFrame


@functools.cache
def _kernel(key: SplatKey, frame_type: Any) -> wp.Kernel:
    @wp.func_native(
        f"warpcam::draw_splats<{int(key.lens)}, {key.capacity}, {key.wanted}>"
        "(warpcam::SplatScene{frame, images, shapes, splats}, index);"
    )
    def draw(frame: frame_type, images: SplatImages, shapes: Shapes, splats: Splats, index: int): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(THREADS, key.blocks),
        module_options=native_module("splats/gaussian_blend.h"),
    )
    def blend_splats(frame: frame_type, images: SplatImages, shapes: Shapes, splats: Splats, first: wp.int32):
        draw(frame, images, shapes, splats, first + wp.tid())

    return blend_splats


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
            if not wp.isfinite(total):
                faults[world] = wp.uint8(1)
                view = views[world]
                view.origin = wp.vec3(wp.nan, wp.nan, wp.nan)
                views[world] = view


def bind_check(
    tables: SceneTables, views: wp.array, mask: wp.array, faults: wp.array, device: wp.Device, group: Group
) -> Stage:
    """Bind the stage that breaks the views of worlds where a cloud's pose or size is not a number.

    Args:
        tables: The scene; it has splats.
        views: View, (world,); written.
        mask: uint8, (world,); worlds with 0 are left alone.
        faults: uint8, (world,); set to 1 in such worlds.
        device: Where all of these lie.
        group: Which worlds are drawn.
    """
    inputs = [tables.shapes, tables.splats, mask, faults, views]
    return bind_launch(find_broken, len(group.worlds), inputs, device, start=group.worlds.start)


def bind(
    images: Mapping[str, wp.array],
    lens: str,
    tables: SceneTables,
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    width: int,
    height: int,
    device: wp.Device,
    group: Group,
    flow_history: Any = None,
) -> Stage:
    """Bind the stage that draws clouds over one camera's images, which are else finished.

    Args:
        images: Contiguous arrays (world, height, width, channels) by name; those in ``OUTPUTS``, "flow" and
            "flow_valid" are changed.
        lens: "pinhole" or "orthographic".
        tables: The scene; it has splats.
        views: View, (world,).
        mask: uint8, (world,); worlds with 0 are left alone.
        depth: Planar depth [m], float32 (world, height, width, 1); may be one of ``images``.
        shape: Shape ids, an integer type, likewise, -1 where nothing is hit.
        width: Of the image [pixels].
        height: Of the image [pixels].
        device: Where all of these lie.
        group: Which worlds are drawn.
        flow_history: FlowHistory, where flow is wanted.
    """
    plan = plan_splats(tables, lens, width, height, tuple(images), device)
    flows = bool(plan.key.flow)
    exposed, solid = bool(plan.key.images & SplatFlag.EXPOSED), bool(plan.key.images & SplatFlag.SOLID)
    make = _exposed_frame_struct if exposed else _flow_frame_struct if flows else _frame_struct
    frame_type = (_solid_frame_struct if solid else make)(shape.dtype)
    frame = frame_type()
    if exposed:
        frame.exposures, frame.gains = tables.world_overrides.exposures, tables.world_overrides.gains
    if solid:
        frame.limits = tables.splat_limits
    if flows:
        frame.trail = flow_history
    frame.views, frame.mask = views, mask
    frame.depth, frame.shape = depth.flatten(), shape.flatten()
    frame.width, frame.height = width, height
    changed = SplatImages()
    for name, dtype in OUTPUTS.items():
        if name in images:
            setattr(changed, name, flatten(images[name]))
        else:
            setattr(changed, name, wp.empty(0, dtype=dtype, device=device))
    changed.instance_of, changed.semantic_of = tables.labels["instances"], tables.labels["semantics"]
    kernel, unit = _kernel(plan.key, frame_type), plan.threads
    return bind_launch(
        kernel,
        len(group.worlds) * unit,
        [frame, changed, tables.shapes, tables.splats],
        device,
        start=group.worlds.start * unit,
        block_dim=THREADS,
        key=plan.key,
    )
