"""Lines as programs give them to viewers: arrays of ``Vec3.dtype``, (line, 2), with a colour each."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.math_types import VEC3, Transform
from warpcam.core.errors import WarpcamError

Color = Iterable[float] | None


class LineGeometry(ABC):
    """Lines that may be drawn at many places."""

    @abstractmethod
    def vertices(self) -> np.ndarray:
        """(line, 2) of ``Vec3.dtype`` [m]."""

    @abstractmethod
    def colors(self) -> np.ndarray:
        """(line,) of ``Vec3.dtype``."""

    def num_lines(self) -> int:
        return len(self.vertices())

    def instance_verts(self, pose: Transform | None = None) -> np.ndarray:
        """Its vertices at a pose; a copy."""
        return self.vertices().copy() if pose is None else pose.transform_points(self.vertices())


class _Lines(LineGeometry):
    def __init__(self, ends: Any, colors: Any, pose: Transform | None):
        verts = _vectors(np.asarray(ends, np.float32))
        self.verts = verts if pose is None else pose.transform_points(verts)
        self._colors = _vectors(np.broadcast_to(np.asarray(colors, np.float32), (len(verts), 3)))

    def vertices(self) -> np.ndarray:
        return self.verts

    def colors(self) -> np.ndarray:
        return self._colors


class AxesGeometry(_Lines):
    """The three axes of a frame: red, green and blue."""

    def __init__(self, scale: float = 1.0, pose: Transform | None = None):
        super().__init__([[(0, 0, 0), axis] for axis in scale * np.eye(3)], np.eye(3), pose)


class WireframeBBoxGeometry(_Lines):
    """The edges of a box between two corners, (2, 3) [m]."""

    def __init__(self, bbox: Any, pose: Transform | None = None, color: Color = None):
        corners = np.array([[float(value) for value in corner] for corner in bbox])
        if corners.shape != (2, 3):
            raise WarpcamError(f"bbox must be two corners, (2, 3), got shape {corners.shape}")
        edges = []
        for axis in range(3):
            aside = [other for other in range(3) if other != axis]
            for sides in product((0, 1), repeat=2):
                ends = np.empty((2, 3))
                ends[:, axis] = corners[:, axis]
                ends[:, aside] = [corners[side, other] for side, other in zip(sides, aside, strict=True)]
                edges.append(ends)
        super().__init__(edges, _color(color), pose)


class WireframeBoxGeometry(WireframeBBoxGeometry):
    """The edges of a box about the origin."""

    def __init__(
        self,
        xdim: float = 1,
        ydim: float = 1,
        zdim: float = 1,
        pose: Transform | None = None,
        color: Color = None,
    ):
        half = 0.5 * np.array((xdim, ydim, zdim))
        super().__init__((-half, half), pose, color)


class WireframeSphereGeometry(_Lines):
    """Meridians of one colour and parallels of another, about y."""

    def __init__(
        self,
        radius: float = 1.0,
        num_lats: int = 8,
        num_lons: int = 8,
        pose: Transform | None = None,
        color: Color = None,
        color2: Color = None,
    ):
        first = _color(color)
        second = first if color2 is None else _color(color2)
        around, down = 2.0 * math.pi / num_lats, math.pi / num_lons
        ends, colors = [], []
        for i, j in product(range(num_lats), range(num_lons)):
            here = _on_ball(radius, i * around, j * down)
            ends += [(here, _on_ball(radius, i * around, (j + 1) * down))]
            ends += [(here, _on_ball(radius, (i + 1) * around, j * down))]
            colors += [first, second]
        super().__init__(ends, colors, pose)


def _on_ball(radius: float, around: float, down: float) -> tuple[float, float, float]:
    aside = radius * math.sin(down)
    return aside * math.sin(around), radius * math.cos(down), aside * math.cos(around)


def _color(color: Color) -> tuple[float, ...]:
    return (1.0, 0.0, 0.0) if color is None else tuple(color)


def _vectors(numbers: np.ndarray) -> np.ndarray:
    """(..., 3) as (...) of ``Vec3.dtype``."""
    return np.ascontiguousarray(numbers, np.float32).view(VEC3)[..., 0]
