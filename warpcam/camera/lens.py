"""Lenses: how the pixels of an image become rays, and points become pixels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from warpcam.camera.lens_numbers import (
    any_differs,
    by_world,
    camera_matrix,
    check_focal_choice,
    focal_matrix,
    require,
    size_of,
)
from warpcam.camera.lens_tensors import (
    Columns,
    LensNumbers,
    along_rays,
    as_coordinates,
    lens_tensors,
    mapped,
    nan_unless,
    root,
    seen_alone,
    worlds_of,
)
from warpcam.core.torch_interop import torch

Projection = Literal["pinhole", "orthographic", "rays", "offset_rays"]

# Pixels whose rays are found at a time: so few that their numbers stay in caches, and that torch starts no threads, for
# which a process that was forked would wait in vain.
AT_ONCE = 1 << 13


class Lens(ABC):
    """A lens of your own, in place of the one the scene's camera has."""

    @property
    @abstractmethod
    def projection(self) -> Projection:
        """Kind of the lens's rays."""

    @abstractmethod
    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        """The lens's numbers by the name of the array they go to, for an image of that size [pixels].

        Each number is a scalar or has shape (world,).
        """

    @abstractmethod
    def project(self, points: Any, *, width: int | None = None, height: int | None = None) -> torch.Tensor:
        """Return the pixels where points come to.

        Args:
            points: (..., 3) in the camera's frame [m]: -z ahead, +x right, +y up. (world, ..., 3) for a lens that
                differs by world. A tensor on any device, of any real dtype.
            width: Of the image [pixels]; needed only by a lens whose numbers depend on it, as one without ``cx``.
            height: Likewise.

        Returns:
            (..., 2) column and row [pixels], on the points' device and of their dtype (float32 of integers), computed
            in float64. The first pixel's centre is (0.5, 0.5). NaN for a point that the lens does not see: behind the
            camera, or outside the range of the lens's formula. Pixels outside the image are given as they are.

        Raises:
            WarpcamError: An argument has another shape or dtype, or the size is needed and was not given.
        """

    @abstractmethod
    def unproject(
        self,
        pixels: Any,
        depth: Any = None,
        *,
        distance: Any = None,
        width: int | None = None,
        height: int | None = None,
    ) -> torch.Tensor:
        """Return where pixels look, or the points that they see.

        Args:
            pixels: (..., 2) column and row [pixels]; the first pixel's centre is (0.5, 0.5). (world, ..., 2) for a lens
                that differs by world. A tensor on any device, of any real dtype.
            depth: Planar depth [m], as the output ``depth``, of shape (...), or one that can be broadcast to (..., 1).
            distance: Instead of ``depth``: the distance along the ray [m], as the output ``distance``.
            width: Of the image [pixels]; needed only by a lens whose numbers depend on it, as one without ``cx``.
            height: Likewise.

        Returns:
            (..., 3) in the camera's frame, on the pixels' device and of their dtype (float32 of integers), computed in
            float64: directions of length 1, or with ``depth`` or ``distance`` points [m]. NaN for a pixel that sees
            nothing, and for a depth that its ray does not reach.

        Raises:
            WarpcamError: An argument has another shape or dtype, both ``depth`` and ``distance`` came, or the size is
                needed and was not given.
        """


class FormulaLens(Lens):
    """A lens that a formula gives in both directions.

    The formula leads from directions, x right, y down and z ahead, to a plane, u right and v down; a matrix leads from
    there to pixels.
    """

    @property
    @abstractmethod
    def differs(self) -> bool:
        """True if the lens differs by world."""

    @abstractmethod
    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        """Return the lens's numbers for one or that many worlds.

        Raises:
            WarpcamError: A number is not allowed, or the image's size is needed; the text begins with ``where``.
        """

    @abstractmethod
    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return where points come to on the plane; NaN for those that are not seen.

        Numbers of the ``formula`` can be broadcast with the points; those of shape (n, m) are ``Columns``.
        """

    @abstractmethod
    def from_plane(
        self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the directions, of length 1, that come to places of the plane; NaN where none does."""

    def origins(self, u: torch.Tensor, v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor] | None:
        """Return where rays begin, right and down [m], or None if all begin at the camera's position."""
        return None

    def project(self, points: Any, *, width: int | None = None, height: int | None = None) -> torch.Tensor:
        where = f"{type(self).__name__}.project"
        given = as_coordinates(points, 3, f"{where}: points")
        matrix, _, formula = self._on_device(given, width, height, where)

        def pixels_of(points: torch.Tensor) -> torch.Tensor:
            x, y, z = points.unbind(-1)
            column, row = mapped(matrix, *self.onto_plane(x, -y, -z, formula))
            somewhere = (x != 0.0) | (y != 0.0) | (z != 0.0) | (self.projection == "orthographic")
            return torch.stack([nan_unless(somewhere, column), nan_unless(somewhere, row)], dim=-1)

        return seen_alone(pixels_of, given.double(), lambda: (0.0, 0.0, -1.0)).to(given.dtype)

    def unproject(
        self,
        pixels: Any,
        depth: Any = None,
        *,
        distance: Any = None,
        width: int | None = None,
        height: int | None = None,
    ) -> torch.Tensor:
        where = f"{type(self).__name__}.unproject"
        given = as_coordinates(pixels, 2, f"{where}: pixels")
        matrix, inverse, formula = self._on_device(given, width, height, where)

        def seen_by(pixels: torch.Tensor) -> torch.Tensor:
            u, v = mapped(inverse, *pixels.unbind(-1))
            x, y, z = self.from_plane(u, v, formula)
            rays = torch.stack([x, -y, -z], dim=-1)
            length = along_rays(rays, given, depth, distance, where)
            if length is None:
                return rays
            points = length * rays
            if (start := self.origins(u, v)) is not None:
                points = points + torch.stack([start[0], -start[1], torch.zeros_like(u)], dim=-1)
            return points

        def middle() -> tuple[torch.Tensor, torch.Tensor]:
            origin = torch.zeros_like(given[..., 0], dtype=torch.float64)
            return mapped(matrix, origin, origin)

        return seen_alone(seen_by, given.double(), middle).to(given.dtype)

    def pixel_rays(
        self, width: int, height: int, worlds: int, where: str, parts: tuple[int, int] = (1, 1)
    ) -> np.ndarray:
        """Return where pixels' centres look, (world, height, width, 3) in the camera's frame; 0 sees nothing.

        With ``parts``, so many across and down, of each pixel: the centres of these.
        """
        numbers = self.numbers(width, height, worlds, where)
        across, down = parts[0] * width, parts[1] * height
        row, column = np.divmod(np.arange(down * across, dtype=np.float64), across)
        row, column = (row + 0.5) / parts[1], (column + 0.5) / parts[0]
        table = np.empty((worlds, down * across, 3))
        for world in range(worlds):
            _, inverse, formula = lens_tensors(numbers.of(world), 0, torch.device("cpu"))
            for first in range(0, down * across, AT_ONCE):
                some = slice(first, first + AT_ONCE)
                centres = mapped(inverse, torch.from_numpy(column[some]), torch.from_numpy(row[some]))
                rays = self.from_plane(*centres, formula)
                for axis, (sign, values) in enumerate(zip((1.0, -1.0, -1.0), rays, strict=True)):
                    table[world, some, axis] = sign * values.numpy()
        return np.nan_to_num(table, copy=False, nan=0.0).reshape(worlds, down, across, 3)

    def _on_device(
        self, given: torch.Tensor, width: int | None, height: int | None, where: str
    ) -> tuple[Columns, Columns, dict[str, Any]]:
        """Matrix, inverse and numbers of the formula, which can be broadcast with the coordinates of ``given``."""
        worlds = worlds_of(self.differs, given, where)
        return lens_tensors(self.numbers(width, height, worlds, where), given.ndim - 1, given.device)


