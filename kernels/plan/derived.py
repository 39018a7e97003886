"""Kernels of passes that derive outputs pixel by pixel from what the trace has found."""

from dataclasses import dataclass

import warp as wp

from warpcam.kernels.flags import Lens
from warpcam.kernels.plan import launches
from warpcam.kernels.plan.launches import LENSES, PlannedLaunch, SceneTypes
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.scene_tables import SceneTables

BLOCKS = 8  # on a multiprocessor: bounds the registers of a thread


@dataclass(frozen=True)
class DerivedKey:
    """A kernel that has a thread for each pixel."""

    types: SceneTypes
    lens: Lens

    @property
    def blocks(self) -> int:
        return BLOCKS


def plan_derived(tables: SceneTables, request: ImageRequest, device: wp.Device) -> PlannedLaunch[DerivedKey]:
    """The kernel of such a pass."""
    key = DerivedKey(launches.scene_types(tables, device), LENSES[request.lens])
    return PlannedLaunch(key, request.width * request.height)
