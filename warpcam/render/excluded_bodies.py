"""Bodies that one camera does not see."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import PLANE, SPLATS, Shapes


class ExcludedBodies:
    """The scene's shapes without those of some bodies.

    Args:
        bodies: Indices of the bodies.
        tables: The scene.
        where: Prefix of error messages.
    """

    def __init__(self, bodies: Sequence[int], tables: SceneTables, where: str):
        shapes = tables.shapes
        types, owners = shapes.types.numpy(), shapes.bodies.numpy()
        if (np.isin(owners, bodies) & (types == SPLATS)).any():
            raise WarpcamError(f"{where}: bodies with Gaussian splats cannot be left out")
        drawn = shapes.drawn.numpy()
        kept = drawn[~np.isin(owners[drawn], bodies)]
        places = np.full(len(types), -1, np.int32)
        places[kept] = np.arange(len(kept))
        device = shapes.drawn.device
        self._drawn, self._places = (wp.array(values, dtype=wp.int32, device=device) for values in (kept, places))
        self._first_plane = next((int(shape) for shape in kept if types[shape] == PLANE), -1)

    def without(self, tables: SceneTables) -> SceneTables:
        """The tables without these shapes, which cast shadows nevertheless; kernels are those of all shapes."""
        shapes: Any = Shapes()
        shapes.assign(tables.shapes)
        shapes.drawn, shapes.places = self._drawn, self._places
        casters: Any = tables.shapes if tables.casters is None else tables.casters
        return replace(tables, shapes=shapes, first_plane=self._first_plane, casters=casters)
