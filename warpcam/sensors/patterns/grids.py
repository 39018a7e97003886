"""Grids of parallel rays, as height scans of legged robots have them."""

import math
from typing import Any

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.sensors.patterns.pattern import Pattern, columns_of, positive


def grid(
    size: Any,
    resolution: float,
    *,
    direction: Any = (0.0, 0.0, -1.0),
    ordering: str = "xy",
    max_range: float = math.inf,
) -> Pattern:
    """Return the pattern of a height scan: parallel rays from a grid in the sensor's xy plane, about its origin.

    ``Lidar(alignment="yaw")`` keeps the grid level on a body that tilts. Names and order of rays are those of Isaac
    Lab's ``GridPatternCfg``.

    Args:
        size: Extent along x and along y [m]; places lie at both ends.
        resolution: From place to place [m].
        direction: Of all rays, in the sensor's frame; down unless given.
        ordering: "xy": a row runs along x, and rows follow each other along y; "yx" the other way round.
        max_range: Nothing farther gives a return [m].
    """
    extent = as_numbers(size, "grid: size")
    if extent.shape != (2,) or not np.isfinite(extent).all() or (extent < 0.0).any():
        raise WarpcamError(f"grid: size must be two lengths along x and y [m], got {size!r}")
    step = positive(resolution, "grid: resolution")
    along = as_numbers(direction, "grid: direction")
    if along.shape != (3,) or not np.isfinite(along).all() or not along.any():
        raise WarpcamError(f"grid: direction must be (3,) and not of length 0, got {direction!r}")
    if not isinstance(ordering, str) or ordering not in ("xy", "yx"):
        raise WarpcamError(f'grid: ordering must be "xy" or "yx", got {ordering!r}')
    counts = [columns_of(math.floor(length / step + 1e-6) + 1, "grid: places along an axis") for length in extent]
    x, y = (-0.5 * length + step * np.arange(count) for length, count in zip(extent, counts, strict=True))
    places = np.stack((*np.meshgrid(x, y), np.zeros((len(y), len(x)))), axis=-1)
    origins = places if ordering == "xy" else places.transpose(1, 0, 2)
    return Pattern(np.broadcast_to(along, origins.shape), origins=origins, max_range=max_range)
