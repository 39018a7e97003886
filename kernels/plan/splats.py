"""Kernels that blend clouds of Gaussians over the images."""

from collections.abc import Collection
from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import Lens, SplatFlag, TraceFlag
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, flag_if
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.scene_tables import SceneTables

IMAGES = {
    "rgb": SplatFlag.RGB,
    "rgba": SplatFlag.RGBA,
    "hdr": SplatFlag.HDR,
    "albedo": SplatFlag.ALBEDO,
    "depth": SplatFlag.DEPTH,
    "distance": SplatFlag.DISTANCE,
    "points": SplatFlag.POINTS,
    "normals": SplatFlag.NORMALS,
    "segmentation": SplatFlag.SHAPE,
    "bodies": SplatFlag.BODIES,
    "instances": SplatFlag.INSTANCES,
    "semantics": SplatFlag.SEMANTICS,
}
IDS = ("segmentation", "bodies", "instances", "semantics")
LIT = ("rgb", "rgba", "hdr")  # what an exposure changes
REGION = 16  # side of what a block draws [pixels], SPLAT_REGION
BLOCKS = 6  # on a multiprocessor: bounds the registers of a thread
CAPACITIES = (4, 16, 64, 128)  # clouds that a block keeps: few sizes, so that scenes share kernels


@dataclass(frozen=True)
class SplatKey:
    """A kernel that blends clouds: splats/gaussian_blend.h."""

    lens: Lens
    capacity: int  # clouds that a block keeps
    images: SplatFlag
    flow: TraceFlag  # FLOW, FLOW_VALID and FLOW_MOVES

    @property
    def blocks(self) -> int:
        return BLOCKS

    @property
    def wanted(self) -> int:
        """C++ template parameter: the bits of both."""
        return int(self.images) | int(self.flow)


def plan_splats(
    tables: SceneTables, request: ImageRequest, device: wp.Device, *, images: Collection[str]
) -> PlannedLaunch[SplatKey]:
    """The kernel that draws clouds over ``images``, which may have "flow" and "flow_valid" among them."""
    flow = flag_if(TraceFlag.FLOW, "flow" in images) | flag_if(TraceFlag.FLOW_VALID, "flow_valid" in images)
    if flow:
        flow |= flag_if(TraceFlag.FLOW_MOVES, bool(tables.moving))
    overrides = tables.world_overrides
    exposed = overrides is not None and overrides.exposures.size > 0 and not set(LIT).isdisjoint(images)
    flags = flag_if(SplatFlag.BY_WORLD, tables.ids_by_world) | flag_if(SplatFlag.EXPOSED, exposed)
    flags |= flag_if(SplatFlag.SOLID, tables.splat_limits is not None)
    flags |= flag_if(SplatFlag.LINEAR, tables.physical is not None and "hdr" in images)
    flags |= flag_if(SplatFlag.OPAQUE, tables.opaque_splats)
    colored = not {"rgb", "rgba", "hdr", "albedo"}.isdisjoint(images)
    flags |= flag_if(SplatFlag.HARMONICS, tables.splats.harmonic_rows > 0 and colored)
    for name, flag in IMAGES.items():
        flags |= flag_if(flag, name in images and not (tables.opaque_splats and name in IDS))
    capacity = next(size for size in CAPACITIES if size >= tables.splats.columns.shape[0])
    regions = launches.regions_of(request.width, request.height, (REGION, REGION))
    threads = launches.world_threads(regions, device)
    return PlannedLaunch(SplatKey(LENSES[request.lens], capacity, flags, flow), threads)
