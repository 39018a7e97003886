"""Fisheyes: lenses whose distance from the principal point depends on the angle from the axis alone."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from warpcam.camera.lens_numbers import (
    any_differs,
    by_world,
    camera_matrix,
    centre_of,
    check_focal_choice,
    coefficients_by_world,
    finite_numbers,
    focal_matrix,
    require,
    shape_of,
    size_of,
)
from warpcam.camera.lens_tables import FormulaTableLens
from warpcam.camera.lens_tensors import Columns, LensNumbers, nan_unless, sine_and_cosine, with_gradient
from warpcam.core.errors import WarpcamError
from warpcam.core.torch_interop import torch

QUICK_ROUNDS = 6  # of Newton's method, which are enough for most lenses
ROUNDS = 60  # of the search for a polynomial's value: halvings alone leave no float64 between an interval's ends
ASIDE = 1e-9  # of a place's distance ahead, or of a plane's unit: from there derivatives on the axis are taken
NEAR_ENOUGH = 1e-12  # of the whole range, between two rounds; the next would square it


class RadialLens(FormulaTableLens):
    """A lens that is symmetric around its axis.

    The formula has ``polynomial``, (n, m) from the constant upwards, and ``last``, (n,): up to there it grows.
    """

    @abstractmethod
    def distance_at(self, angle: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        """Return the distance from the principal point on the plane at an angle from the axis [rad]; NaN if unseen."""

    @abstractmethod
    def angle_at(self, distance: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        """Return the angle from the axis [rad] at a distance from the principal point; NaN where nothing is seen."""

    def onto_plane(
        self, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        return place_at(self.distance_at(axis_angle(x, y, z), formula), x, y, z)

    def from_plane(
        self, u: torch.Tensor, v: torch.Tensor, formula: Mapping[str, Any]
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        return direction_at(self.angle_at(plane_distance(u, v), formula), u, v)


class GrowingDistance(RadialLens):
    """A lens whose polynomial gives the distance of an angle."""

    def distance_at(self, angle: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        return value_within(angle, formula)

    def angle_at(self, distance: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        return place_of(distance, formula)


@dataclass(frozen=True, eq=False)
class Fisheye(GrowingDistance):
    """An equidistant fisheye: the angle from the axis grows as the distance from the principal point.

    With ``k`` it is OpenCV's fisheye model, which Kalibr and ROS call equidistant: a ray at the angle a from the axis
    comes at f * (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9) from the principal point. ``KannalaBrandt`` has a coefficient
    of a itself in place of f. Pixels beyond the greatest angle for which the distance grows, and those beyond 180
    degrees, see nothing.

    Give either ``fovy``, or ``fx`` and, where they differ from the usual, ``fy``, ``cx`` and ``cy``. Every value may be
    one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        fovy: Vertical field of view, in (0, 360] [degrees].
        fx: Focal length across, positive [pixels for a radian].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. OpenCV counts from the centre of the
            first pixel: its cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        k: (4,) k1 to k4, or (world, 4).
        max_fov: Beyond half this angle from the axis nothing is seen, in (0, 360] [degrees].
    """

    fovy: Any = None
    fx: Any = None
    fy: Any = None
    cx: Any = None
    cy: Any = None
    k: Any = (0.0, 0.0, 0.0, 0.0)
    max_fov: Any = 360.0

    def __post_init__(self) -> None:
        check_focal_choice("Fisheye", self.fovy, self.fx, [self.fy, self.cx, self.cy], "pixels for a radian")

    @property
    def differs(self) -> bool:
        return any_differs((self.fovy, self.fx, self.fy, self.cx, self.cy, self.max_fov), (self.k,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        odd = np.concatenate([np.ones((worlds, 1)), by_world(self.k, f"{where}: k", worlds, (4,))], axis=1)
        formula = _of_angle(_odd(odd), self.max_fov, where)
        if self.fovy is None:
            return LensNumbers(focal_matrix(self, width, height, where, worlds), formula)
        fovy = by_world(self.fovy, f"{where}: fovy", worlds)
        require((fovy > 0.0) & (fovy <= 360.0), fovy, f"{where}: fovy must be in (0, 360] degrees")
        half, turn = np.radians(0.5 * fovy), np.array([min(_turn(one), math.pi) for one in formula["polynomial"]])
        reached = half <= turn * (1.0 + 1e-9)
        require(reached, fovy, f"{where}: fovy must be one that the lens reaches with its k")
        across = size_of(width, f"{where}: width", "with fovy")
        down = size_of(height, f"{where}: height", "with fovy")
        edge = np.array([polyval(one, p) for one, p in zip(half, formula["polynomial"], strict=True)])
        centre = np.full(worlds, 0.5 * across), np.full(worlds, 0.5 * down)
        return LensNumbers(camera_matrix(0.5 * down / edge, 0.5 * down / edge, *centre), formula)


@dataclass(frozen=True, eq=False)
class KannalaBrandt(GrowingDistance):
    """The fisheye of Kannala and Brandt (2006, equations 6 and 7), whose polynomial has a linear coefficient.

    A ray at the angle a from the axis comes at k1 a + k2 a^3 + k3 a^5 + k4 a^7 + k5 a^9 from the principal point, times
    ``mu`` across and ``mv`` down. NVIDIA's kannalaBrandtK3 has the first four as k0 to k3, in pixels. OpenCV's k1 to k4
    are others, relative to the focal length: those belong to ``Fisheye``. Pixels beyond the greatest angle for which
    the distance grows, and those beyond 180 degrees, see nothing.

    Every value may be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        coefficients: (n,) k1 to kn with n from 1 to 5, or (world, n) [pixels with ``mu`` 1, or length on the sensor].
            The first that is not 0 is positive.
        mu: Pixels for one unit of the coefficients across, positive.
        mv: Likewise down; ``mu`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        max_fov: Beyond half this angle from the axis nothing is seen, in (0, 360] [degrees].
    """

    coefficients: Any
    mu: Any = 1.0
    mv: Any = None
    cx: Any = None
    cy: Any = None
    max_fov: Any = 360.0

    @property
    def differs(self) -> bool:
        return any_differs((self.mu, self.mv, self.cx, self.cy, self.max_fov), (self.coefficients,))

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        odd = coefficients_by_world(self.coefficients, f"{where}: coefficients", worlds, range(1, 6), 5)
        _require_growth(odd, f"{where}: coefficients")
        mu = by_world(self.mu, f"{where}: mu", worlds)
        mv = mu if self.mv is None else by_world(self.mv, f"{where}: mv", worlds)
        for name, value in (("mu", mu), ("mv", mv)):
            require(value > 0.0, value, f"{where}: {name} must be positive")
        matrix = camera_matrix(mu, mv, *centre_of(self.cx, self.cy, width, height, where, worlds))
        return LensNumbers(matrix, _of_angle(_odd(odd), self.max_fov, where))


@dataclass(frozen=True, eq=False)
class FTheta(RadialLens):
    """NVIDIA's f-theta lens: one polynomial between the distance from the principal point and the angle from the axis.

    Give one of the two polynomials; the other direction follows from it. DriveWorks, NCore and gsplat have either, and
    name the one that counts; USD's ``omni:lensdistortion:ftheta`` of Isaac Sim and Isaac Lab's ``fisheye_polynomial``
    have the backward one. Pixels beyond the range in which the polynomial grows, and those beyond 180 degrees, see
    nothing.

    Every value may be one number or one for each world, (world,): numpy, torch or Warp.

    Attributes:
        backward: (n,) with n at least 2, or (world, n): the angle [rad] as a polynomial of the distance [pixels], from
            the constant upwards ("pixel distance to angle"). It grows from a distance of 0 on.
        forward: Of the same shapes: the distance [pixels] as a polynomial of the angle [rad] ("angle to pixel
            distance").
        cx: Principal point from the left edge [pixels]; width / 2 unless given. DriveWorks and NCore count from the
            centre of the first pixel: their number is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        linear: (3,) c, d and e, or (world, 3): an offset (x, y) at the polynomial's distance comes to the column
            c x + d y and the row e x + y from the principal point.
        max_fov: Beyond half this angle from the axis nothing is seen, in (0, 360] [degrees].
    """

    backward: Any = None
    forward: Any = None
    cx: Any = None
    cy: Any = None
    linear: Any = (1.0, 0.0, 0.0)
    max_fov: Any = 360.0

    def __post_init__(self) -> None:
        if (self.backward is None) == (self.forward is None):
            came = "neither came" if self.backward is None else "both came"
            raise WarpcamError(f"FTheta: one of the polynomials backward and forward is needed, {came}")

    @property
    def differs(self) -> bool:
        vectors = (self.forward if self.backward is None else self.backward, self.linear)
        return any_differs((self.cx, self.cy, self.max_fov), vectors)

    def numbers(self, width: int | None, height: int | None, worlds: int, where: str) -> LensNumbers:
        name, given = ("backward", self.backward) if self.forward is None else ("forward", self.forward)
        shape = shape_of(given)
        if len(shape) not in (1, 2) or shape[-1] < 2 or shape[:-1] not in ((), (worlds,)):
            raise WarpcamError(f"{where}: {name} must have shape (n,) or ({worlds}, n) with n at least 2, got {shape}")
        polynomial = np.broadcast_to(finite_numbers(given, f"{where}: {name}"), (worlds, shape[-1]))
        _require_growth(polynomial[:, 1:], f"{where}: {name}: coefficients after the constant")
        if self.forward is None:
            half = half_angles(self.max_fov, worlds, where)
            constant = polynomial[:, 0]
            require(constant < half, constant, f"{where}: backward's constant must be below half of max_fov [rad]")
            last = np.array([min(_turn(one), _reach(one, to)) for one, to in zip(polynomial, half, strict=True)])
            formula: Mapping[str, np.ndarray] = {"polynomial": polynomial, "last": last}
        else:
            formula = _of_angle(polynomial, self.max_fov, where)
        c, d, e = by_world(self.linear, f"{where}: linear", worlds, (3,)).T
        require(c - d * e > 0.0, c - d * e, f"{where}: linear must have a positive determinant c - d e")
        matrix = camera_matrix(c, np.ones(worlds), *centre_of(self.cx, self.cy, width, height, where, worlds))
        matrix[:, 0, 1], matrix[:, 1, 0] = d, e
        return LensNumbers(matrix, formula)

    def distance_at(self, angle: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        return place_of(angle, formula) if self.forward is None else value_within(angle, formula)

    def angle_at(self, distance: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
        return value_within(distance, formula) if self.forward is None else place_of(distance, formula)


def polynomial_at(place: torch.Tensor, coefficients: Columns) -> torch.Tensor:
    """Return the value of a polynomial whose coefficients run from the constant upwards."""
    value = torch.zeros_like(place) + coefficients[-1]
    for each in reversed(coefficients[:-1]):
        value = value * place + each if isinstance(each, torch.Tensor) else value * place
    return value


def value_within(place: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
    """Return the value of the formula's polynomial; NaN beyond its range and where it is negative."""
    value = polynomial_at(place, formula["polynomial"])
    return nan_unless((place <= formula["last"]) & (value >= 0.0), value)


def place_of(value: torch.Tensor, formula: Mapping[str, Any]) -> torch.Tensor:
    """Return where the formula's polynomial has a value; NaN where it has none in its range.

    Newton's method; where that does not end soon, within an interval, which is halved where it would be left.
    """
    coefficients, last, given = formula["polynomial"], formula["last"], value
    value = value.detach()
    rates = [power * each for power, each in enumerate(coefficients)][1:]
    low, high = torch.zeros_like(value), last.expand_as(value)
    within = (value >= coefficients[0]) & (value <= polynomial_at(high, coefficients))
    place = before = 0.5 * high
    for _ in range(QUICK_ROUNDS):
        before = place
        step = place - (polynomial_at(place, coefficients) - value) / polynomial_at(place, rates)
        place = torch.minimum(torch.maximum(step, low), high)
    moving = within & ~((place - before).abs() <= NEAR_ENOUGH * last)
    place = torch.where(moving, 0.5 * high, place)
    for _ in range(ROUNDS):
        if not moving.any():
            break
        off = polynomial_at(place, coefficients) - value
        low, high = torch.where(off < 0.0, place, low), torch.where(off < 0.0, high, place)
        step = place - off / polynomial_at(place, rates)
        after = torch.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        place, before = torch.where(moving, after, place), place
        moving = moving & ((place - before).abs() > NEAR_ENOUGH * last)
    return nan_unless(within, with_gradient(place, given / polynomial_at(place, rates)))


def half_angles(max_fov: Any, worlds: int, where: str) -> np.ndarray:
    """Return half of ``max_fov`` [rad], (world,), with room for the rounding of a pixel at the edge."""
    limit = by_world(max_fov, f"{where}: max_fov", worlds)
    require((limit > 0.0) & (limit <= 360.0), limit, f"{where}: max_fov must be in (0, 360] degrees")
    return np.minimum(np.radians(0.5 * limit) * (1.0 + 1e-6), math.pi * (1.0 + 1e-9))


def axis_angle(x: torch.Tensor, y: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
    """Return the angle of directions from the axis [rad]."""
    return torch.atan2(torch.hypot(_off_axis(x, y, ASIDE * z.abs()), y), z)


def plane_distance(u: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """Return the distance of places from the middle of their plane."""
    return torch.hypot(_off_axis(u, v, ASIDE), v)


def _off_axis(x: torch.Tensor, y: torch.Tensor, aside: torch.Tensor | float) -> torch.Tensor:
    """Return x, but a little aside of the axis where (x, y) is on it, for lengths have no derivative at 0."""
    return torch.where((x == 0.0) & (y == 0.0), aside, x)


def place_at(
    distance: torch.Tensor, x: torch.Tensor, y: torch.Tensor, z: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the place of a plane at a distance from its middle, on the side of a direction.

    NaN straight behind, which is a circle and no place.
    """
    across = torch.hypot(_off_axis(x, y, ASIDE * z.abs()), y)
    scale = nan_unless((x != 0.0) | (y != 0.0) | (z > 0.0), distance) / torch.where(across > 0.0, across, 1.0)
    return scale * x, scale * y


def direction_at(
    angle: torch.Tensor, u: torch.Tensor, v: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the direction at an angle from the axis [rad], on the side of a place."""
    sine, cosine = sine_and_cosine(angle)
    scale = sine / plane_distance(u, v)
    return scale * u, scale * v, cosine


def _odd(coefficients: np.ndarray) -> np.ndarray:
    """A polynomial of odd powers, from those of the first, the third and so on."""
    polynomial = np.zeros((len(coefficients), 2 * coefficients.shape[1]))
    polynomial[:, 1::2] = coefficients
    return polynomial


def _of_angle(polynomial: np.ndarray, max_fov: Any, where: str) -> dict[str, np.ndarray]:
    """Numbers of a formula whose polynomial takes an angle."""
    half = half_angles(max_fov, len(polynomial), where)
    return {"polynomial": polynomial, "last": np.minimum(half, [_turn(one) for one in polynomial])}


def _require_growth(coefficients: np.ndarray, where: str) -> None:
    """Raise unless the lowest power that is there has a positive coefficient."""
    for one in coefficients:
        lowest = one[np.flatnonzero(one)[:1]]
        if not (lowest > 0.0).all() or not len(lowest):
            raise WarpcamError(f"{where}: the first that is not 0 must be positive, got {one.tolist()}")


def _turn(polynomial: np.ndarray) -> float:
    """The place up to which a polynomial grows, from 0 on."""
    return _first_root(polyder(polynomial))


def _reach(polynomial: np.ndarray, value: float) -> float:
    """The first place at which a polynomial has a value."""
    return _first_root(polynomial - np.eye(1, len(polynomial))[0] * value)


def _first_root(polynomial: np.ndarray) -> float:
    """The first positive root of a polynomial, or infinity.

    Raises:
        WarpcamError: The coefficients overflow.
    """
    try:
        roots = np.roots(polynomial[::-1])
    except np.linalg.LinAlgError:
        raise WarpcamError(f"the coefficients of a lens are too large or too small: {polynomial.tolist()}") from None
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min()) if len(real) else math.inf
