"""Lenses that no formula of the trace has: fisheyes, distorted ones, any. Each is a table of one ray for each pixel.

A table is made once, when the renderer is. Rays run from the camera's position, but where ``Rays`` is given other
places; ``near`` and ``far`` count along them.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.accel.offset_ray_tables import offset_table_floats
from warpcam.accel.ray_tables import MOST_PIXELS, table_floats
from warpcam.camera.lens import Lens, Projection
from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError

ROUNDS = 50  # of the search for a distorted ray
NEAR_ENOUGH = 1e-3  # pixels that it may lie aside


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
    def rays(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        """(1 or world, height, width, 3) in the camera's frame, of any length; 0 sees nothing."""

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
            directions are allowed, straight back, too.
        origins: Of the same shapes: where each pixel's ray begins, in the camera's frame [m]. None: all at the camera's
            position. A table with them is four times as large, and takes longer to trace.
    """

    directions: Any
    origins: Any = None

    @property
    def differs(self) -> bool:
        return 4 in (len(_shape(self.directions)), 0 if self.origins is None else len(_shape(self.origins)))

    @property
    def has_origins(self) -> bool:
        return self.origins is not None

    def starts(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        if self.origins is None:
            return super().starts(width, height, num_worlds, where)
        return self._table(self.origins, width, height, num_worlds, f"{where}: lens Rays: origins")

    def rays(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        where = f"{where}: lens Rays: directions"
        given = self._table(self.directions, width, height, num_worlds, where)
        if not given.any():
            raise WarpcamError(f"{where} are all 0: no pixel sees anything")
        return given

    @staticmethod
    def _table(value: Any, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        given = _numbers(value, where)
        if given.shape not in ((height, width, 3), (num_worlds, height, width, 3)):
            raise WarpcamError(
                f"{where} must have shape ({height}, {width}, 3) or ({num_worlds}, {height}, {width}, 3), for images "
                f"of {width} x {height} pixels, got {given.shape}"
            )
        return given.reshape(-1, height, width, 3)


@dataclass(frozen=True, eq=False)
class Fisheye(RayTableLens):
    """An equidistant fisheye: the angle from the axis grows as the distance from the principal point.

    With ``k`` it is OpenCV's fisheye model (Kannala and Brandt): a ray at the angle a from the axis comes at
    f * (a + k1 a^3 + k2 a^5 + k3 a^7 + k4 a^9) from the principal point. Pixels beyond the greatest angle for which
    that grows, and those beyond 180 degrees, see nothing.

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
        _check_choice("Fisheye", self.fovy, self.fx, [self.fy, self.cx, self.cy])

    @property
    def differs(self) -> bool:
        numbers = (self.fovy, self.fx, self.fy, self.cx, self.cy, self.max_fov)
        return any(len(_shape(value)) > 0 for value in numbers) or len(_shape(self.k)) > 1

    def rays(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        where, worlds = f"{where}: lens Fisheye", num_worlds if self.differs else 1
        k = _values(self.k, f"{where}: k", worlds, (4,))
        limit = _values(self.max_fov, f"{where}: max_fov", worlds)
        _require((limit > 0.0) & (limit <= 360.0), limit, f"{where}: max_fov must be in (0, 360] degrees")
        if self.fovy is not None:
            fovy = _values(self.fovy, f"{where}: fovy", worlds)
            _require((fovy > 0.0) & (fovy <= 360.0), fovy, f"{where}: fovy must be in (0, 360] degrees")
            edge = _bent(np.radians(0.5 * fovy), k)
            last = np.array([_last_growing(one) for one in k])
            _require(
                np.radians(0.5 * fovy) <= last * (1.0 + 1e-9),
                fovy,
                f"{where}: fovy must be one that the lens reaches with its k",
            )
            fx = fy = 0.5 * height / edge
            cx, cy = np.full(worlds, 0.5 * width), np.full(worlds, 0.5 * height)
        else:
            fx, fy, cx, cy = _pixels(self, width, height, where, worlds)
        x, y = _places(width, height, fx, fy, cx, cy)
        radius = np.hypot(x, y)
        angle = np.stack([_angle_at(radius[world], k[world]) for world in range(worlds)])
        half = np.radians(0.5 * limit).reshape(-1, 1, 1)
        seen = angle <= half * (1.0 + 1e-6)
        angle = np.where(seen, angle, 0.0)
        across = np.divide(np.sin(angle), radius, out=np.ones_like(radius), where=radius > 0.0)
        return np.where(seen[..., None], np.stack([across * x, across * y, -np.cos(angle)], axis=-1), 0.0)


@dataclass(frozen=True, eq=False)
class Distorted(RayTableLens):
    """A pinhole with the distortion of OpenCV's ``calibrateCamera`` (Brown and Conrady).

    Every value may be one number or one for each world, (world,): numpy, torch or Warp. Pixels that no ray comes to,
    beyond the model's reach, see nothing.

    Attributes:
        fx: Focal length across, positive [pixels].
        fy: Focal length down; ``fx`` unless given.
        cx: Principal point from the left edge [pixels]; width / 2 unless given. OpenCV counts from the centre of the
            first pixel: its cx is less by 0.5.
        cy: Principal point from the top edge [pixels]; height / 2 unless given.
        coefficients: (4,), (5,), (8,) or (12,), or with a leading (world,), in OpenCV's order: k1, k2, p1, p2, k3,
            k4, k5, k6, s1, s2, s3, s4.
    """

    fx: Any
    fy: Any = None
    cx: Any = None
    cy: Any = None
    coefficients: Any = (0.0, 0.0, 0.0, 0.0)

    @property
    def differs(self) -> bool:
        return any(len(_shape(value)) > 0 for value in (self.fx, self.fy, self.cx, self.cy)) or (
            len(_shape(self.coefficients)) > 1
        )

    def rays(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        where, worlds = f"{where}: lens Distorted", num_worlds if self.differs else 1
        given = _numbers(self.coefficients, f"{where}: coefficients")
        lengths = (4, 5, 8, 12)
        if given.shape[-1:] not in {(length,) for length in lengths} or given.shape[:-1] not in ((), (worlds,)):
            allowed = ", ".join(f"({length},)" for length in lengths)
            raise WarpcamError(f"{where}: coefficients must have shape {allowed} or (world, ...), got {given.shape}")
        numbers = np.zeros((worlds, 12))
        numbers[:, : given.shape[-1]] = given
        fx, fy, cx, cy = _pixels(self, width, height, where, worlds)
        x, y = _places(width, height, fx, fy, cx, cy)
        rays = [_straightened(x[i], y[i], numbers[i], max(fx[i], fy[i])) for i in range(worlds)]
        return np.stack(rays)


def _straightened(x: np.ndarray, y: np.ndarray, numbers: np.ndarray, focal: float) -> np.ndarray:
    """The rays that the distortion brings to (x, y), up: by Newton's method, from the middle outwards."""
    down = -y
    u, v = np.zeros_like(x), np.zeros_like(x)
    known = np.zeros(x.shape, bool)
    for share in (0.25, 0.5, 0.75, 1.0):
        to_x, to_y = share * x, share * down
        for _ in range(ROUNDS):
            (at_x, at_y), slopes = _distorted(u, v, numbers)
            off_x, off_y = at_x - to_x, at_y - to_y
            known = np.hypot(off_x, off_y) * focal <= 0.01 * NEAR_ENOUGH
            if known.all():
                break
            (xx, xy), (yx, yy) = slopes
            area = xx * yy - xy * yx
            area = np.where(np.abs(area) < 1e-9, 1e-9, area)
            step_u, step_v = (yy * off_x - xy * off_y) / area, (xx * off_y - yx * off_x) / area
            length = np.hypot(step_u, step_v)
            rate = np.minimum(1.0, 0.5 / np.maximum(length, 1e-12))
            u, v = u - rate * step_u, v - rate * step_v
    (at_x, at_y), ((xx, xy), (yx, yy)) = _distorted(u, v, numbers)
    # where the area is turned over, or all of it mirrored, the model has folded back: the camera has no such ray
    known = (np.hypot(at_x - x, at_y - down) * focal <= NEAR_ENOUGH) & (xx * yy - xy * yx > 0.0)
    known &= u * x + v * down >= 0.0
    return np.where(known[..., None], np.stack([u, -v, np.full_like(u, -1.0)], axis=-1), 0.0)


def _distorted(u: np.ndarray, v: np.ndarray, numbers: np.ndarray) -> tuple[Any, Any]:
    """Distort the ray (u, v, 1), v down; return the result and its derivatives by u and v."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = numbers
    r = u * u + v * v
    top, bottom = 1.0 + r * (k1 + r * (k2 + r * k3)), 1.0 + r * (k4 + r * (k5 + r * k6))
    bottom = np.where(np.abs(bottom) < 1e-9, 1e-9, bottom)
    radial = top / bottom
    # the radial factor's rate over r
    rate = (k1 + r * (2.0 * k2 + 3.0 * r * k3) - radial * (k4 + r * (2.0 * k5 + 3.0 * r * k6))) / bottom
    x = u * radial + 2.0 * p1 * u * v + p2 * (r + 2.0 * u * u) + s1 * r + s2 * r * r
    y = v * radial + p1 * (r + 2.0 * v * v) + 2.0 * p2 * u * v + s3 * r + s4 * r * r
    thin_x, thin_y = s1 + 2.0 * s2 * r, s3 + 2.0 * s4 * r
    xx = radial + 2.0 * u * u * rate + 2.0 * p1 * v + 6.0 * p2 * u + 2.0 * u * thin_x
    xy = 2.0 * u * v * rate + 2.0 * p1 * u + 2.0 * p2 * v + 2.0 * v * thin_x
    yx = 2.0 * u * v * rate + 2.0 * p1 * u + 2.0 * p2 * v + 2.0 * u * thin_y
    yy = radial + 2.0 * v * v * rate + 6.0 * p1 * v + 2.0 * p2 * u + 2.0 * v * thin_y
    return (x, y), ((xx, xy), (yx, yy))


def _bent(angle: np.ndarray, k: np.ndarray) -> np.ndarray:
    """The fisheye's distance from the principal point, in focal lengths, at an angle from the axis."""
    a = angle * angle
    return angle * (1.0 + a * (k[..., 0] + a * (k[..., 1] + a * (k[..., 2] + a * k[..., 3]))))


def _angle_at(radius: np.ndarray, k: np.ndarray) -> np.ndarray:
    """The angle from the axis at a distance from the principal point, in focal lengths; inf where there is none."""
    if not k.any():
        return np.where(radius <= math.pi * (1.0 + 1e-9), radius, np.inf)
    low, high = np.zeros_like(radius), np.full_like(radius, _last_growing(k))
    reached = radius <= _bent(high, k)
    for _ in range(60):  # halves of an angle until no float64 lies between
        middle = 0.5 * (low + high)
        below = _bent(middle, k) < radius
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(reached, 0.5 * (low + high), np.inf)


def _last_growing(k: np.ndarray) -> float:
    """The angle up to which the distance from the principal point grows, at most 180 degrees."""
    roots = np.roots([9.0 * k[3], 7.0 * k[2], 5.0 * k[1], 3.0 * k[0], 1.0])  # of its rate over the squared angle
    turns = [float(root.real) for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0]
    return min([math.sqrt(turn) for turn in turns] + [math.pi])


def _places(
    width: int, height: int, fx: np.ndarray, fy: np.ndarray, cx: np.ndarray, cy: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels' centres from the principal point, in focal lengths, to the right and up: (n, height, width)."""
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    fx, fy, cx, cy = (value.reshape(-1, 1, 1) for value in (fx, fy, cx, cy))
    return (column - cx) / fx, (cy - row) / fy


def _pixels(lens: Any, width: int, height: int, where: str, worlds: int) -> list[np.ndarray]:
    """Focal lengths and principal point, each (world,)."""
    fx = _values(lens.fx, f"{where}: fx", worlds)
    fy = fx if lens.fy is None else _values(lens.fy, f"{where}: fy", worlds)
    cx = _values(0.5 * width if lens.cx is None else lens.cx, f"{where}: cx", worlds)
    cy = _values(0.5 * height if lens.cy is None else lens.cy, f"{where}: cy", worlds)
    for name, value in (("fx", fx), ("fy", fy)):
        _require(value > 0.0, value, f"{where}: {name} must be positive")
    return [fx, fy, cx, cy]


def _check_choice(lens: str, fovy: Any, fx: Any, others: Sequence[Any]) -> None:
    pixels = [name for name, value in zip(("fx", "fy", "cx", "cy"), [fx, *others], strict=True) if value is not None]
    if fovy is None and fx is None:
        raise WarpcamError(
            f"{lens}: {', '.join(pixels) or 'nothing'} came; either fovy [degrees] or fx [pixels for a radian] "
            "is needed"
        )
    if fovy is not None and pixels:
        raise WarpcamError(
            f"{lens}: fovy came together with {', '.join(pixels)}; give either fovy [degrees], or fx, fy, cx, cy "
            "[pixels]"
        )


def _require(good: np.ndarray, values: np.ndarray, what: str) -> None:
    if not good.all():
        raise WarpcamError(f"{what}, got {float(values[~good].flat[0])}")


def _shape(value: Any) -> tuple[int, ...]:
    if isinstance(value, wp.array):  # whose vectors are no dimension
        return tuple(value.shape) + tuple(getattr(value.dtype, "_shape_", ()))
    return tuple(value.shape) if hasattr(value, "shape") else np.shape(value)


def _numbers(value: Any, where: str) -> np.ndarray:
    numbers = as_numbers(value, where).astype(np.float64)
    if not np.isfinite(numbers).all():
        raise WarpcamError(f"{where} must be finite, got {numbers[~np.isfinite(numbers)].flat[0]}")
    return numbers


def _values(value: Any, where: str, worlds: int, width: tuple[int, ...] = ()) -> np.ndarray:
    """(world, *width), of what was given for all or for each."""
    numbers = _numbers(value, where)
    if numbers.shape not in (width, (worlds, *width)):
        raise WarpcamError(f"{where} must have shape {width or 'a number'} or {(worlds, *width)}, got {numbers.shape}")
    return np.broadcast_to(numbers, (worlds, *width))
