"""How clouds are made of points that count: checked when it is said."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError

Method = Literal["farthest", "uniform", "first"]
Padding = Literal["repeat", "zeros"]
Corners = tuple[Sequence[float], Sequence[float]]
MOST_VOXELS = 2**30  # from the origin, as in native/sensors/voxel_points.h
MAX_ID = 2**24  # that may be excluded: a byte for each lower one is kept
SMALLEST, LARGEST = (float(bound) for bound in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))
RESERVED = ("points", "count", "pixels")  # names that clouds have in any case


@dataclass(frozen=True)
class CloudOptions:
    """Arguments of ``PointClouds`` that do not say what clouds are made of."""

    num_points: int
    method: Method
    voxel_size: float | None
    bounds: Corners | None
    padding: Padding
    seed: int

    def __post_init__(self) -> None:
        _check_whole("num_points", self.num_points, 1)
        _check_whole("seed", self.seed, 0)
        for name, value, kind in (("method", self.method, Method), ("padding", self.padding, Padding)):
            allowed = get_args(kind)
            if not isinstance(value, str) or value not in allowed:
                raise WarpcamError(f"PointClouds: {name} must be one of {', '.join(allowed)}, got {value!r}")
        size = self.voxel_size
        is_number = isinstance(size, int | float | np.number) and not isinstance(size, bool)
        if size is not None and not (is_number and SMALLEST <= size <= LARGEST):
            raise WarpcamError(f"PointClouds: voxel_size must be above 0 and finite [m], or None, got {size!r}")
        corners = np.abs(self.corners())
        reach = float(corners[np.isfinite(corners)].max(initial=0.0))
        if size is not None and reach > MOST_VOXELS * size:
            raise WarpcamError(
                f"PointClouds: voxel_size must be at least {reach / MOST_VOXELS:.3g} m for bounds within 2^30 voxels "
                f"of the origin, got {size!r}; bounds may be infinite where there is none"
            )

    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the box, (3,) float32 [m]; infinite without one."""
        if self.bounds is None:
            return np.full(3, -np.inf, np.float32), np.full(3, np.inf, np.float32)
        allowed = "the lowest and the highest corner of a box, ((x, y, z), (x, y, z)) [m]"
        with np.errstate(over="ignore"):  # what float32 cannot hold is infinite: no bound
            corners = as_numbers(self.bounds, "PointClouds: bounds", allowed).astype(np.float32)
        if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
            raise WarpcamError(f"PointClouds: bounds must be {allowed}, got {self.bounds!r}")
        return corners[0], corners[1]


def check_names(names: Any) -> tuple[str, ...]:
    """Names of attributes."""
    if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise WarpcamError(f"PointClouds: attributes must be names of outputs, got {names!r}")
    for name in names:
        if name in RESERVED or names.count(name) > 1:
            raise WarpcamError(f"PointClouds: attributes has {name!r}, which clouds have already")
    return tuple(names)


def check_excluded(exclude: Any) -> dict[str, np.ndarray]:
    """Ids that are left out, by attribute."""
    if exclude is None:
        return {}
    if not isinstance(exclude, Mapping):
        raise WarpcamError(f"PointClouds: exclude must be a dictionary of ids by output, got {exclude!r}")
    found = {}
    for name, ids in exclude.items():
        numbers = np.atleast_1d(as_numbers(ids, f"PointClouds: exclude: {name!r}", "ids"))
        whole = numbers.dtype.kind in "iu" or not numbers.size
        if numbers.ndim != 1 or not whole or ((numbers < 0) | (numbers >= MAX_ID)).any():
            raise WarpcamError(
                f"PointClouds: exclude: {name!r} must be ids, whole numbers of at least 0 and below {MAX_ID}, "
                f"got {ids!r}"
            )
        found[name] = numbers.astype(np.int64)
    return found


def _check_whole(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value < 2**31:
        raise WarpcamError(
            f"PointClouds: {name} must be a whole number, at least {least} and below 2^31, got {value!r}"
        )
