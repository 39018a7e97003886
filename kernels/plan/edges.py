"""Kernels that smooth the edges of images."""

from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import ImageFlag, Lens
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, SceneTypes, region_size
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.plan.shading import IMAGES
from warpcam.kernels.runtime.launch import Group
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import MESH

# Pixels of which a thread block of a GPU smooths the edges, at most, in scenes without meshes and height fields. With
# them a block has as many as the trace's, or a whole image: the more samples it has, the fewer of its lanes wait for
# the longest ones.
REGION = (32, 32)
# Whole images of scenes with meshes are smoothed where they were lit if there are so many worlds for each
# multiprocessor: a block for each image fills the device then, even one group's.
WORTH_PLACE = 40
SIDE = 64  # of a region that is a whole image [pixels]
THREADS_IN_PLACE = 160  # of a block of them
# Blocks that a multiprocessor is to hold: without meshes and height fields, where ids have a byte, and more; with them;
# and of those in place.
BLOCKS, MANY_BLOCKS, WALK_BLOCKS, BLOCKS_IN_PLACE = 7, 8, 5, 4


@dataclass(frozen=True)
class EdgeKey:
    """A kernel that smooths edges: antialiasing/edge_resolve.h."""

    types: SceneTypes
    lens: Lens
    region: tuple[int, int]  # of a block [pixels]
    images: ImageFlag
    by_words: bool  # colours are loaded by words
    in_place: bool  # images are smoothed where they were lit
    threads: int  # of a block
    blocks: int  # that a multiprocessor is to hold


def plan_edges(
    tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group, *, byte_ids: bool
) -> PlannedLaunch[EdgeKey]:
    """The kernel that smooths the edges of a camera's images; ``byte_ids``: shape ids have a byte."""
    width, height = request.width, request.height
    analytic = launches.is_analytic(tables.shape_types)
    region = region_size(tables, group.concurrent_worlds, width, height, device)
    if device.is_cuda and analytic:
        region = min(region, REGION)
    placed = in_place(tables, request, device)
    if placed:
        region = (SIDE, SIDE)
        threads, blocks = THREADS_IN_PLACE, BLOCKS_IN_PLACE
    elif not analytic:
        threads, blocks = launches.THREADS, WALK_BLOCKS
    else:
        threads, blocks = launches.THREADS, BLOCKS if byte_ids else MANY_BLOCKS
    flags = ImageFlag(0)
    for name in request.smooth:
        flags |= IMAGES[name]
    by_words = device.is_cuda and _by_words(tables, request)
    key = EdgeKey(
        types=launches.scene_types(tables, device),
        lens=LENSES[request.lens],
        region=region,
        images=flags,
        by_words=by_words,
        in_place=placed,
        threads=threads,
        blocks=blocks,
    )
    return PlannedLaunch(key, launches.world_threads(launches.regions_of(width, height, region), device, threads))


def in_place(tables: SceneTables, request: ImageRequest, device: wp.Device) -> bool:
    """Return whether images are smoothed in place, without a buffer of their colours."""
    if not device.is_cuda or not _by_words(tables, request):
        return False
    return request.width <= SIDE and request.height <= SIDE and tables.num_worlds >= WORTH_PLACE * device.sm_count


def wave(device: wp.Device) -> int:
    """Return the number of images that a device smooths in place at once: groups of worlds are multiples of it."""
    return device.sm_count * BLOCKS_IN_PLACE


def _by_words(tables: SceneTables, request: ImageRequest) -> bool:
    """Return whether colours are loaded by words, in scenes that gain by it."""
    pixels = request.width * request.height
    return MESH in tables.shape_types and "hdr" not in request.smooth and pixels % 4 == 0 and request.width >= 3
