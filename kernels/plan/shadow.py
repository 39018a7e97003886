"""Kernels of the shadow pass."""

from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import GeometryFlag, Lens, SceneFlag
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, SceneTypes, flag_if, region_size
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import MESH

BLOCKS = 8  # on a multiprocessor: bounds the registers of a thread
MANY_CASTERS_BLOCKS = 6  # the same for many casters, for which the registers of 8 are too few
LISTED_BYTES = 140  # of its shared memory for each shape of a list with meshes: shadow/casters.h, CasterList
BESIDE = 16  # up to so many shapes there are two lists: shadow/shadow_pass.h, lights_per_batch
CASTER_BOUNDS_BYTES = 16  # more where meshes have outlines: shadow/casters.h, CasterList::OUTLINED
REST_BYTES = 3400  # what else a block has, and what is reserved for it
# and for the rays of a warp, also for each 32 shapes: shadow/mesh_any_hit.h, ShadowRays
WALKED_BYTES, WORD_BYTES = 3232, 256
WALK_BYTES, WALK_SHAPES = 1280, 64  # more up to so many shapes, ShadowRays::KEEPS
SURVEY_BYTES = 2600  # more with the longest list: shadow/receivers.h, AskingTiles, near_casters.h, NearPlaces
CAPACITIES = (16, 32, 64, 128, 160)  # how many shapes a pass lists: few sizes, so that scenes share kernels
CPU_CAPACITIES = (64, 192)  # the same on a CPU, whose kernels take no longer with room to spare
MANY_CASTERS_CAPACITIES = (512, 1024)  # the same in scenes of many shapes without meshes: native/shadow/many_casters.h
MANY = 384  # shapes; with more, native/shadow/many_casters.h
MOST = 2**20  # shapes that can be told apart there


@dataclass(frozen=True)
class ShadowKey:
    """A kernel of the shadow pass: shadow/shadow_pass.h, or shadow/many_casters.h."""

    many_casters: bool
    types: SceneTypes
    lens: Lens
    capacity: int  # shapes that a block lists
    region: tuple[int, int]  # of a block [pixels]

    @property
    def blocks(self) -> int:
        return MANY_CASTERS_BLOCKS if self.many_casters else blocks(self.types, self.capacity)


def plan_shadow(
    tables: SceneTables, request: ImageRequest, device: wp.Device, group: Group
) -> PlannedLaunch[ShadowKey]:
    """The kernel of a camera's shadow pass."""
    types = launches.scene_types(tables, device)
    scene = types.scene
    if MESH in tables.shape_types:
        scene |= flag_if(SceneFlag.SHADING_BACKS, tables.physical is None or tables.backs_shade)
        scene |= flag_if(SceneFlag.HAS_OCCLUDER_BOXES, tables.physical is None and has_occluder_boxes(tables))
    scene |= flag_if(SceneFlag.TRANSPARENT_CASTERS, tables.layers is not None and bool(tables.layers.has_transparent))
    shapes = tables.shapes if tables.casters is None else tables.casters
    num_casters = shapes.drawn.shape[0]
    many = MANY < num_casters <= MOST and not (device.is_cuda and MESH in tables.shape_types)
    capacities = MANY_CASTERS_CAPACITIES if many else CAPACITIES if device.is_cuda else CPU_CAPACITIES
    capacity = next(size for size in capacities if size >= min(num_casters, capacities[-1]))
    surveyed = device.is_cuda and MESH in tables.shape_types and capacity == CAPACITIES[-1]
    scene |= flag_if(SceneFlag.BACKS_UNLIT, surveyed and tables.physical is None)
    width, height = request.width, request.height
    region = region_size(tables, group.concurrent_worlds, width, height, device, fitted=not many)
    threads = launches.world_threads(launches.regions_of(width, height, region), device)
    types = launches.in_order(SceneTypes(types.geometry, scene), len(group.worlds) * threads, device)
    return PlannedLaunch(ShadowKey(many, types, LENSES[request.lens], capacity, region), threads)


def has_occluder_boxes(tables: SceneTables) -> bool:
    """Return whether the scene's meshes have occluder boxes: pack_meshes of accel/meshes.py."""
    return tables.meshes.occluder_boxes is not None and tables.meshes.occluder_boxes.size > 0


def blocks(types: SceneTypes, capacity: int) -> int:
    """Blocks that a multiprocessor is to hold: no more than its shared memory has room for."""
    if not types.geometry & GeometryFlag.MESH:
        return BLOCKS
    walked = WALKED_BYTES + WORD_BYTES * -(-capacity // 32) + (WALK_BYTES if capacity <= WALK_SHAPES else 0)
    rays = launches.THREADS // 32 * walked
    bounds = CASTER_BOUNDS_BYTES if types.scene & SceneFlag.HAS_OCCLUDER_BOXES else 0
    listed = (LISTED_BYTES + bounds) * capacity
    listed *= 2 if capacity <= BESIDE else 1
    survey = SURVEY_BYTES if capacity == CAPACITIES[-1] else 0
    return min(BLOCKS, launches.SHARED_MEMORY // (listed + rays + survey + REST_BYTES))
