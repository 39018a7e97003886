"""Bodies that one camera does not see."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpcam.camera.camera import Camera
from warpcam.core.errors import WarpcamError
from warpcam.kernels.scene_tables import SceneTables
from warpcam.kernels.types import PLANE, SPLATS, Shapes
from warpcam.scene.scene import Scene


def kept_shapes(camera: Camera, scene: Scene) -> np.ndarray:
    """Ids of the drawn shapes that a camera sees, ascending, without those of the bodies that it excludes."""
    where = f"{camera.where}: exclude_bodies"
    bodies = [scene.body(body, where) for body in camera.exclude_bodies]
    tables, owners = scene.tables(), scene.shape_bodies()
    out = np.isin(owners, bodies)
    unseen: np.ndarray = np.asarray(out.any(axis=0))
    if (unseen & ~(out | (owners == -2)).all(axis=0)).any():
        raise WarpcamError(f"{where}: a shape is part of such a body in some worlds and of another one in others")
    if (unseen & (tables.shapes.types.numpy() == SPLATS)).any():
        raise WarpcamError(f"{where}: bodies with Gaussian splats cannot be left out")
    drawn = tables.shapes.drawn.numpy()
    return drawn[~unseen[drawn]]


class ExcludedBodies:
    """The scene's shapes without those of some bodies.

    Args:
        kept: Ids of the others, ascending.
        tables: The scene.
    """

    def __init__(self, kept: np.ndarray, tables: SceneTables):
        types, device = tables.shapes.types.numpy(), tables.shapes.drawn.device
        places = np.full(len(types), -1, np.int32)
        places[kept] = np.arange(len(kept))
        self._drawn, self._places = (wp.array(values, dtype=wp.int32, device=device) for values in (kept, places))
        self._planes = tuple(int(shape) for shape in kept if types[shape] == PLANE)

    def without(self, tables: SceneTables) -> SceneTables:
        """The tables without these shapes, which cast shadows nevertheless; kernels are those of all shapes."""
        shapes: Any = Shapes()
        shapes.assign(tables.shapes)
        shapes.drawn, shapes.places = self._drawn, self._places
        casters: Any = tables.shapes if tables.casters is None else tables.casters
        return replace(tables, shapes=shapes, planes=self._planes, casters=casters)
