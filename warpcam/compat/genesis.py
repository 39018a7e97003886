"""Genesis's ray casters, by its words, over any scene of warpcam: ``from warpcam.compat.genesis import Raycaster``.

Names, defaults, shapes and conventions are those of Genesis 1.4; Genesis itself is not needed. See
docs/compat/genesis.md.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

import warpcam as wc
from warpcam import sensors
from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.sensors.patterns.pattern import count_of, number_of, positive

__all__ = [
    "DepthCamera",
    "DepthCameraPattern",
    "GridPattern",
    "RaycastPattern",
    "Raycaster",
    "RaycasterData",
    "SphericalPattern",
]

Pair = tuple[Any, Any]
ROUND = 360.0  # a turn that returns to where it began [degrees]


class RaycasterData(NamedTuple):
    """What a ray caster reads; a batch dimension (world,) stands before the pattern's shape.

    Attributes:
        points: (..., 3) in the link's frame from where each ray begins, or in the world's; 0 where nothing is hit, None
            unless asked for [m].
        distances: ``no_hit_value`` where nothing is hit [m].
    """

    points: torch.Tensor | None
    distances: torch.Tensor


class RaycastPattern:
    """Rays in a sensor's frame: x ahead, y left, z up.

    Attributes:
        ray_dirs: (*shape, 3) unit.
        ray_starts: (*shape, 3) [m].
    """

    def __init__(self, ray_dirs: np.ndarray, ray_starts: np.ndarray | None = None):
        lengths = np.linalg.norm(ray_dirs, axis=-1, keepdims=True)
        self.ray_dirs = ray_dirs / lengths
        self.ray_starts = np.zeros_like(self.ray_dirs) if ray_starts is None else ray_starts

    @property
    def return_shape(self) -> tuple[int, ...]:
        return tuple(self.ray_dirs.shape[:-1])


class GridPattern(RaycastPattern):
    """Parallel rays from a grid, (along x, along y).

    Args:
        resolution: From place to place [m].
        size: Along x and y [m].
        direction: Of all rays.
    """

    def __init__(self, resolution: float = 0.1, size: Pair = (2.0, 2.0), direction: Sequence[float] = (0.0, 0.0, -1.0)):
        if not number_of(resolution, "GridPattern: resolution") >= 1e-3:
            raise WarpcamError(f"GridPattern: resolution must be at least 0.001 m, got {resolution!r}")
        along = as_numbers(direction, "GridPattern: direction")
        if along.shape != (3,) or not along.any():
            raise WarpcamError(f"GridPattern: direction must be (3,) and not of length 0, got {direction!r}")
        x, y = (np.arange(-each / 2, each / 2 + 1e-7, resolution) for each in size)
        starts = np.stack((*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))), -1)
        super().__init__(np.broadcast_to(along.astype(np.float64), starts.shape), starts)


class SphericalPattern(RaycastPattern):
    """Rays from one place, (azimuth, elevation).

    Args:
        fov: Horizontal and vertical extent [degrees]: a number about 0, or (lowest, highest).
        n_points: How many of both.
        angular_resolution: Steps of both [degrees], in place of ``n_points``; None: it counts.
        angles: Azimuths and elevations [degrees], in place of all else; None: the others count.
    """

    def __init__(
        self,
        fov: Pair = (360.0, 60.0),
        n_points: tuple[int, int] = (128, 64),
        angular_resolution: Pair = (None, None),
        angles: Pair = (None, None),
    ):
        each = [_angles(*given) for given in zip(fov, n_points, angular_resolution, angles, strict=True)]
        azimuth, elevation = np.meshgrid(*each, indexing="ij")
        flat = np.cos(elevation)
        super().__init__(np.stack((flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), -1))


class DepthCameraPattern(RaycastPattern):
    """Rays through the centres of a pinhole camera's pixels, (height, width); it looks along x.

    Args:
        res: Width and height [pixels].
        fx: Focal length along a row [pixels]; None, or of both: from the fields of view.
        fy: Likewise along a column.
        cx: Principal point [pixels]; None: the middle.
        cy: Likewise.
        fov_horizontal: [degrees]; None: from the other.
        fov_vertical: [degrees]; None: from the other.
    """

    def __init__(
        self,
        res: tuple[int, int] = (128, 96),
        fx: float | None = None,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        fov_horizontal: float | None = 90.0,
        fov_vertical: float | None = None,
    ):
        width, height = (count_of(side, "DepthCameraPattern: res") for side in res)
        if fx is None or fy is None:
            if fov_horizontal is None and fov_vertical is None:
                raise WarpcamError("DepthCameraPattern: fov_horizontal or fov_vertical must be given, or fx and fy")
            fx = None if fov_horizontal is None else _focal(width, fov_horizontal)
            fy = fx if fov_vertical is None else _focal(height, fov_vertical)
            fx = fy if fx is None else fx
        u = (np.arange(width) + 0.5 - (0.5 * width if cx is None else cx)) / positive(fx, "DepthCameraPattern: fx")
        v = (np.arange(height) + 0.5 - (0.5 * height if cy is None else cy)) / positive(fy, "DepthCameraPattern: fy")
        across, down = np.meshgrid(u, v)
        super().__init__(np.stack((np.ones_like(across), -across, -down), -1))


class Raycaster:
    """A ray caster in every world of a scene.

    Args:
        scene: What rays meet, all of it but ``exclude_bodies``.
        pattern: The rays.
        link: Name or index of the body that it is fixed to, in place of Genesis's ``entity_idx`` and
            ``link_idx_local``; None is the world.
        pos_offset: (3,) from the link [m].
        euler_offset: Roll, pitch and yaw from the link, about fixed axes in this order [degrees].
        min_range: Nothing nearer is hit [m].
        max_range: Nothing farther is hit [m].
        no_hit_value: Distance where nothing is hit; None: ``max_range``.
        return_world_frame: Points are in the world's frame.
        return_points: Points are read, too.
        exclude_bodies: Bodies that rays do not meet; names or indices.
        **others: Other options of Genesis's sensors are refused by name.
    """

    def __init__(
        self,
        scene: wc.Scene,
        *,
        pattern: RaycastPattern,
        link: str | int | None = None,
        pos_offset: Any = (0.0, 0.0, 0.0),
        euler_offset: Any = (0.0, 0.0, 0.0),
        min_range: float = 0.0,
        max_range: float = 20.0,
        no_hit_value: float | None = None,
        return_world_frame: bool = False,
        return_points: bool = True,
        exclude_bodies: Sequence[str | int] = (),
        **others: Any,
    ):
        if others:
            raise WarpcamError(f"Raycaster: {next(iter(others))} is not offered")
        if not isinstance(pattern, RaycastPattern):
            raise WarpcamError(f"Raycaster: pattern must be one of warpcam.compat.genesis, got {pattern!r}")
        angles = as_numbers(euler_offset, "Raycaster: euler_offset")
        if angles.shape != (3,) or not np.isfinite(angles).all():
            raise WarpcamError(f"Raycaster: euler_offset must be 3 angles [degrees], got {euler_offset!r}")
        rotation, matrix = _rotation(*np.radians(angles))
        origins = pattern.ray_starts if pattern.ray_starts.any() else None
        self._no_hit = float(max_range if no_hit_value is None else no_hit_value)
        self._lidar = sensors.Lidar(
            scene,
            sensors.patterns.rays(pattern.ray_dirs, origins, min_range=min_range, max_range=max_range),
            parent=link,
            position=pos_offset,
            rotation=rotation,
            outputs=("ranges", "ids", "points") if return_points and return_world_frame else ("ranges", "ids"),
            frame="world",
            miss=0.0,
            exclude_body=tuple(exclude_bodies),
        )
        scan = self._lidar.scan
        distances = torch.zeros_like(scan["ranges"])
        points = scan.get("points") if return_world_frame or not return_points else distances.new_zeros(
            (*distances.shape, 3)
        )  # fmt: skip
        self._misses = torch.zeros_like(distances, dtype=torch.bool)
        self._dirs = torch.tensor(pattern.ray_dirs @ matrix.T, dtype=torch.float32, device=distances.device)
        self._data = RaycasterData(points, distances)

    def read(self, envs_idx: Any = None) -> RaycasterData:
        """Cast the rays into the state as it is now.

        Returns:
            The same tensors at every read; of ``envs_idx``, as torch indexes, copies.
        """
        scan, data = self._lidar.read(), self._data
        data.distances.copy_(scan["ranges"])
        data.distances.masked_fill_(torch.lt(scan["ids"], 0, out=self._misses), self._no_hit)
        if data.points is not None and data.points is not scan.get("points"):
            torch.mul(scan["ranges"][..., None], self._dirs, out=data.points)
        if envs_idx is None:
            return data
        return RaycasterData(None if data.points is None else data.points[envs_idx], data.distances[envs_idx])


class DepthCamera(Raycaster):
    """A ray caster with a ``DepthCameraPattern``."""

    def read_image(self) -> torch.Tensor:
        """Distances along rays (world, height, width) [m]."""
        return self.read().distances


def _angles(fov: Any, count: Any, step: float | None, given: Any) -> np.ndarray:
    """Angles along one side of a spherical pattern [rad]."""
    if given is not None:
        return np.radians(as_numbers(given, "SphericalPattern: angles"))
    low, high = fov if isinstance(fov, Sequence) else (-0.5 * fov, 0.5 * fov)
    extent = high - low
    if not 0.0 <= extent <= ROUND + 1e-6:
        raise WarpcamError(f"SphericalPattern: fov must be from 0 to 360 degrees, got {fov!r}")
    closes = extent >= ROUND - 1e-6
    if step is not None:
        count = math.ceil(extent / positive(step, "SphericalPattern: angular_resolution")) + (not closes)
    points = count_of(count, "SphericalPattern: n_points")
    return np.radians(np.linspace(low, high - (extent / points if closes else 0.0), points))


def _focal(pixels: int, fov: float) -> float:
    return 0.5 * pixels / math.tan(math.radians(0.5 * fov))


def _rotation(roll: float, pitch: float, yaw: float) -> tuple[tuple[float, ...], np.ndarray]:
    """Quaternion w x y z and matrix."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw))
    about_x = np.array(((1, 0, 0), (0, cr, -sr), (0, sr, cr)))
    about_y = np.array(((cp, 0, sp), (0, 1, 0), (-sp, 0, cp)))
    about_z = np.array(((cy, -sy, 0), (sy, cy, 0), (0, 0, 1)))
    (a, b), (c, d), (e, f) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (roll, pitch, yaw))
    quaternion = (a * c * e + b * d * f, b * c * e - a * d * f, a * d * e + b * c * f, a * c * f - b * d * e)
    return quaternion, about_z @ about_y @ about_x
