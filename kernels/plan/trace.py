"""Kernels of the trace, of the trace of mirrored views, and of the stage that lists shapes for the trace."""

import math
from collections.abc import Collection, Set
from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import (
    NO_SHADING_FLAGS,
    TRAVERSED,
    GeometryFlag,
    Lens,
    SceneFlag,
    ShadingFlag,
    TraceFlag,
)
from warpcam.kernels.plan import history, launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, SceneTypes, flag_if, region_size
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group, MeshReads
from warpcam.kernels.scene_tables import SceneTables

# Arrays of the trace by name, in the order in which the target has them.
ARRAYS = {
    "depth": TraceFlag.DEPTH,
    "shape": TraceFlag.SHAPE,
    "face": TraceFlag.FACE,
    "distance": TraceFlag.DISTANCE,
    "points": TraceFlag.POINTS,
    "bodies": TraceFlag.BODIES,
    "normals": TraceFlag.NORMAL,
}
LABELS = {"instances": TraceFlag.INSTANCES, "semantics": TraceFlag.SEMANTICS}
# Images that CPU kernels write if their arrays are there, so that all cameras of a scene share a kernel: all but
# normals, for which hits name slots, and flow. Where transparent shapes are left out there are the first three alone.
BUFFERS = TraceFlag.DEPTH | TraceFlag.SHAPE | TraceFlag.FACE
OPTIONAL = (
    BUFFERS
    | TraceFlag.DISTANCE
    | TraceFlag.POINTS
    | TraceFlag.BODIES
    | TraceFlag.IDS
    | TraceFlag.INSTANCES
    | TraceFlag.SEMANTICS
)
# Regions of a trace that projects faces, of which each block projects all, and how many blocks a multiprocessor is to
# have at least; shapes of a pass: native/traversal/projected_faces.h
PROJECTED_REGIONS, PROJECTED_BLOCKS, PROJECTED_CAPACITY = ((64, 32), (32, 32)), 3, 128
PROJECTED_FACES = 10  # a pixel of a region: meshes with more are not projected; the header has the same number
TILE = (8, 4)  # pixels
LISTED_BYTES = 99  # of shared memory for each shape that a block lists: traversal/shape_list.h, ShapeList
BLOCKS = 10  # on a multiprocessor: bounds the registers of a thread
MESH_BLOCKS = 8  # the same for scenes with meshes or height fields
MOVING_BLOCKS = 6  # and where meshes move: native/accel/bvh4.h, faces_together
MANY_MESHES_BLOCKS = 6  # and for more than MANY shapes

# Outputs of a trace whose shapes are listed ahead, and those that are lit from what it sees; the others need what is
# not listed.
LISTED_TRACED = ("depth", "segmentation", "distance", "points", "bodies", "normals", "instances", "semantics")
LISTED_OUTPUTS = frozenset((*LISTED_TRACED, "flow", "flow_valid", "rgb", "rgba", "hdr"))
HEAD_ROWS, RECORD_ROWS, FACING_ROWS = 17, 5, 4  # of a list: native/traversal/view_shape_list.h, FarList
LANES = 32
# Where the trace chooses from the shapes in view: from so many on, where rays walk through none of them in images of so
# many pixels on.
IN_VIEW_FROM, IN_VIEW_PIXELS = 129, 16 * 64 * 64
MOST_IN_VIEW = 2**16  # shapes that can be told apart there: native/traversal/shapes_in_view.h, ShapeInView
IN_VIEW_CAPACITY, IN_VIEW_ANALYTIC_CAPACITY = 64, 128  # shapes of a pass of such a trace
SORTED = (512, 1024, 2048, 4096)  # shapes that are sorted together
# pixels of an image whose tiles a record's box can count: native/camera/shape_setup.h
MOST_COLUMNS, MOST_ROWS = 8 * 127, 4 * 127
IN_VIEW_BLOCKS = 8
LIST_BLOCKS, LIST_FLOW_BLOCKS = (
    7,
    5,
)  # on a multiprocessor: bounds the registers of a thread; with more some are spilled


@dataclass(frozen=True)
class TraceKey:
    """A kernel of the trace: traversal/visibility.h, visibility_listed.h or shading_pass/visibility_albedo.h."""

    types: SceneTypes
    lens: Lens
    capacity: int  # shapes that a block lists
    several: bool  # passes, which go on from each other's depth and shape
    region: tuple[int, int]  # of a block [pixels]
    outputs: TraceFlag
    flags: ShadingFlag  # of the scene, where albedo is traced

    @property
    def blocks(self) -> int:
        return blocks(self.types, self.capacity)


