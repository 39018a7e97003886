"""Sizes of launches: pixels of a thread block, shapes it lists, order of blocks, and how many there are."""

from collections.abc import Set
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import warp as wp

from warpcam.kernels.flags import APPEARANCE_FLAGS, TRAVERSED, GeometryFlag, Lens, SceneFlag, geometry_of
from warpcam.kernels.runtime.cpu_pool import cpu_threads
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import HEIGHT_FIELD, MESH

LENSES = {
    "pinhole": Lens.PINHOLE,
    "orthographic": Lens.ORTHOGRAPHIC,
    "rays": Lens.RAYS,
    "offset_rays": Lens.RAY_TABLE_WITH_ORIGINS,
}
TABLES = frozenset(("rays", "offset_rays"))  # those of them that are tables
THREADS = 128  # of a CUDA block; core/platform.h has the same number
REGIONS = ((64, 64), (64, 32), (32, 32), (32, 16), (16, 16), (16, 8))
TALL = (32, 96)  # regions of images that clearly fewer of them cover than of the largest
QUICK = (32, 16)  # pixels: a strip of tiles for each warp
MANY = 64  # shapes
FEW_BLOCKS = 3  # on a multiprocessor: as many are enough where a block's tiles take about as long as setting it up
ROW_OF_BLOCKS = 2**24 // THREADS  # Warp lays out a launch's threads in rows of so many
SHARED_MEMORY = 228 * 1024  # of a multiprocessor [bytes]
MAX_LISTED = 256  # shapes that one pass draws
MANY_LISTED = 1024  # the same on a CPU, which has room for more
CAPACITIES = (16, 32, 64, 96, 128, 192, 256)  # few sizes, so that scenes share kernels
CPU_CAPACITIES = (64, MAX_LISTED, MANY_LISTED)  # a CPU's kernels take no longer with room to spare
# Shape types that CPU kernels have together. With few sets scenes share kernels, and the loop over the shapes of a tile
# takes one branch for all its lanes.
CPU_SETS = (
    GeometryFlag.PLANE
    | GeometryFlag.SPHERE
    | GeometryFlag.CAPSULE
    | GeometryFlag.ELLIPSOID
    | GeometryFlag.CYLINDER
    | GeometryFlag.BOX,
    GeometryFlag.CONE | GeometryFlag.BARREL,
)

SHAPE_IDS = {wp.int8: 127, wp.int16: 2**15, wp.int32: 2**31}  # up to how many shapes

Key = TypeVar("Key")


@dataclass(frozen=True)
class PlannedLaunch(Generic[Key]):
    """A kernel's key, and the threads that its launch has for each world."""

    key: Key
    threads: int


@dataclass(frozen=True)
class SceneTypes:
    """Shapes and features that a kernel is compiled for."""

    geometry: GeometryFlag
    scene: SceneFlag

    @property
    def native(self) -> str:
        """C++ type of the same features: native/camera/shape_record.h."""
        return f"warpcam::SceneTypes<{int(self.geometry)}, {int(self.scene)}>"


def scene_types(tables: SceneTables, device: wp.Device, *, appearance: bool = False, lit: bool = True) -> SceneTypes:
    """Return the shapes and features that a kernel is compiled for.

    CUDA kernels have just the types of the scene, as further ones cost registers. CPU kernels have sets of types.

    Args:
        tables: The scene.
        device: Device of the kernel.
        appearance: Whether the kernel shades, and needs the features of textures and normals.
        lit: Whether the kernel's images are lit, and do not show planes from behind as solid.
    """
    geometry = geometry_of(tables.shape_types)
    if not device.is_cuda:
        analytic, others = CPU_SETS
        if geometry & others:
            geometry |= analytic | others
        elif geometry & analytic:
            geometry |= analytic
    flags = tables.flags & ~SceneFlag.PLANES_FROM_BEHIND if lit else tables.flags
    return SceneTypes(geometry, flags if appearance else flags & ~APPEARANCE_FLAGS)


def is_analytic(shape_types: Set[int]) -> bool:
    """Return whether there are neither meshes nor height fields, which rays walk through."""
    return {MESH, HEIGHT_FIELD}.isdisjoint(shape_types)


