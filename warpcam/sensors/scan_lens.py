"""Rays of a lidar as the lens of a camera, and of beams that widen."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.camera.lens import Orthographic
from warpcam.camera.lens_tables import Rays
from warpcam.sensors.kernels.scan_echoes import SPREAD
from warpcam.sensors.patterns.pattern import Pattern

# How far from a beam's axis the rays around it are, as part of its half angle: the root mean square of a ring that has
# SPREAD - 1 of SPREAD equal parts of the disc.
RING = float(np.sqrt(0.5 + 0.5 / SPREAD))


@dataclass(frozen=True, eq=False)
class ScanLens(Rays):
    """A table of rays, (rows, columns, 3), of all worlds or for each of its own to be written.

    Attributes:
        per_world: Each world has a table; all begin as one.
    """

    per_world: bool = False

    @property
    def differs(self) -> bool:
        return self.per_world

    def starts(self, width: int, height: int, num_worlds: int, where: str) -> np.ndarray:
        return super().starts(width, height, num_worlds, where) if self.origins is None else self.origins[None]

    def rays(self, width: int, height: int, num_worlds: int, where: str, parts: tuple[int, int] = (1, 1)) -> np.ndarray:
        return self.directions[None]


def parallel_lens(pattern: Pattern) -> tuple[Orthographic, bool] | None:
    """The lens of a pattern whose rays run straight down from a square grid about the sensor's position, else None.

    It takes a fraction of the time of a table. With it comes whether rows of its images run the other way.
    """
    if pattern.table is not None or pattern.origins is None or (pattern.directions != (0.0, 0.0, -1.0)).any():
        return None
    origins = pattern.origins.astype(np.float64)
    across, down = origins[0, :, 0], origins[:, 0, 1]
    steps = [np.diff(along).mean() if len(along) > 1 else None for along in (across, down)]
    step = next((abs(each) for each in steps if each), 1.0)
    x = step * (np.arange(pattern.columns) - 0.5 * (pattern.columns - 1))
    y = step * (np.arange(pattern.rows) - 0.5 * (pattern.rows - 1))
    flipped = len(down) > 1 and down[-1] > down[0]
    grid = np.stack((*np.meshgrid(x, y if flipped else y[::-1]), np.zeros(origins.shape[:2])), axis=-1)
    if not np.allclose(origins, grid, rtol=0.0, atol=1e-5 * step):
        return None
    return Orthographic(height=step * pattern.rows), flipped


def spread_rays(pattern: Pattern, divergence: float) -> Pattern:
    """The pattern with ``SPREAD`` rays for each, one below the other: that along the beam, and a ring around it.

    Args:
        pattern: One ray a beam.
        divergence: Full angle of beams [degrees].
    """
    directions = _spread(pattern.directions, divergence).transpose(0, 2, 1, 3)  # (row, ray of the beam, column, 3)
    repeated: dict[str, Any] = {
        name: None if value is None else np.repeat(value, SPREAD, axis=0)
        for name, value in (("origins", pattern.origins), ("times", pattern.times), ("rings", pattern.rings))
    }
    return Pattern(
        directions.reshape(-1, pattern.columns, 3),
        table=None if pattern.table is None else _spread(pattern.table, divergence).reshape(-1, 3),
        rate=pattern.rate,
        min_range=pattern.min_range,
        max_range=pattern.max_range,
        **repeated,
    )


def _spread(directions: np.ndarray, divergence: float) -> np.ndarray:
    """Directions (..., 3) with those of their beams, (..., SPREAD, 3)."""
    axis = directions.astype(np.float64)
    aside = np.where(np.abs(axis[..., 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    right = np.cross(axis, aside)
    right /= np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-12)
    up = np.cross(right, axis)
    angle = np.radians(0.5 * divergence) * RING
    around = 2.0 * np.pi * np.arange(SPREAD - 1)[:, None] / (SPREAD - 1)
    ring = np.cos(angle) * axis[..., None, :] + np.sin(angle) * (
        np.cos(around) * right[..., None, :] + np.sin(around) * up[..., None, :]
    )
    seeing = np.any(axis != 0.0, axis=-1, keepdims=True)[..., None]
    return np.where(seeing, np.concatenate((axis[..., None, :], ring), axis=-2), 0.0)
