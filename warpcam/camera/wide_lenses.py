"""Lenses that see more than half a sphere: omnidirectional ones with closed formulas, and panoramas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.camera.distortion import distorted_once, distortion_numbers, straightened
from warpcam.camera.lens_numbers import any_differs, by_world, camera_matrix, focal_matrix, require, size_of
from warpcam.camera.lens_tables import FormulaTableLens
from warpcam.camera.lens_tensors import LensNumbers, nan_unless, root, sine_and_cosine
from warpcam.core.torch_interop import torch

Place = tuple["torch.Tensor", "torch.Tensor"]
Direction = tuple["torch.Tensor", "torch.Tensor", "torch.Tensor"]


@dataclass(frozen=True, eq=False)
class Omnidirectional(FormulaTableLens):
    """The unified camera of Mei and Rives (2007): a sphere seen by a pinhole that stands ``xi`` behind its centre.

    It is OpenCV's ``omnidir`` and Kalibr's omni with radtan. Every value may be one number or one for each world,
    (world,): numpy, torch or Warp. Pixels that no ray comes to see nothing.

    Attributes:
        xi: Distance of the pinhole from the sphere's centre, at least 0.
        fx: Focal length across, positive [pixels].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. OpenCV and Kalibr count from the centre
            of the first pixel: their cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        coefficients: (4,) k1, k2, p1 and p2 of the distortion on the pinhole's plane, or (world, 4).
    """

    xi: Any
    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None
    coefficients: Any = (0.0, 0.0, 0.0, 0.0)

    @property
    def differs(self) -> bool:
        return any_differs((self.xi, self.fx, self.fy, self.cx, self.cy), (self.coefficients,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        xi = by_world(self.xi, f"{where}: xi", worlds)
        require(xi >= 0.0, xi, f"{where}: xi must be at least 0")
        k1, k2, p1, p2 = by_world(self.coefficients, f"{where}: coefficients", worlds, (4,)).T
        matrix = focal_matrix(self, width, height, where, worlds)
        distortion = distortion_numbers(worlds, (k1, k2), (), (p1, p2))
        focal = np.maximum(matrix[:, 0, 0], matrix[:, 1, 1])
        return LensNumbers(matrix, {"xi": xi, "distortion": distortion, "focal": focal})

    def onto_plane(self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]) -> Place:
        xi, length = formula["xi"], _length(x, y, z)
        seen = z > -torch.where(xi > 1.0, 1.0 / xi.clamp(min=1.0), xi) * length
        over = nan_unless(seen, z + xi * length)
        return distorted_once(x / over, y / over, formula["distortion"], formula["focal"])

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Direction:
        xi = formula["xi"]
        u, v = straightened(u, v, formula["distortion"], formula["focal"])
        square = u * u + v * v
        scale = (xi + root(1.0 + (1.0 - xi * xi) * square)) / (square + 1.0)
        return scale * u, scale * v, scale - xi


@dataclass(frozen=True, eq=False)
class DoubleSphere(FormulaTableLens):
    """The double sphere camera of Usenko, Demmel and Cremers (2018, section 2.4): Basalt's and Kalibr's ds.

    A point is brought onto a sphere, onto a second one ``xi`` ahead of it, and seen by a pinhole that ``alpha`` places.
    Every value may be one number or one for each world, (world,): numpy, torch or Warp. Pixels that no ray comes to see
    nothing.

    Attributes:
        xi: Distance between the spheres' centres.
        alpha: In [0, 1]; the pinhole is alpha / (1 - alpha) from the second sphere's centre.
        fx: Focal length across, positive [pixels].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. Basalt and Kalibr count from the centre
            of the first pixel: their cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
    """

    xi: Any
    alpha: Any
    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None

    @property
    def differs(self) -> bool:
        return any_differs((self.xi, self.alpha, self.fx, self.fy, self.cx, self.cy))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        formula = {"xi": by_world(self.xi, f"{where}: xi", worlds), "alpha": _alpha(self.alpha, where, worlds)}
        return LensNumbers(focal_matrix(self, width, height, where, worlds), formula)

    def onto_plane(self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]) -> Place:
        xi, alpha = formula["xi"], formula["alpha"]
        first = _length(x, y, z)
        ahead = xi * first + z
        second = _length(x, y, ahead)
        limit = _behind(alpha)
        limit = (limit + xi) / root(2.0 * limit * xi + xi * xi + 1.0)
        over = nan_unless(z > -limit * first, alpha * second + (1.0 - alpha) * ahead)
        return x / over, y / over

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Direction:
        xi, alpha = formula["xi"], formula["alpha"]
        square = u * u + v * v
        z = (1.0 - alpha * alpha * square) / (alpha * root(1.0 - (2.0 * alpha - 1.0) * square) + 1.0 - alpha)
        scale = (z * xi + root(z * z + (1.0 - xi * xi) * square)) / (z * z + square)
        return scale * u, scale * v, scale * z - xi


@dataclass(frozen=True, eq=False)
class ExtendedUnified(FormulaTableLens):
    """The extended unified camera of Khomutenko, Garcia and Martinet (2016): Kalibr's and Basalt's eucm.

    Its sphere is an ellipsoid; with ``beta`` 1 it is a sphere. Every value may be one number or one for each world,
    (world,): numpy, torch or Warp. Pixels that no ray comes to see nothing.

    Attributes:
        alpha: In [0, 1]: 0 is a pinhole.
        beta: Of the ellipsoid, positive.
        fx: Focal length across, positive [pixels].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. Basalt and Kalibr count from the centre
            of the first pixel: their cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
    """

    alpha: Any
    beta: Any
    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None

    @property
    def differs(self) -> bool:
        return any_differs((self.alpha, self.beta, self.fx, self.fy, self.cx, self.cy))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        beta = by_world(self.beta, f"{where}: beta", worlds)
        require(beta > 0.0, beta, f"{where}: beta must be positive")
        formula = {"alpha": _alpha(self.alpha, where, worlds), "beta": beta}
        return LensNumbers(focal_matrix(self, width, height, where, worlds), formula)

    def onto_plane(self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]) -> Place:
        alpha, beta = formula["alpha"], formula["beta"]
        length = root(beta * (x * x + y * y) + z * z)
        over = nan_unless(z > -_behind(alpha) * length, alpha * length + (1.0 - alpha) * z)
        return x / over, y / over

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Direction:
        alpha, beta = formula["alpha"], formula["beta"]
        square = beta * (u * u + v * v)
        z = (1.0 - alpha * alpha * square) / (alpha * root(1.0 - (2.0 * alpha - 1.0) * square) + 1.0 - alpha)
        length = _length(u, v, z)
        return u / length, v / length, z / length


@dataclass(frozen=True, eq=False)
class Equirectangular(FormulaTableLens):
    """A panorama: columns are azimuths, rows elevations, both evenly. Its middle looks ahead.

    Every value may be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        fovx: From the left edge to the right, in (0, 360] [degrees].
        fovy: From the bottom edge to the top, in (0, 180] [degrees].
    """

    fovx: Any = 360.0
    fovy: Any = 180.0

    @property
    def differs(self) -> bool:
        return any_differs((self.fovx, self.fovy))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        half, centre, focal = [], [], []
        for name, value, most, side_name, side in (
            ("fovx", self.fovx, 360.0, "width", width),
            ("fovy", self.fovy, 180.0, "height", height),
        ):
            angle = by_world(value, f"{where}: {name}", worlds)
            require((angle > 0.0) & (angle <= most), angle, f"{where}: {name} must be in (0, {most:g}] degrees")
            pixels = size_of(side, f"{where}: {side_name}", "by a panorama")
            half.append(np.radians(0.5 * angle) * (1.0 + 1e-12))
            centre.append(np.full(worlds, 0.5 * pixels))
            focal.append(pixels / np.radians(angle))
        return LensNumbers(camera_matrix(*focal, *centre), {"half_x": half[0], "half_y": half[1]})

    def onto_plane(self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]) -> Place:
        upright = (x == 0.0) & (z == 0.0)  # no azimuth, and no derivative: above or below the camera
        ahead = torch.where(upright, 1.0, z)
        azimuth = torch.where(upright, torch.atan2(x.detach(), z.detach()), torch.atan2(x, ahead))
        return _within(azimuth, torch.atan2(y, torch.where(upright, 0.0, torch.hypot(x, ahead))), formula)

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Direction:
        u, v = _within(u, v, formula)
        (across, ahead), (down, level) = sine_and_cosine(u), sine_and_cosine(v)
        return level * across, down, level * ahead


def _within(azimuth: torch.Tensor, elevation: torch.Tensor, formula: Mapping[str, Any]) -> Place:
    within = (azimuth.abs() <= formula["half_x"]) & (elevation.abs() <= formula["half_y"])
    return nan_unless(within, azimuth), nan_unless(within, elevation)


def _alpha(alpha: Any, where: str, worlds: int) -> np.ndarray:
    value = by_world(alpha, f"{where}: alpha", worlds)
    require((value >= 0.0) & (value <= 1.0), value, f"{where}: alpha must be in [0, 1]")
    return value


def _behind(alpha: torch.Tensor) -> torch.Tensor:
    """The cosine, from the axis backwards, up to which a unified camera sees."""
    small, large = torch.minimum(alpha, 1.0 - alpha), torch.maximum(alpha, 1.0 - alpha)
    return small / large


def _length(x: torch.Tensor, y: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    return root(x * x + y * y + z * z)