@dataclass(frozen=True, eq=False)
class Pinhole(FormulaLens):
    """The perspective of an ideal pinhole.

    Give either ``fovy``, or ``fx`` and, where they differ from the usual, ``fy``, ``cx`` and ``cy``. Every value may
    be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        fovy: Vertical field of view, in (0, 180) [degrees]. Pixels are square, the principal point is the centre.
        fx: Focal length across, positive [pixels].
        fy: Focal length down, positive [pixels]; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; the centre, width / 2, unless given.
        cy: Principal point from the top edge [pixels]; the centre, height / 2, unless given.
    """

    fovy: Any = None
    fx: Any = None
    fy: Any = None
    cx: Any = None
    cy: Any = None

    projection: ClassVar[Projection] = "pinhole"

    def __post_init__(self) -> None:
        check_focal_choice("Pinhole", self.fovy, self.fx, [self.fy, self.cx, self.cy], "pixels")

    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        if self.fovy is not None:
            return {"fovy": (self.fovy,)}
        fy = self.fx if self.fy is None else self.fy
        cx = 0.5 * width if self.cx is None else self.cx
        cy = 0.5 * height if self.cy is None else self.cy
        return {"intrinsics": (self.fx, fy, cx, cy)}

    @property
    def differs(self) -> bool:
        return any_differs((self.fovy, self.fx, self.fy, self.cx, self.cy))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        if self.fovy is None:
            return LensNumbers(focal_matrix(self, width, height, where, worlds), {})
        fovy = by_world(self.fovy, f"{where}: fovy", worlds)
        require((fovy > 0.0) & (fovy < 180.0), fovy, f"{where}: fovy must be in (0, 180) degrees")
        across = size_of(width, f"{where}: width", "with fovy")
        down = size_of(height, f"{where}: height", "with fovy")
        focal = 0.5 * down / np.tan(np.radians(0.5 * fovy))
        centre = np.full(worlds, 0.5 * across), np.full(worlds, 0.5 * down)
        return LensNumbers(camera_matrix(focal, focal, *centre), {})

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        ahead = nan_unless(z > 0.0, z)
        return x / ahead, y / ahead

    def from_plane(
        self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        length = root(u * u + v * v + 1.0)
        return u / length, v / length, 1.0 / length


@dataclass(frozen=True, eq=False)
class Orthographic(FormulaLens):
    """Parallel rays.

    Rays of ``unproject`` begin at the plane of the camera: their points at a depth of 0.

    Attributes:
        height: What the image spans from bottom to top, positive [m]; a number or (world,). Pixels are square.
    """

    height: Any

    projection: ClassVar[Projection] = "orthographic"

    def values(self, width: int, height: int) -> Mapping[str, tuple[Any, ...]]:
        return {"height": (self.height,)}

    @property
    def differs(self) -> bool:
        return any_differs((self.height,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        span = by_world(self.height, f"{where}: height of the lens", worlds)
        require(span > 0.0, span, f"{where}: height of the lens must be positive")
        across = size_of(width, f"{where}: width", "by an orthographic lens")
        down = size_of(height, f"{where}: height", "by an orthographic lens")
        centre = np.full(worlds, 0.5 * across), np.full(worlds, 0.5 * down)
        return LensNumbers(camera_matrix(down / span, down / span, *centre), {})

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        ahead = z >= 0.0
        return nan_unless(ahead, x), nan_unless(ahead, y)

    def from_plane(
        self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        none = 0.0 * u + 0.0 * v  # NaN for pixels that are
        return none, none, none + 1.0

    def origins(self, u: torch.Tensor, v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return u, v
