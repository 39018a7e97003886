"""From the visibility buffer to images: one kernel per camera writes every output that was asked for."""

import functools
from collections.abc import Mapping
from typing import Any

import warp as wp

from warpcam.kernels.flags import ShadingFlag
from warpcam.kernels.layers import Haze, LayerTables, Mirror
from warpcam.kernels.passes.world_overrides import WorldOverrides
from warpcam.kernels.plan.launches import THREADS
from warpcam.kernels.plan.shading import LAYER_FLAGS, OVERRIDE_FLAGS, ShadingKey, plan_shading
from warpcam.kernels.runtime.compile import native_module
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch
from warpcam.kernels.scene_tables import SceneTables
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

# The outputs made here, with the dtype and the number of channels of their arrays (world, height, width, channels).
OUTPUTS: Mapping[str, tuple[type, int]] = {
    "rgb": (wp.uint8, 3),
    "rgba": (wp.uint8, 4),
    "hdr": (wp.float32, 3),
    "normals": (wp.float32, 3),
    "albedo": (wp.uint8, 3),
}


@functools.cache
def frame_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """One camera's visibility in all worlds: what the kernel reads."""

    @wp.struct
    class Frame:
        views: wp.array(dtype=View)  # (world,)
        mask: wp.array(dtype=wp.uint8)  # (world,) 0 leaves the world's images alone
        depth: wp.array(dtype=wp.float32)  # (pixel,) planar depth [m]
        shape: wp.array(dtype=shape_dtype)  # (pixel,) or -1 where nothing was hit
        face: wp.array(dtype=face_dtype)  # (pixel,) as the trace wrote it: see visibility.py
        shadow: wp.array(dtype=wp.uint8)  # (pixel,) as the shadow pass wrote it; empty without shadows
        width: wp.int32
        height: wp.int32
        horizon: wp.float32  # how far the camera of MuJoCo's renderer sees [m]; see native/shading/plane_grid.h
        plane: wp.int32  # id of the plane whose corners are kept, or -1; see native/shading/plane_vertex_lighting.h

    return Frame


@functools.cache
def layered_frame_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of one camera's visibility with the tables of mirrors, transparent shapes and haze."""

    @wp.struct
    class LayeredFrame:
        views: wp.array(dtype=View)
        mask: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        face: wp.array(dtype=face_dtype)
        shadow: wp.array(dtype=wp.uint8)
        width: wp.int32
        height: wp.int32
        horizon: wp.float32
        plane: wp.int32
        mirrors: wp.array(dtype=Mirror)  # (world,)
        veils: wp.array(dtype=wp.int32)  # ids of the shapes that may be transparent
        reach: wp.array(dtype=wp.float32)  # (shape,) see layers.py
        haze: Haze

    return LayeredFrame


@functools.cache
def overridden_frame_struct(shape_dtype: Any, face_dtype: Any) -> Any:
    """Struct of one camera's visibility with layers and per-world overrides."""

    @wp.struct
    class VariedFrame:
        views: wp.array(dtype=View)
        mask: wp.array(dtype=wp.uint8)
        depth: wp.array(dtype=wp.float32)
        shape: wp.array(dtype=shape_dtype)
        face: wp.array(dtype=face_dtype)
        shadow: wp.array(dtype=wp.uint8)
        width: wp.int32
        height: wp.int32
        horizon: wp.float32
        plane: wp.int32
        mirrors: wp.array(dtype=Mirror)
        veils: wp.array(dtype=wp.int32)
        reach: wp.array(dtype=wp.float32)
        haze: Haze
        variety: WorldOverrides

    return VariedFrame


@wp.struct
class ShadedImages:
    """Images that the kernel writes, channel after channel of pixel after pixel; empty if not asked for."""

    rgb: wp.array(dtype=wp.uint8)
    rgba: wp.array(dtype=wp.uint8)
    hdr: wp.array(dtype=wp.float32)
    normals: wp.array(dtype=wp.float32)
    albedo: wp.array(dtype=wp.uint8)


@functools.cache
def _kernel(key: ShadingKey, frame_type: Any) -> wp.Kernel:
    types, lens, capacity, (width, height) = key.types.bits, int(key.lens), key.capacity, key.region
    written, facts = int(key.images), int(key.facts)
    more = f", {key.transparent}" if key.transparent else ""
    lights_type: Any = Lights
    scene = "warpcam::Scene { frame, images, shapes, meshes, fields, materials, textures, background }"
    if key.facts & ShadingFlag.PHYSICAL:
        lights_type = Physical
        scene = f"warpcam::PhysicalScene {{ {scene}, lights }}"

    @wp.func_native(
        f"warpcam::resolve<{types}, {lens}, {capacity}, {width}, {height}, {written}, {facts}{more}>"
        f"({scene}, lights, index);"
    )
    def resolve(
        frame: frame_type,
        images: ShadedImages,
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        materials: Materials,
        textures: Textures,
        lights: lights_type,
        background: Background,
        index: int,
    ): ...

    @wp.kernel(
        module="unique",
        enable_backward=False,
        grid_stride=False,
        launch_bounds=(THREADS, key.blocks),
        module_options=native_module("shading_pass/shading_pass.h"),
    )
    def write_images(
        frame: frame_type,
        images: ShadedImages,
        shapes: Shapes,
        meshes: Meshes,
        fields: HeightFields,
        materials: Materials,
        textures: Textures,
        lights: lights_type,
        background: Background,
        first: wp.int32,
    ):
        resolve(frame, images, shapes, meshes, fields, materials, textures, lights, background, first + wp.tid())

    return write_images


