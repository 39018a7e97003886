"""Lenses with tangential and thin-prism distortion, of a pinhole or of a fisheye."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.camera.distortion import (
    distorted_once,
    distortion_numbers,
    lateral_numbers,
    radial_numbers,
    straightened,
)
from warpcam.camera.fisheye import axis_angle, direction_at, half_angles, place_at, plane_distance
from warpcam.camera.lens_numbers import any_differs, coefficients_by_world, focal_matrix
from warpcam.camera.lens_tables import FormulaTableLens
from warpcam.camera.lens_tensors import LensNumbers, nan_unless, root
from warpcam.core.torch_interop import torch

Tensors3 = tuple["torch.Tensor", "torch.Tensor", "torch.Tensor"]


@dataclass(frozen=True, eq=False)
class Distorted(FormulaTableLens):
    """A pinhole with the distortion of OpenCV's ``calibrateCamera`` (Brown and Conrady, rational, thin prism, tilt).

    ROS calls the model plumb_bob with 5 coefficients and rational_polynomial with 8; Kalibr calls it radtan with 4.
    Every value may be one number or one for each world, (world,): numpy, torch or Warp. Pixels that no ray comes to,
    beyond the model's reach, see nothing.

    Attributes:
        fx: Focal length across, positive [pixels].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. OpenCV counts from the centre of the
            first pixel: its cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        coefficients: (4,), (5,), (8,), (12,) or (14,), or with a leading (world,), in OpenCV's order: k1, k2, p1, p2,
            k3, k4, k5, k6, s1, s2, s3, s4, and the tilt of the sensor around its axes x and y [rad].
    """

    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None
    coefficients: Any = (0.0, 0.0, 0.0, 0.0)

    @property
    def differs(self) -> bool:
        return any_differs((self.fx, self.fy, self.cx, self.cy), (self.coefficients,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        given = coefficients_by_world(self.coefficients, f"{where}: coefficients", worlds, (4, 5, 8, 12, 14), 14)
        k1, k2, p1, p2, k3, k4, k5, k6, *prism = given[:, :12].T
        distortion = distortion_numbers(worlds, (k1, k2, k3), (k4, k5, k6), (p1, p2), prism)
        matrix = focal_matrix(self, width, height, where, worlds)
        return LensNumbers(matrix @ _tilted(*given[:, 12:].T), _formula(matrix, distortion))

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        ahead = nan_unless(z > 0.0, z)
        return distorted_once(x / ahead, y / ahead, formula["distortion"], formula["focal"])

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Tensors3:
        u, v = straightened(u, v, formula["distortion"], formula["focal"])
        length = root(u * u + v * v + 1.0)
        return u / length, v / length, 1.0 / length


@dataclass(frozen=True, eq=False)
class ThinPrismFisheye(FormulaTableLens):
    """A fisheye with tangential and thin-prism distortion: COLMAP's and ETH3D's THIN_PRISM_FISHEYE.

    A ray at the angle a from the axis has the place (u, v) at the distance a from the middle of a plane, which is then
    distorted, with r = a^2: u (1 + k1 r + k2 r^2 + k3 r^3 + k4 r^4) + 2 p1 u v + p2 (r + 2 u^2) + sx1 r to the right,
    v (1 + ...) + 2 p2 u v + p1 (r + 2 v^2) + sy1 r down. Pixels that no ray comes to, and those beyond 180 degrees, see
    nothing. Every value may be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        fx: Focal length across, positive [pixels for a radian].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. COLMAP's is the same number.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        coefficients: (8,), or (world, 8), in COLMAP's order: k1, k2, p1, p2, k3, k4, sx1, sy1.
        max_fov: Beyond half this angle from the axis nothing is seen, in (0, 360] [degrees].
    """

    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None
    coefficients: Any = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    max_fov: Any = 360.0

    @property
    def differs(self) -> bool:
        return any_differs((self.fx, self.fy, self.cx, self.cy, self.max_fov), (self.coefficients,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        given = coefficients_by_world(self.coefficients, f"{where}: coefficients", worlds, (8,), 8)
        k1, k2, p1, p2, k3, k4, sx1, sy1 = given.T
        none = np.zeros(worlds)
        distortion = distortion_numbers(worlds, (k1, k2, k3, k4), (), (p1, p2), (sx1, none, sy1, none))
        matrix = focal_matrix(self, width, height, where, worlds)
        return LensNumbers(matrix, _formula(matrix, distortion) | {"last": half_angles(self.max_fov, worlds, where)})

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        u, v = _equidistant_place(x, y, z, formula["last"])
        return distorted_once(u, v, formula["distortion"], formula["focal"])

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Tensors3:
        u, v = straightened(u, v, formula["distortion"], formula["focal"])
        return _equidistant_direction(u, v, formula["last"])


@dataclass(frozen=True, eq=False)
class RadTanThinPrismFisheye(FormulaTableLens):
    """A fisheye with six radial, two tangential and four thin-prism coefficients.

    COLMAP calls it RAD_TAN_THIN_PRISM_FISHEYE, Project Aria Fisheye624. Unlike in ``ThinPrismFisheye``, tangential and
    thin-prism terms are of the place (u, v) that has its radial distortion already, with r = u^2 + v^2:
    u + 2 p1 u v + p0 (r + 2 u^2) + s0 r + s1 r^2 to the right, v + 2 p0 u v + p1 (r + 2 v^2) + s2 r + s3 r^2 down.
    Pixels that no ray comes to, and those beyond 180 degrees, see nothing. Every value may be one number or one for
    each world, (world,): numpy, torch or Warp.

    Attributes:
        fx: Focal length across, positive [pixels for a radian].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. COLMAP's is the same number; Aria's
            counts from the centre of the first pixel and is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        coefficients: (12,), or (world, 12), in COLMAP's and Aria's order: k0 to k5, p0, p1, s0 to s3.
        max_fov: Beyond half this angle from the axis nothing is seen, in (0, 360] [degrees].
    """

    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None
    coefficients: Any = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    max_fov: Any = 360.0

    @property
    def differs(self) -> bool:
        return any_differs((self.fx, self.fy, self.cx, self.cy, self.max_fov), (self.coefficients,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        given = coefficients_by_world(self.coefficients, f"{where}: coefficients", worlds, (12,), 12)
        k0, k1, k2, k3, k4, k5, p0, p1, *prism = given.T
        distortion = distortion_numbers(worlds, (k0, k1, k2, k3, k4, k5), (), (p1, p0), prism)
        matrix = focal_matrix(self, width, height, where, worlds)
        return LensNumbers(matrix, _formula(matrix, distortion) | {"last": half_angles(self.max_fov, worlds, where)})

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        distortion, focal = formula["distortion"], formula["focal"]
        u, v = _equidistant_place(x, y, z, formula["last"])
        u, v = distorted_once(u, v, radial_numbers(distortion), focal)
        return distorted_once(u, v, lateral_numbers(distortion), focal)

    def from_plane(self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]) -> Tensors3:
        distortion, focal = formula["distortion"], formula["focal"]
        u, v = straightened(u, v, lateral_numbers(distortion), focal)
        u, v = straightened(u, v, radial_numbers(distortion), focal)
        return _equidistant_direction(u, v, formula["last"])


def _equidistant_place(
    x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, last: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """The place at the distance of a direction's angle from the axis [rad]; NaN beyond the last."""
    angle = axis_angle(x, y, z)
    return place_at(nan_unless(angle <= last, angle), x, y, z)