def id_dtypes(tables: SceneTables, device: wp.Device) -> tuple[Any, Any]:
    """Return the types of shape ids and faces between stages: small ones on CUDA, on a CPU one for all scenes."""
    if not device.is_cuda:
        return wp.int32, wp.int32
    ids = next(dtype for dtype, most in SHAPE_IDS.items() if tables.num_shapes <= most)
    return ids, wp.uint16 if tables.num_faces < 2**16 else wp.int32


def regions_of(width: int, height: int, region: tuple[int, int]) -> int:
    """Return the number of regions of an image."""
    return -(-width // region[0]) * -(-height // region[1])


def world_threads(blocks: int, device: wp.Device, threads: int = THREADS) -> int:
    """Threads of a launch for so many blocks: a CPU has one for each."""
    return blocks * (threads if device.is_cuda else 1)


def in_order(types: SceneTypes, threads: int, device: wp.Device) -> SceneTypes:
    """The types of a launch, with MIDDLE_FIRST where rays are walked: the longest ones are in the middle of images."""
    walked = types.geometry & TRAVERSED or types.scene & SceneFlag.DEFORMING_MESHES
    if device.is_cuda and walked and threads <= ROW_OF_BLOCKS * THREADS:
        return SceneTypes(types.geometry, types.scene | SceneFlag.MIDDLE_FIRST)
    return types


def list_capacity(num_drawn: int, device: wp.Device, most: int = MAX_LISTED) -> int:
    """Return the capacity of a block's shape list for a scene of that many shapes."""
    sizes = CAPACITIES if device.is_cuda else CPU_CAPACITIES
    return next(size for size in sizes if size >= min(num_drawn, most))


def rounded_capacity(count: int, step: int, device: wp.Device) -> int:
    """Room for so many, a multiple of a step, so that scenes share kernels; on a CPU, whose room is large, of 32."""
    if not device.is_cuda and count > 2 * step:
        step = 32
    return -(-count // step) * step


def region_size(
    tables: SceneTables,
    at_once: int,
    width: int,
    height: int,
    device: wp.Device,
    quick: bool | None = None,
    *,
    fitted: bool = False,
) -> tuple[int, int]:
    """Pixels that one thread block draws: as many as leave enough blocks to fill the device.

    Fewer in scenes with meshes, whose blocks take long, if an image has several regions or there are many shapes: at
    the end of a launch the last blocks are waited for. On a CPU no more than one for each core, as listing the shapes
    of a small region takes longer than drawing it.

    Args:
        tables: The scene.
        at_once: Worlds that are under way on the device at the same time.
        width: Of the image [pixels].
        height: Of the image [pixels].
        device: Where it is drawn.
        quick: Tiles take about as long as setting a block up, so that few worlds are not cut into blocks of a tile a
            warp; None: in scenes without meshes and height fields.
        fitted: Regions may be TALL. In scenes without meshes and height fields a CUDA block takes about as long to
            set up for a region that lies half outside of its image as for a whole one.
    """
    if quick is None:
        quick = is_analytic(tables.shape_types)
    wanted = device.sm_count * 10 if device.is_cuda else cpu_threads()
    largest = 0
    if fitted and device.is_cuda and is_analytic(tables.shape_types):
        count = regions_of(width, height, TALL)
        if 8 * count <= 7 * regions_of(width, height, REGIONS[0]) and at_once * count >= wanted:
            return TALL
    if device.is_cuda and MESH in tables.shape_types:
        several = width > REGIONS[0][0] or height > REGIONS[0][1]
        largest = 2 if tables.num_drawn > MANY else 1 if several else 0
    for size in REGIONS[largest:-1]:
        count = at_once * regions_of(width, height, size)
        if count >= wanted or (device.is_cuda and quick and size == QUICK and count >= FEW_BLOCKS * device.sm_count):
            return size
    return REGIONS[-1]


def flag_if(flag: Any, there: bool) -> Any:
    """The flag, or none of its kind."""
    return flag if there else type(flag)(0)