def bind(
    outputs: Mapping[str, wp.array],
    lens: str,
    tables: SceneTables,
    views: wp.array,
    mask: wp.array,
    depth: wp.array,
    shape: wp.array,
    face: wp.array,
    shadow: wp.array | None,
    width: int,
    height: int,
    device: wp.Device,
    group: Group | None = None,
    layers: LayerTables | None = None,
    mirrors: wp.array | None = None,
    mirrored: bool = False,
    noted: bool = False,
) -> Stage:
    """Bind the kernel that writes ``outputs`` to one camera's buffers.

    Args:
        outputs: Contiguous arrays (world, height, width, channels) by name; see ``OUTPUTS``.
        lens: "pinhole" or "orthographic".
        tables: The scene.
        views: (world,) of ``View``.
        mask: uint8 (world,); 0 leaves the world's images alone.
        depth: Planar depth [m], float32 (world, height, width).
        shape: Shape ids, an integer type that holds them (world, height, width), -1 where nothing is hit.
        face: Faces, likewise (world, height, width): of a mesh counted in leaf order, of a height field twice the cell
            plus the triangle (0 below, 1 above the diagonal from low to high row and column), -1 for its sides.
        shadow: uint8 (world, height, width), as shadow.py writes it. None: nothing casts shadows.
        width: Of the image [pixels].
        height: Of the image [pixels].
        device: Where everything lies.
        group: Which worlds are drawn; None is all.
        layers: What of the scene one layer cannot show, where some of the outputs are ``LIT``.
        mirrors: Mirror, (world,), where the scene reflects.
        mirrored: The buffers are those of the view from behind the mirrors, ``views``: the outputs, all ``LIT``, are
            what the mirrors show, black where they show nothing. Otherwise that lies in the outputs already where there
            are ``mirrors``, and is added to.
        noted: Write transparent shapes that cover half of what lies behind them into ``depth`` and ``shape``.
    """
    unknown = sorted(set(outputs) - set(OUTPUTS))
    if unknown:
        raise ValueError(f"outputs: {unknown} are not made here; these are: {sorted(OUTPUTS)}")
    group = group or Group.of_all(tables.num_worlds)
    plan = plan_shading(
        tables,
        lens,
        width,
        height,
        outputs,
        shadow is not None,
        layers,
        device,
        group,
        mirrors=mirrors is not None,
        mirrored=mirrored,
        write_back=noted,
    )
    more, varied = plan.key.facts & LAYER_FLAGS, plan.key.facts & OVERRIDE_FLAGS
    if varied and tables.world_overrides is not None:
        frame_type = overridden_frame_struct(shape.dtype, face.dtype)
    else:
        frame_type = (layered_frame_struct if more else frame_struct)(shape.dtype, face.dtype)
    frame = frame_type()
    if varied and tables.world_overrides is not None:
        frame.variety = tables.world_overrides
    if layers is not None and more:
        frame.veils, frame.reach = layers.transparent_shapes, layers.reach
        if mirrors is not None:
            frame.mirrors = mirrors
        if layers.haze is not None:
            frame.haze = layers.haze
    frame.views = views
    frame.mask = mask
    frame.depth = depth.flatten()
    frame.shape = shape.flatten()
    frame.face = face.flatten()
    frame.shadow = wp.empty(0, dtype=wp.uint8, device=device) if shadow is None else shadow.flatten()
    frame.width = width
    frame.height = height
    frame.horizon = tables.horizon
    frame.plane = tables.first_plane
    images = ShadedImages()
    for name, (dtype, _) in OUTPUTS.items():
        if name in outputs:
            setattr(images, name, flatten(outputs[name]))
        else:
            setattr(images, name, wp.empty(0, dtype=dtype, device=device))
    kernel, unit = _kernel(plan.key, frame_type), plan.threads
    inputs = [
        frame,
        images,
        tables.shapes,
        tables.meshes,
        tables.height_fields,
        tables.materials,
        tables.textures,
        tables.physical or tables.lights,
        tables.background,
    ]
    return bind_launch(
        kernel,
        len(group.worlds) * unit,
        inputs,
        device,
        start=group.worlds.start * unit,
        block_dim=THREADS,
        key=plan.key,
    )