def _equidistant_direction(u: torch.Tensor, v: torch.Tensor, last: torch.Tensor) -> Tensors3:
    """The direction whose angle from the axis [rad] is the distance of a place; NaN beyond the last."""
    angle = plane_distance(u, v)
    return direction_at(nan_unless(angle <= last, angle), u, v)


def _formula(matrix: np.ndarray, distortion: np.ndarray) -> dict[str, np.ndarray]:
    return {"distortion": distortion, "focal": np.maximum(matrix[:, 0, 0], matrix[:, 1, 1])}


def _tilted(around_x: np.ndarray, around_y: np.ndarray) -> np.ndarray:
    """Homographies of OpenCV's tilted sensor, (world, 3, 3), of angles (world,) [rad].

    The turned plane is seen from the lens's centre, and brought back to where its axis meets it.
    """
    count = len(around_x)
    turn_x, turn_y, back = (np.tile(np.eye(3), (count, 1, 1)) for _ in range(3))
    turn_x[:, 1, 1] = turn_x[:, 2, 2] = np.cos(around_x)
    turn_x[:, 1, 2], turn_x[:, 2, 1] = np.sin(around_x), -np.sin(around_x)
    turn_y[:, 0, 0] = turn_y[:, 2, 2] = np.cos(around_y)
    turn_y[:, 0, 2], turn_y[:, 2, 0] = -np.sin(around_y), np.sin(around_y)
    turn = turn_y @ turn_x
    back[:, 0, 0] = back[:, 1, 1] = turn[:, 2, 2]
    back[:, 0, 2], back[:, 1, 2] = -turn[:, 0, 2], -turn[:, 1, 2]
    return back @ turn
