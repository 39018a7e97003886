"""Lenses that no formula of the trace has: each is a table of one ray for each pixel.

A table is made once, when the renderer is. Rays run from the camera's position, but where ``Rays`` is given other
places; ``near`` and ``far`` count along them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.accel.offset_ray_tables import offset_table_floats
from warpcam.accel.ray_tables import MOST_PIXELS, table_floats
from warpcam.camera.lens import FormulaLens, Lens, Projection
from warpcam.camera.lens_numbers import finite_numbers, shape_of
from warpcam.camera.lens_tensors import along_rays, as_coordinates, seen_alone, worlds_of
from warpcam.camera.ray_lookup import RayLookup
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import torch


class RayTableLens(Lens):
    """A lens that is a table of rays."""

    @property
    def projection(self) -> Projection:
        return "offset_rays" if self.has_origins else "rays"

    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        return {}

    @property
    @abstractmethod
    def differs(self) -> bool:
        """True if the table differs by world."""

    @abstractmethod
    def rays(self, width: int, height: int, num_worlds: int, where: str, parts: tuple[int, int] = (1, 1)) -> np.ndarray:
        """(1 or world, height, width, 3) in the camera's frame, of any length; 0 sees nothing.

        With ``parts``, so many across and down, of each pixel: one ray for each of these, where ``has_parts``.
        """

    @property
    def has_parts(self) -> bool:
        """True if there are rays for parts of pixels."""
        return False

    @property
    def has_origins(self) -> bool:
        """True if rays have own origins, apart from the camera's position."""
        return False

    def starts(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        """(1 or world, height, width, 3) where rays begin, in the camera's frame [m]."""
        return np.zeros((1, height, width, 3))

    def bytes(self, width: int, height: int, num_worlds: int) -> int:
        """Return the size of the lens's tables [bytes]."""
        floats = offset_table_floats(width, height) if self.has_origins else table_floats(width, height)
        return 4 * (floats + 4) * (num_worlds if self.differs else 1)


class FormulaTableLens(FormulaLens, RayTableLens):
    """A table of rays that a formula gives."""

    def rays(self, width: int, height: int, num_worlds: int, where: str, parts: tuple[int, int] = (1, 1)) -> np.ndarray:
        worlds = num_worlds if self.differs else 1
        return self.pixel_rays(width, height, worlds, f"{where}: lens {type(self).__name__}", parts)

    @property
    def has_parts(self) -> bool:
        return True


def check_table_size(lens: Lens | None, width: int, height: int, where: str) -> None:
    """Raise if no table may be as large as that."""
    if isinstance(lens, RayTableLens) and max(width, height) > MOST_PIXELS:
        raise WarpcamError(
            f"{where}: lens {type(lens).__name__}: at most {MOST_PIXELS} pixels across and down are allowed, got "
            f"{width} x {height}"
        )


@dataclass(frozen=True, eq=False)
class Rays(RayTableLens):
    """Any camera: a ray for each pixel.

    Attributes:
        directions: (height, width, 3), or (world, height, width, 3): where each pixel looks, in the camera's frame
            (-z ahead, +x right, +y up), of any length; numpy, torch or Warp. A pixel with (0, 0, 0) sees nothing. All
            directions are allowed, straight back, too. Between pixels' centres ``unproject`` gives the linear mean, and
            ``project`` searches for it: NaN outside the image.
        origins: Of the same shapes: where each pixel's ray begins, in the camera's frame [m]. None: all at the camera's
            position. A table with them is four times as large, and takes longer to trace.
    """

    directions: Any
    origins: Any = None

    @property
    def differs(self) -> bool:
        return 4 in (len(shape_of(self.directions)), 0 if self.origins is None else len(shape_of(self.origins)))

    @property
    def has_origins(self) -> bool:
        return self.origins is not None

    def starts(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        if self.origins is None:
            return super().starts(width, height, num_worlds, where)
        return self._table(self.origins, width, height, num_worlds, f"{where}: lens Rays: origins")

    def rays(self, width: int, height: int, num_worlds: int, where: str, parts: tuple[int, int] = (1, 1)) -> np.ndarray:
        where = f"{where}: lens Rays: directions"
        given = self._table(self.directions, width, height, num_worlds, where)
        if not given.any():
            raise WarpcamError(f"{where} are all 0: no pixel sees anything")
        return given

    def project(self, points: Any, *, width: int | None = None, height: int | None = None) -> torch.Tensor:
        given = as_coordinates(points, 3, "Rays.project: points")
        lookup, world = self._lookup(given, width, height, "Rays.project")
        pixels = lookup.pixels_of(world.reshape(-1), given.double().reshape(-1, 3))
        return pixels.reshape(*given.shape[:-1], 2).to(given.dtype)

    def unproject(
        self,
        pixels: Any,
        depth: Any = None,
        *,
        distance: Any = None,
        width: int | None = None,
        height: int | None = None,
    ) -> torch.Tensor:
        given = as_coordinates(pixels, 2, "Rays.unproject: pixels")
        lookup, world = self._lookup(given, width, height, "Rays.unproject")

        def seen_by(pixels: torch.Tensor) -> torch.Tensor:
            rays, starts = lookup.at(world, *pixels.unbind(-1))
            length = along_rays(rays, given, depth, distance, "Rays.unproject", starts)
            return rays if length is None else starts + length * rays

        down, across = shape_of(self.directions)[-3:-1]
        return seen_alone(seen_by, given.double(), lambda: (0.5 * across, 0.5 * down)).to(given.dtype)

    def _lookup(
        self, given: torch.Tensor, width: int | None, height: int | None, where: str
    ) -> tuple[RayLookup, torch.Tensor]:
        """The table on the device of ``given``, and the world of each of its coordinates."""
        down, across = shape_of(self.directions)[-3:-1]
        for name, came, side in (("width", width, across), ("height", height, down)):
            if came not in (None, side):
                raise WarpcamError(f"{where}: {name} must be the table's, {side}, or None, got {came!r}")
        world = torch.zeros(given.shape[:-1], dtype=torch.int64, device=given.device)
        worlds = worlds_of(self.differs, given, where)
        if self.differs:
            world += torch.arange(worlds, device=given.device).reshape(-1, *(1 for _ in given.shape[1:-1]))
        rays, starts = self.rays(across, down, worlds, where), self.starts(across, down, worlds, where)
        return RayLookup(rays, starts, given.device), world

    @staticmethod
    def _table(value: Any, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        given = finite_numbers(value, where)
        if given.shape not in ((height, width, 3), (num_worlds, height, width, 3)):
            raise WarpcamError(
                f"{where} must have shape ({height}, {width}, 3) or ({num_worlds}, {height}, {width}, 3), for images "
                f"of {width} x {height} pixels, got {given.shape}"
            )
        return given.reshape(-1, height, width, 3)
