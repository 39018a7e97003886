"""The trace: for each pixel of a camera's views the nearest shape, its face and its depth."""

import functools
from collections.abc import Collection, Mapping, Set
from typing import Any

import warp as wp

from warpcam.kernels.passes.flow import is_compact
from warpcam.kernels.passes.trace_target import (
    albedo_target_struct,
    flow_target_struct,
    opaque_target_struct,
    target_struct,
)
from warpcam.kernels.runtime.flatten import flatten
from warpcam.kernels.runtime.launch import Group, Stage, bind_launch, cpu_threads, native_module
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import (
    HEIGHT_FIELD,
    LOOKS_ALONE,
    MESH,
    MIDDLE_FIRST,
    MOVING,
    HeightFields,
    Materials,
    Meshes,
    Shapes,
    View,
)

# What the trace can write, in the order of the bits in native/traversal/trace_outputs.h; then bits of two facts of the
# image's size.
OUTPUTS = ("depth", "shape", "face", "distance", "points", "bodies", "normals")
NORMAL, FOURS, TILED = 64, 128, 256
IDS, BY_WORLD = 1 << 16, 1 << 17  # ids by world: traversal/trace_outputs.h
LABELS: Mapping[str, int] = {"instances": 1 << 18, "semantics": 1 << 19}  # the same
OPAQUE = 1 << 20  # what is transparent is left out
LISTED_AHEAD = 512  # shapes have been listed: native/traversal/visibility_listed.h
PAINTED = 1 << 21  # with albedo: native/shading_pass/visibility_albedo.h
# native/flow/visibility_history.h
FLOW, FLOW_VALID, FLOW_MOVES, FLOW_BRIEF, FLOW_LISTED, FLOW_WHOLE, FLOW_NEAR = (1 << bit for bit in range(24, 31))
LENSES = {"pinhole": 0, "orthographic": 1, "rays": 2, "spread": 3}
TABLES = frozenset(("rays", "spread"))  # those of them that are tables
THREADS = 128  # of a CUDA block; core/platform.h has the same number
REGIONS = ((64, 64), (64, 32), (32, 32), (32, 16), (16, 16), (16, 8))
QUICK = (32, 16)  # pixels: a strip of tiles for each warp
MANY = 64  # shapes
MOST_COMPOSED = 128  # shapes whose motions each block composes
FLOOR_REGION = 64  # pixels, native/flow/plane_history.h
MAX_LISTED = 256  # shapes that one pass draws
MANY_LISTED = 1024  # the same on a CPU, which has room for more
FEW_BLOCKS = 3  # on a multiprocessor: as many are enough where a block's tiles take about as long as setting it up
ROW_OF_BLOCKS = 2**24 // THREADS  # Warp lays out a launch's threads in rows of so many
SHARED_MEMORY = 228 * 1024  # of a multiprocessor [bytes]
LISTED_BYTES = 99  # of it for each shape that a block lists: traversal/trace_tile.h, ShapeList
BLOCKS = 10  # on a multiprocessor: bounds the registers of a thread
MESH_BLOCKS = 8  # the same for scenes with meshes or height fields
MOVING_BLOCKS = 6  # and where meshes move: native/accel/bvh4.h, faces_together
MANY_MESHES_BLOCKS = 6  # and for more than MANY shapes


