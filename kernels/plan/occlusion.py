"""Kernels of the rays that tell how much light reaches a surface: from all around, and from lights of a size."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.flags import Lens, ShadingFlag
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, SceneTypes, flag_if
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.scene_tables import SceneTables

LIST_THREADS = 1  # for each world: its shapes are listed one after another
NORMAL_BYTES = 2  # of a pixel before its rays are filtered: native/occlusion/occlusion_rays.h
AMBIENT_SHARES = 4  # of light from all around: native/shading/light_visibility.h
NUM_LIGHTS = (1, 2, 4, 8)  # few numbers of lights, so that scenes share kernels; a view has at most MAX_LIGHTS


@dataclass(frozen=True)
class OccluderKey:
    """The kernel that lists the shapes of each world that hide light: native/occlusion/occluders.h."""

    types: SceneTypes

    @property
    def blocks(self) -> int:
        """Blocks that a multiprocessor is to hold: bounds the registers of a thread."""
        return 8


@dataclass(frozen=True)
class OcclusionKey:
    """The kernel of the rays, which has a thread for each pixel: native/occlusion/occlusion_rays.h."""

    types: SceneTypes
    lens: Lens
    shares: ShadingFlag  # what the rays find: of SOFT_SHADOWS and AMBIENT_OCCLUSION
    num_shares: int  # bytes of a pixel that are filtered

    @property
    def blocks(self) -> int:
        """Likewise; surfaces, lights and trees of meshes need many registers."""
        return 4


@dataclass(frozen=True)
class OcclusionFilterKey:
    """The kernel of their filter, likewise: native/occlusion/occlusion_filter.h."""

    lens: Lens
    num_shares: int

    @property
    def blocks(self) -> int:
        return 8


def shares_of(tables: SceneTables, request: ImageRequest) -> ShadingFlag:
    """What the rays of a request find."""
    soft = request.soft_shadows and request.shadows and tables.num_lights > 0
    return flag_if(ShadingFlag.SOFT_SHADOWS, soft) | flag_if(ShadingFlag.AMBIENT_OCCLUSION, request.ambient_occlusion)


def num_shares(tables: SceneTables, shares: ShadingFlag) -> int:
    """Bytes of a pixel: of light from all around, and of each light that may count."""
    lights = min(tables.num_lights, NUM_LIGHTS[-1])
    rounded = next(count for count in NUM_LIGHTS if count >= lights) if shares & ShadingFlag.SOFT_SHADOWS else 0
    return rounded + (AMBIENT_SHARES if shares & ShadingFlag.AMBIENT_OCCLUSION else 0)


def traces_occlusion(keys: Iterable[Any]) -> bool:
    """Return whether kernels of a frame trace rays that tell how much light reaches a pixel."""
    return any(isinstance(key, OcclusionKey) for key in keys)


def pixel_bytes(count: int) -> Any:
    """Type of a pixel that has so many bytes."""
    return wp.types.vector(length=count, dtype=wp.uint8)


def plan_occlusion(
    tables: SceneTables, request: ImageRequest, device: wp.Device
) -> tuple[OccluderKey, OcclusionKey, OcclusionFilterKey]:
    """The kernels of a request: of the list of shapes, of the rays, and of their filter."""
    types, lens, shares = launches.scene_types(tables, device), LENSES[request.lens], shares_of(tables, request)
    count = num_shares(tables, shares)
    return OccluderKey(types), OcclusionKey(types, lens, shares, count), OcclusionFilterKey(lens, count)
