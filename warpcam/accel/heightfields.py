"""Height fields: checked, scaled to metres, and given the pyramid of bounds they are walked by."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warpcam.errors import WarpcamError
from warpcam.kernels.types import HeightFields

MAX_LEVELS = 13  # of the pyramid: the trace's stack holds no more
MAX_SAMPLES = 2 ** (MAX_LEVELS - 1) + 1  # along one side
NOTHING = 1e30  # an empty block spans from here down to minus this


@dataclass(frozen=True, eq=False)
class HeightField:
    """One height field as a source gives it.

    Attributes:
        name: For error messages.
        heights: (row, column) float32, rows along y, columns along x, from the lowest of both [m].
        half_size: Half widths in x and y, positive [m].
        top: Height that the source calls 1.0 [m].
        base: How far the base lies below height 0 [m].
    """

    name: str
    heights: np.ndarray
    half_size: tuple[float, float]
    top: float
    base: float


def pack_height_fields(fields: Sequence[HeightField], device: wp.Device) -> HeightFields:
    """Put all height fields on ``device`` with their pyramids.

    Raises:
        WarpcamError: A field cannot be used; the message names it.
    """
    heights = [_checked(field) for field in fields]
    pyramids = [build_pyramid(samples) for samples in heights]
    packed = HeightFields()
    sizes = [(*field.half_size, field.top, field.base) for field in fields]
    packed.size = wp.array(np.asarray(sizes, np.float32).reshape(-1, 4), dtype=wp.vec4, device=device)
    packed.rows = _integers([samples.shape[0] for samples in heights], device)
    packed.columns = _integers([samples.shape[1] for samples in heights], device)
    packed.height_start = _integers(_starts([samples.size for samples in heights]), device)
    packed.bound_start = _integers(_starts([len(bounds) for bounds in pyramids]), device)
    packed.levels = _integers([count_levels(samples.shape) for samples in heights], device)
    flat = [np.zeros(0, np.float32), *(samples.reshape(-1) for samples in heights)]
    packed.heights = wp.array(np.concatenate(flat), dtype=wp.float32, device=device)
    bounds = np.concatenate([np.zeros((0, 2), np.float32), *pyramids])
    packed.bounds = wp.array(bounds, dtype=wp.vec2, device=device)
    return packed


def count_levels(shape: tuple[int, ...]) -> int:
    """Levels of the pyramid over a grid of (rows, columns) samples: the last has a block for every cell."""
    return max(max(shape) - 2, 0).bit_length() + 1


def build_pyramid(heights: np.ndarray) -> np.ndarray:
    """Lowest and highest height of every block of cells, (entry, 2) float32.

    Level after level from the single root, each square and row-major. A block's bounds are those of all samples that
    its cells touch; blocks that lie outside the grid are empty: lowest is above highest.
    """
    side = 2 ** (count_levels(heights.shape) - 1)
    rows, columns = heights.shape[0] - 1, heights.shape[1] - 1
    corners = (heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:])
    lowest = np.full((side, side), NOTHING, np.float32)
    highest = np.full((side, side), -NOTHING, np.float32)
    lowest[:rows, :columns] = np.minimum.reduce(corners)
    highest[:rows, :columns] = np.maximum.reduce(corners)
    levels = [np.stack((lowest, highest), axis=-1).reshape(-1, 2)]
    while side > 1:
        side //= 2
        lowest = lowest.reshape(side, 2, side, 2).min(axis=(1, 3))
        highest = highest.reshape(side, 2, side, 2).max(axis=(1, 3))
        levels.append(np.stack((lowest, highest), axis=-1).reshape(-1, 2))
    return np.concatenate(levels[::-1])


def _checked(field: HeightField) -> np.ndarray:
    heights = np.ascontiguousarray(field.heights, np.float32)
    where = f"height field '{field.name}'"
    if heights.ndim != 2 or min(heights.shape) < 2 or max(heights.shape) > MAX_SAMPLES:
        raise WarpcamError(f"{where}: heights must be 2 to {MAX_SAMPLES} rows and columns, got shape {heights.shape}")
    usable = np.abs(heights) < NOTHING
    if not usable.all():
        row, column = np.argwhere(~usable)[0].tolist()
        raise WarpcamError(f"{where}: heights must be finite, got {heights[row, column]} at row {row}, column {column}")
    if not all(np.isfinite(size) and size > 0.0 for size in field.half_size):
        raise WarpcamError(f"{where}: half_size must be positive and finite, got {field.half_size}")
    if not np.isfinite(field.base):
        raise WarpcamError(f"{where}: base must be finite, got {field.base}")
    return heights


def _starts(counts: Sequence[int]) -> list[int]:
    starts = np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
    if starts[-1] >= 2**31:
        raise WarpcamError(f"height fields: all of them have {starts[-1]} samples and bounds; fewer than 2^31 fit")
    return [int(start) for start in starts[:-1]]


def _integers(values: Sequence[int], device: wp.Device) -> wp.array:
    return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=device)