@dataclass(frozen=True)
class InViewKey:
    """A kernel that lists the shapes in view: traversal/shapes_in_view.h."""

    types: SceneTypes
    lens: Lens
    room: int  # shapes that are sorted together

    @property
    def blocks(self) -> int:
        return IN_VIEW_BLOCKS


@dataclass(frozen=True)
class MirrorKey:
    """A kernel of the trace of mirrored views: shading_pass/mirror_visibility.h."""

    types: SceneTypes
    lens: Lens
    capacity: int
    several: bool
    region: tuple[int, int]
    faces: bool

    @property
    def blocks(self) -> int:
        return blocks(self.types, self.capacity)


@dataclass(frozen=True)
class ListKey:
    """A kernel that writes views and lists shapes: traversal/view_shape_list.h."""

    types: SceneTypes
    lens: Lens
    capacity: int
    outputs: TraceFlag

    @property
    def blocks(self) -> int:
        return LIST_FLOW_BLOCKS if self.outputs & (TraceFlag.FLOW | TraceFlag.FLOW_VALID) else LIST_BLOCKS


def plan_trace(
    tables: SceneTables,
    request: ImageRequest,
    device: wp.Device,
    group: Group,
    *,
    images: Collection[str],
    flags: ShadingFlag,
    opaque: bool = False,
    listed: bool = False,
    in_view: bool = False,
) -> PlannedLaunch[TraceKey]:
    """The kernel of a trace.

    Args:
        tables: The scene.
        request: Lens and size of the images.
        device: Where it runs.
        group: Worlds that are traced.
        images: Names of all arrays that are written, "depth", "shape" and "face" among them.
        flags: Of the scene's looks.
        opaque: Transparent shapes are left out.
        listed: A stage has listed the shapes.
        in_view: Another pass has listed those in view.
    """
    width, height = request.width, request.height
    most = launches.MAX_LISTED if device.is_cuda else launches.MANY_LISTED
    capacity = launches.list_capacity(tables.num_drawn, device, most)
    if in_view:
        capacity = IN_VIEW_ANALYTIC_CAPACITY if launches.is_analytic(tables.shape_types) else IN_VIEW_CAPACITY
    fitted = region_size(tables, group.concurrent_worlds, width, height, device, fitted=True)
    region = (width, height) if listed else fitted
    projects = not listed and _projects_faces(tables, request, device) and capacity <= PROJECTED_CAPACITY
    if projects:
        region = _projected_region(group.concurrent_worlds, request, device) or fitted
    outputs = _outputs(tables, images, device) | flag_if(TraceFlag.OPAQUE, opaque)
    outputs |= flag_if(TraceFlag.IN_VIEW, in_view)
    outputs |= flag_if(TraceFlag.PROJECTED_FACES, projects)
    if not device.is_cuda:
        outputs |= BUFFERS if opaque else OPTIONAL | flag_if(TraceFlag.BY_WORLD, tables.ids_by_world)
    with_albedo = bool(outputs & TraceFlag.TRACE_ALBEDO)
    if device.is_cuda:  # nothing is faster by these on a CPU, and fewer kernels are compiled without
        vectors = not {"points", "normals"}.isdisjoint(images)
        outputs |= flag_if(TraceFlag.WIDTH_MULTIPLE_OF_4, width % 4 == 0 and vectors)
        tall = 4 * tiles_at_once(tables.shape_types, region)
        outputs |= flag_if(TraceFlag.NO_PARTIAL_TILES, width % 8 == 0 and height % tall == 0)
    if region == (width, height):
        outputs |= _whole_image(tables, device, "flow_valid" in images)
        outputs |= flag_if(TraceFlag.LISTED_AHEAD, listed)
    parts = parts_of(images, width, height) if listed else launches.regions_of(width, height, region)
    threads = launches.world_threads(parts, device)
    types = launches.scene_types(tables, device, appearance=with_albedo, lit=opaque)
    types = launches.in_order(types, len(group.worlds) * threads, device)
    key = TraceKey(
        types=types,
        lens=LENSES[request.lens],
        capacity=capacity,
        several=tables.num_drawn > capacity,
        region=region,
        outputs=outputs,
        flags=flags if with_albedo else NO_SHADING_FLAGS,
    )
    return PlannedLaunch(key, threads)


