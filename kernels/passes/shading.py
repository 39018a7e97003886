"""From the visibility buffer to images: one kernel per camera writes every output that was asked for."""

import functools
from collections.abc import Collection, Mapping
from typing import Any

import warp as wp

from warpcam.kernels.layers import Haze, LayerTables, Mirror
from warpcam.kernels.passes.visibility import LENSES, THREADS, in_order, region_size
from warpcam.kernels.passes.world_overrides import EXPOSED, WorldOverrides, override_flags
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch, native_module
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import (
    HEIGHT_FIELD,
    MESH,
    PLANE,
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

# The outputs made here, with the dtype and the number of channels of their arrays (world, height, width, channels), in
# the order of their bits in native/shading/appearance.h.
OUTPUTS: Mapping[str, tuple[type, int]] = {
    "rgb": (wp.uint8, 3),
    "rgba": (wp.uint8, 4),
    "hdr": (wp.float32, 3),
    "normals": (wp.float32, 3),
    "albedo": (wp.uint8, 3),
}

TRANSPARENT_BLOCKS = 4  # blocks that a multiprocessor is to hold where some shapes may be transparent
PHYSICAL, HAS_MAPS = 1 << 12, 1 << 13  # the same
QUADS, WHOLE_REGIONS = 1 << 4, 1 << 5  # of an image's size, there; they change nothing on a CPU
SPARE, STRIPS = 1 << 6, 1 << 7  # of a scene, there: see is_spare, has_strips
MAX_KEPT = 256  # shapes whose looks a block can keep
MAX_SPARE = 64  # shapes of a scene without meshes that leave room for SPARE
MAX_STRIPS = 128  # shapes of a scene whose floors are drawn by strips
# lights of a scene whose floors are drawn by strips with their shadows: FEW in native/shading/plane_vertex_lighting.h
MAX_CASTING = 3
MAX_SEEN = 512  # shapes of which it can keep the looks of those that it sees; with more it sees too many
# facts of native/shading/appearance.h
MIRRORED, REFLECTS, VEILED, HAZY, NOTED = 1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 14
HAS_MIPS = 1 << 24  # there
# native/shading_pass/store_quads.h
IN_QUADS = frozenset(map(frozenset, (("rgb",), ("rgba",), ("rgb", "rgba"), ("hdr",), ("albedo",))))
LIT = ("rgb", "rgba", "hdr")  # what mirrors, transparent shapes and haze change


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
    """The same with what mirrors, transparent shapes and haze need."""

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
    """The same with what worlds have each for itself."""

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
    """What the kernel writes, channel after channel of pixel after pixel; empty where it was not asked for."""

    rgb: wp.array(dtype=wp.uint8)
    rgba: wp.array(dtype=wp.uint8)
    hdr: wp.array(dtype=wp.float32)
    normals: wp.array(dtype=wp.float32)
    albedo: wp.array(dtype=wp.uint8)


@functools.cache
def _kernel(
    types: int, lens: int, capacity: int, width: int, height: int, images: int, facts: int, frame_type: Any, veils: int
) -> wp.Kernel:
    more = f", {veils}" if veils else ""
    lights_type: Any = Lights
    scene = "warpcam::Scene { frame, images, shapes, meshes, fields, materials, textures, background }"
    if facts & PHYSICAL:
        lights_type = Physical
        scene = f"warpcam::PhysicalScene {{ {scene}, lights }}"

    @wp.func_native(
        f"warpcam::resolve<{types}, {lens}, {capacity}, {width}, {height}, {images}, {facts}{more}>"
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
        launch_bounds=(THREADS, TRANSPARENT_BLOCKS if veils else _blocks(images, facts)),
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
    more, veils = 0, 0
    if layers is not None and not set(LIT).isdisjoint(outputs):
        more = (MIRRORED if mirrored else REFLECTS) if mirrors is not None else 0
        if layers.has_transparent:
            more |= VEILED | (NOTED if noted else 0)
            veils = _room(layers.transparent_shapes.size, 8, device)
        if layers.haze is not None and tables.has_skybox and not mirrored:
            more |= HAZY
    varied = override_flags(tables.world_overrides, tables.headlights)
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
    wanted = 0
    for bit, (name, (dtype, _)) in enumerate(OUTPUTS.items()):
        if name in outputs:
            setattr(images, name, flatten(outputs[name]))
            wanted |= 1 << bit
        else:
            setattr(images, name, wp.empty(0, dtype=dtype, device=device))
    group = group or Group.of_all(tables.num_worlds)
    region = region_size(tables, group.concurrent_worlds, width, height, device, quick=True)
    types = sum(1 << t for t in tables.shape_types)
    facts = facts_of_looks(tables, shadow is not None) | more | varied
    if device.is_cuda:
        whole = width % region[0] == 0 and height % region[1] == 0
        facts |= QUADS * (width % 4 == 0) | WHOLE_REGIONS * whole
        plain = (
            frozenset(outputs) in IN_QUADS
            and lens == "pinhole"
            and tables.physical is None
            and not (more or varied & EXPOSED)
        )
        by_corners = shadow is None or tables.num_lights <= MAX_CASTING
        strips = has_strips(tables.shape_types, tables.num_drawn) and whole and region[0] % 32 == 0
        in_strips = strips and plain and by_corners
        facts |= STRIPS * in_strips | HAS_MIPS * (in_strips and tables.has_mips)
    unit = -(-width // region[0]) * -(-height // region[1]) * (THREADS if device.is_cuda else 1)  # threads a world
    types = in_order(types, len(group.worlds) * unit, device)
    kernel = _kernel(types, LENSES[lens], _capacity(tables, device), *region, wanted, facts, frame_type, veils)
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
        kernel, len(group.worlds) * unit, inputs, device, start=group.worlds.start * unit, block_dim=THREADS
    )


def _blocks(images: int, facts: int) -> int:
    """Blocks that a multiprocessor is to hold, for a set of images and facts: bounds the registers of a thread."""
    lit, albedo = images & 0b00111, images & 0b10000
    return (6 if facts & SPARE and facts & STRIPS else 5) if lit else 7 if albedo else 8


def is_spare(shape_types: Collection[int], num_drawn: int) -> bool:
    """Whether textures are looked up on sheets and floors drawn apart: see native/shading/appearance.h."""
    return PLANE in shape_types and {MESH, HEIGHT_FIELD}.isdisjoint(shape_types) and num_drawn <= MAX_SPARE


def has_strips(shape_types: Collection[int], num_drawn: int) -> bool:
    """Whether floors may be drawn by strips, from sheets of their textures: see native/shading_pass/plane_strips.h."""
    return PLANE in shape_types and num_drawn <= MAX_STRIPS


def _capacity(tables: SceneTables, device: wp.Device) -> int:
    """Shapes whose looks a block keeps, all or those that it sees, in few sizes; 0 for scenes too large for it."""
    if tables.num_drawn > MAX_KEPT:
        return MAX_SEEN if tables.num_drawn <= MAX_SEEN else 0
    return _room(tables.num_drawn, 16, device)


def _room(count: int, step: int, device: wp.Device) -> int:
    """Room for so many, a multiple of a step, so that scenes share kernels; on a CPU, whose room is large, of 32."""
    if device.is_cpu and count > 2 * step:
        step = 32
    return -(-count // step) * step


def facts_of_looks(tables: SceneTables, shadows: bool = False) -> int:
    """Bits of native/shading/appearance.h."""
    facts = (tables.has_materials, tables.has_textures, tables.has_skybox, shadows)
    spare = SPARE * is_spare(tables.shape_types, tables.num_drawn)
    physical = PHYSICAL * (tables.physical is not None) + HAS_MAPS * (tables.has_maps and tables.has_textures)
    return sum(1 << bit for bit, fact in enumerate(facts) if fact) + spare + physical