@functools.cache
def _kernel(
    types: int,
    lens: int,
    capacity: int,
    several: bool,
    width: int,
    height: int,
    outputs: int,
    target_type: Any,
    facts: int,
) -> wp.Kernel:
    flag = "true" if several else "false"
    header, function = (
        "traversal/visibility.h",
        f"draw<{types}, {lens}, {capacity}, {flag}, {width}, {height}, {outputs}>",
    )
    if outputs & LISTED_AHEAD:
        header, function = "traversal/visibility_listed.h", function.replace("draw", "draw_listed")
    if outputs & PAINTED:
        header, function = (
            "shading_pass/visibility_albedo.h",
            f"draw_painted<{types}, {capacity}, {width}, {height}, {outputs}, {facts}>",
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
        launch_bounds=(THREADS, blocks(types, capacity)),
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
    facts: int = 0,
    lists: wp.array | None = None,
) -> Stage:
    """Bind the trace of one camera.

    Args:
        tables: The scene.
        lens: One of LENSES; with TABLES, depth is the distance along the ray, and "distance" the planar depth.
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
            and height fields, albedo where ``paints`` says so.
        device: Where all of these lie.
        group: Which worlds are traced; None is all.
        transparent_index: int32, (shape,). With it shapes that are transparent are left out, of those where it is not
            -1; there are no ``images`` then.
        flow_history: Trail, where flow is wanted.
        facts: Of the scene's looks, where albedo is: see shading.py.
        lists: vec4, (world, row): the shapes listed for these views, by view_shape_lists.py, if they are.
    """
    group = group or Group.of_all(views.shape[0])
    capacity = list_capacity(tables.num_drawn, MANY_LISTED if device.is_cpu else MAX_LISTED)
    several = tables.num_drawn > capacity
    struct = target_struct if transparent_index is None else opaque_target_struct
    if "flow" in images or "flow_valid" in images:
        struct = flow_target_struct
    elif "albedo" in images:
        struct = albedo_target_struct
    target_type = struct(_dtype(shape), _dtype(face))
    target = target_type()
    target.mask, target.faults = mask, faults
    target.width, target.height = width, height
    region = (
        (width, height) if lists is not None else region_size(tables, group.concurrent_worlds, width, height, device)
    )
    outputs = 0
    arrays = {"depth": depth, "shape": shape, "face": face, **images}
    for bit, name in enumerate(OUTPUTS):
        if arrays.get(name) is not None:
            setattr(target, name, flatten(arrays[name]))
            outputs |= 1 << bit
    if struct is flow_target_struct:
        target.trail = flow_history
        outputs |= FLOW * ("flow" in images) + FLOW_VALID * ("flow_valid" in images) + FLOW_MOVES * bool(tables.moving)
        outputs |= FLOW_BRIEF * is_compact(tables)
        outputs |= FLOW_LISTED * composes(tables, device)
    elif struct is albedo_target_struct:
        target.albedo = flatten(images["albedo"])
        target.textures, target.plane = tables.textures, tables.first_plane
        outputs |= PAINTED
    if "ids" in images:
        target.ids = images["ids"].flatten()
        outputs |= IDS
    for name, bit in LABELS.items():
        if name in images:
            setattr(target.labels, name, images[name].flatten())
            outputs |= bit
    if outputs & LABELS["instances"]:
        target.labels.instance_of = tables.labels["instances"]
    if outputs & LABELS["semantics"]:
        target.labels.semantic_of = tables.labels["semantics"]
    if transparent_index is not None:
        target.veil_places = transparent_index
        outputs |= OPAQUE
    if tables.ids_by_world and "bodies" in images:
        outputs |= BY_WORLD
    if device.is_cuda:  # nothing is faster by these on a CPU, and fewer kernels are compiled without
        outputs |= FOURS * (width % 4 == 0 and not images.keys().isdisjoint(("points", "normals")))
        outputs |= TILED * (width % 8 == 0 and height % (4 * tiles_at_once(tables.shape_types, region)) == 0)
    types = sum(1 << t for t in tables.shape_types - (frozenset() if outputs & PAINTED else LOOKS_ALONE))
    if region == (width, height):
        outputs |= facts_of_whole(tables, device, "flow_valid" in images)
        if lists is not None:
            target.lists = lists.flatten()
            outputs |= LISTED_AHEAD
    parts = -(-width // region[0]) * -(-height // region[1]) if lists is None else parts_of(images, width, height)
    unit = parts * (THREADS if device.is_cuda else 1)  # threads a world
    types = in_order(types, len(group.worlds) * unit, device)
    kernel = _kernel(types, LENSES[lens], capacity, several, *region, outputs, target_type, facts)
    arguments = [tables.shapes, tables.materials, tables.meshes, tables.height_fields, views, target]
    return bind_launch(
        kernel, len(group.worlds) * unit, arguments, device, start=group.worlds.start * unit, block_dim=THREADS
    )


def _dtype(array: wp.array | None) -> Any:
    return wp.int32 if array is None else array.dtype


def parts_of(images: Collection[str], width: int, height: int) -> int:
    """How many blocks share an image whose shapes have been listed: native/traversal/trace_outputs.h has the same."""
    pixels = REGIONS[0][0] * REGIONS[0][1]
    small = width * height <= pixels
    more = small and not {"distance", "bodies", "instances", "semantics"}.isdisjoint(images)
    threes = ("points" in images) + ("normals" in images)
    wanted = 4 * threes or (2 if "flow" in images or more else 1)
    wanted = 1 if "flow_valid" in images else wanted
    if small:
        return min(wanted, width * height // THREADS, height // 4)
    return -(-(height // 8) // max(1, pixels // (8 * wanted * width)))


def blocks(types: int, capacity: int) -> int:
    """Blocks that a multiprocessor is to hold: no more than its shared memory has room for."""
    words = -(-capacity // 32)
    shared = LISTED_BYTES * capacity + 1024
    if types >> MESH & 1:
        shared += THREADS * (8 * words + 6)
    bound = MESH_BLOCKS if types >> MESH & 1 or types >> HEIGHT_FIELD & 1 else BLOCKS
    bound = MANY_MESHES_BLOCKS if types >> MESH & 1 and capacity > MANY else bound
    bound = MOVING_BLOCKS if types >> MOVING & 1 else bound
    return min(bound, SHARED_MEMORY // shared)


def in_order(types: int, threads: int, device: wp.Device) -> int:
    """The types of a launch, with MIDDLE_FIRST where rays are walked: the longest ones are in the middle of images."""
    walked = types & (1 << MESH | 1 << HEIGHT_FIELD | 1 << MOVING)
    return types | 1 << MIDDLE_FIRST if device.is_cuda and walked and threads <= ROW_OF_BLOCKS * THREADS else types


def composes(tables: SceneTables, device: wp.Device) -> bool:
    """Whether blocks of the trace or of view_shape_lists.py compose how shapes have moved, not a stage of its own."""
    few = tables.num_shapes <= list_capacity(tables.num_drawn) <= MOST_COMPOSED
    return device.is_cuda and few and not tables.moving and tables.splats is None


def floor_parts(tables: SceneTables, device: wp.Device, width: int, height: int) -> int:
    """Parts of 8 x 8 pixels of an image, of each of which a trace of validity may keep whether it shows but a floor."""
    if width % 8 or height % 8 or not composes(tables, device) or not is_compact(tables):
        return 0
    return -(-width // FLOOR_REGION) * -(-height // FLOOR_REGION) * (FLOOR_REGION // 8) ** 2


def tiles_at_once(shape_types: Set[int], region: tuple[int, int]) -> int:
    """How many tiles, one below the other, a warp of a CUDA block draws at once: native/traversal/trace_outputs.h."""
    return 2 if {MESH, HEIGHT_FIELD}.isdisjoint(shape_types) and region[0] * region[1] >= 32 * 32 else 1


def paints(
    tables: SceneTables,
    lens: str,
    width: int,
    height: int,
    at_once: int,
    images: Mapping[str, wp.array],
    device: wp.Device,
) -> bool:
    """Whether the trace writes albedo, too: native/shading_pass/visibility_albedo.h."""
    plain = {MESH, HEIGHT_FIELD}.isdisjoint(tables.shape_types) and tables.physical is None and tables.splats is None
    moved = tables.world_overrides is not None and tables.world_overrides.texture_offsets.size > 0
    if not (device.is_cuda and plain and lens == "pinhole") or moved or tables.num_drawn > MAX_LISTED:
        return False
    tall = tiles_at_once(tables.shape_types, region_size(tables, at_once, width, height, device))
    return images.keys().isdisjoint(("flow", "flow_valid")) and width % 8 == 0 and height % (4 * tall) == 0


def facts_of_whole(tables: SceneTables, device: wp.Device, valid: bool) -> int:
    """What a trace of flow is told whose blocks draw whole images. With many shapes they have no room for words."""
    if not device.is_cuda:
        return 0
    return FLOW_WHOLE | FLOW_NEAR * (valid and is_compact(tables) and tables.num_drawn <= MANY)


def list_capacity(num_drawn: int, most: int = MAX_LISTED) -> int:
    """How many shapes a block lists at once, for a scene of that many: few sizes, so that scenes share kernels."""
    sizes = (16, 32, 64, 96, 128, 192, MAX_LISTED, 512, MANY_LISTED)
    return next(size for size in sizes if size >= min(num_drawn, most))


def region_size(
    tables: SceneTables, at_once: int, width: int, height: int, device: wp.Device, quick: bool | None = None
) -> tuple[int, int]:
    """Pixels that one thread block draws: as many as leave enough blocks to fill the device.

    Fewer in scenes with meshes, whose blocks take long, if an image has several regions or there are many shapes: at
    the end of a launch the last blocks are waited for. On a CPU no more than one for each core, as listing the shapes
    of a small region takes longer than drawing it.

    Args:
        quick: Tiles take about as long as setting a block up, so that few worlds are not cut into blocks of a tile a
            warp; None: in scenes without meshes and height fields.
    """
    if quick is None:
        quick = {MESH, HEIGHT_FIELD}.isdisjoint(tables.shape_types)
    wanted = device.sm_count * 10 if device.is_cuda else cpu_threads()
    largest = 0
    if device.is_cuda and MESH in tables.shape_types:
        several = width > REGIONS[0][0] or height > REGIONS[0][1]
        largest = 2 if tables.num_drawn > MANY else 1 if several else 0
    for size in REGIONS[largest:-1]:
        count = at_once * -(-width // size[0]) * -(-height // size[1])
        if count >= wanted or (device.is_cuda and quick and size == QUICK and count >= FEW_BLOCKS * device.sm_count):
            return size
    return REGIONS[-1]