def _projects_faces(tables: SceneTables, request: ImageRequest, device: wp.Device) -> bool:
    """Return whether small faces of moving meshes are projected into the image."""
    return device.is_cuda and SceneFlag.DEFORMING_MESHES in tables.flags and request.lens == "pinhole"


def _projected_region(worlds: int, request: ImageRequest, device: wp.Device) -> tuple[int, int] | None:
    """The largest region of which there are enough blocks."""
    for region in PROJECTED_REGIONS:
        if worlds * launches.regions_of(request.width, request.height, region) >= PROJECTED_BLOCKS * device.sm_count:
            return region
    return None


def reads_of(tables: SceneTables, request: ImageRequest, key: TraceKey) -> MeshReads:
    """What a trace reads of moving meshes: no trees where each block projects the faces of all."""
    sizes = zip((request.width, request.height), key.region, TILE, strict=True)
    # of the last region, along each axis
    smallest = math.prod(-(-((length - 1) % size + 1) // tile) * tile for length, size, tile in sizes)
    projects = TraceFlag.PROJECTED_FACES in key.outputs and tables.moving_faces <= PROJECTED_FACES * smallest
    return MeshReads.FACES if projects else MeshReads.TREES


def plan_in_view(tables: SceneTables, request: ImageRequest, device: wp.Device) -> InViewKey:
    """The kernel that lists the shapes in view."""
    room = next((size for size in SORTED if size >= tables.num_drawn + launches.THREADS), SORTED[-1])
    return InViewKey(launches.scene_types(tables, device), LENSES[request.lens], room)


def chooses_in_view(tables: SceneTables, request: ImageRequest, device: wp.Device) -> bool:
    """Return whether a pass lists the shapes in view, nearest first, for the trace to choose from."""
    large = request.width * request.height >= IN_VIEW_PIXELS or not launches.is_analytic(tables.shape_types)
    many = IN_VIEW_FROM <= tables.num_drawn <= MOST_IN_VIEW
    known = request.lens not in launches.TABLES and set(history.OUTPUTS).isdisjoint(request.outputs)
    return device.is_cuda and many and large and known


def in_view_rows(tables: SceneTables) -> int:
    """Rows of four words of the list of a world: native/traversal/shapes_in_view.h."""
    return (tables.num_drawn + 2) // 2


def plan_mirror(
    tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group, *, faces: bool
) -> PlannedLaunch[MirrorKey]:
    """The kernel that traces what is seen in mirrors."""
    width, height = request.width, request.height
    capacity = launches.list_capacity(tables.num_drawn, device)
    region = region_size(tables, group.concurrent_worlds, width, height, device)
    threads = launches.world_threads(launches.regions_of(width, height, region), device)
    several = tables.num_drawn > capacity
    key = MirrorKey(launches.scene_types(tables, device), LENSES[request.lens], capacity, several, region, faces)
    return PlannedLaunch(key, threads)


def plan_list(tables: SceneTables, request: ImageRequest, device: wp.Device) -> ListKey:
    """The kernel that lists the shapes of a camera, and where flow is asked for composes their motions."""
    wanted = flag_if(TraceFlag.NORMAL, "normals" in request.outputs)
    if not set(history.OUTPUTS).isdisjoint(request.outputs):
        wanted |= TraceFlag.FLOW | flag_if(TraceFlag.FLOW_VALID, "flow_valid" in request.outputs)
    types = launches.scene_types(tables, device, lit=False)
    return ListKey(types, LENSES[request.lens], launches.list_capacity(tables.num_drawn, device), wanted)


def capacity_of(tables: SceneTables, request: ImageRequest, device: wp.Device) -> int:
    """Return the capacity of the camera's shape lists; 0 for no lists."""
    width, height, outputs = request.width, request.height, request.outputs
    few = 0 < tables.num_drawn <= LANES
    plain = launches.is_analytic(tables.shape_types) and not tables.ids_by_world
    alike = history.composes(tables, device)  # what the stage composes is what a block would
    if not (alike and few and plain and request.lens not in launches.TABLES and LISTED_OUTPUTS.issuperset(outputs)):
        return 0
    region = region_size(tables, tables.num_worlds, width, height, device)
    rows = region == launches.REGIONS[0] and "flow_valid" not in outputs
    rows &= width % 16 == 0 and height % 8 == 0 and width <= MOST_COLUMNS and height <= MOST_ROWS
    return launches.list_capacity(tables.num_drawn, device) if rows or region == (width, height) else 0


def rows_of(capacity: int, outputs: Collection[str]) -> int:
    """Rows of four words that the list of a world has."""
    if capacity == 0:
        return 0
    head = HEAD_ROWS + (FACING_ROWS + capacity) * ("normals" in outputs)
    return head + head % 2 + RECORD_ROWS * capacity


def parts_of(images: Collection[str], width: int, height: int) -> int:
    """Return the number of blocks that share an image whose shapes have been listed: trace_outputs.h has the same."""
    pixels = launches.REGIONS[0][0] * launches.REGIONS[0][1]
    small = width * height <= pixels
    more = small and not {"distance", "bodies", "instances", "semantics"}.isdisjoint(images)
    vectors = ("points" in images) + ("normals" in images)
    wanted = 4 * vectors or (2 if "flow" in images or more else 1)
    wanted = 1 if "flow_valid" in images else wanted
    if small:
        return min(wanted, width * height // launches.THREADS, height // 4)
    return -(-(height // 8) // max(1, pixels // (8 * wanted * width)))


def blocks(types: SceneTypes, capacity: int) -> int:
    """Blocks that a multiprocessor is to hold: no more than its shared memory has room for."""
    meshes = bool(types.geometry & GeometryFlag.MESH)
    shared = LISTED_BYTES * capacity + 1024
    if meshes:
        shared += launches.THREADS * (8 * -(-capacity // 32) + 6)
    bound = MESH_BLOCKS if types.geometry & TRAVERSED else BLOCKS
    bound = MANY_MESHES_BLOCKS if meshes and capacity > launches.MANY else bound
    bound = MOVING_BLOCKS if types.scene & SceneFlag.DEFORMING_MESHES else bound
    return min(bound, launches.SHARED_MEMORY // shared)


def tiles_at_once(shape_types: Set[int], region: tuple[int, int]) -> int:
    """Return the number of tiles that a warp of a CUDA block draws at once: native/traversal/trace_outputs.h."""
    return 2 if launches.is_analytic(shape_types) and region[0] * region[1] >= 32 * 32 else 1


def traces_albedo(
    tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group, *, images: Collection[str]
) -> bool:
    """Return whether the trace of these images writes albedo, too: native/shading_pass/visibility_albedo.h."""
    width, height = request.width, request.height
    plain = launches.is_analytic(tables.shape_types) and tables.physical is None and tables.splats is None
    moved = tables.world_overrides is not None and tables.world_overrides.texture_offsets.size > 0
    if not (device.is_cuda and plain and request.lens == "pinhole") or moved or tables.num_drawn > launches.MAX_LISTED:
        return False
    if chooses_in_view(tables, request, device):
        return False
    tall = tiles_at_once(tables.shape_types, region_size(tables, group.concurrent_worlds, width, height, device))
    return {"flow", "flow_valid"}.isdisjoint(images) and width % 8 == 0 and height % (4 * tall) == 0


def _outputs(tables: SceneTables, images: Collection[str], device: wp.Device) -> TraceFlag:
    """Flags of the images that are written, and of how they are."""
    outputs = TraceFlag(0)
    for name, flag in (ARRAYS | LABELS).items():
        outputs |= flag_if(flag, name in images)
    outputs |= flag_if(TraceFlag.IDS, "ids" in images)
    outputs |= flag_if(TraceFlag.BY_WORLD, tables.ids_by_world and "bodies" in images)
    if not {"flow", "flow_valid"}.isdisjoint(images):
        outputs |= flag_if(TraceFlag.FLOW, "flow" in images) | flag_if(TraceFlag.FLOW_VALID, "flow_valid" in images)
        outputs |= flag_if(TraceFlag.FLOW_MOVES, bool(tables.moving))
        outputs |= flag_if(TraceFlag.FLOW_COMPACT, history.is_compact(tables))
        outputs |= flag_if(TraceFlag.FLOW_LISTED, history.composes(tables, device))
    elif "albedo" in images:
        outputs |= TraceFlag.TRACE_ALBEDO
    return outputs


def _whole_image(tables: SceneTables, device: wp.Device, valid: bool) -> TraceFlag:
    """Return the flags of a trace whose blocks draw whole images; with many shapes there is no room for words."""
    if not device.is_cuda:
        return TraceFlag(0)
    near = valid and history.is_compact(tables) and tables.num_drawn <= launches.MANY
    return TraceFlag.FLOW_WHOLE | flag_if(TraceFlag.FLOW_NEAR, near)
