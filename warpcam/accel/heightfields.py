"""Height fields: checked, scaled to metres, and given what the trace walks them by."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import HeightFields

MAX_SAMPLES = 2**12 + 1  # along one side
MAX_HEIGHT = 1e30  # or depth [m]; rounding must not make infinities of them


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


def num_faces(field: HeightField) -> int:
    """Two of each cell."""
    rows, columns = np.shape(field.heights)
    return 2 * (rows - 1) * (columns - 1)


def pack_height_fields(fields: Sequence[HeightField], device: wp.Device) -> HeightFields:
    """Put all height fields on ``device``.

    Raises:
        WarpcamError: A field cannot be used; the message names it.
    """
    heights = [_checked(field) for field in fields]
    cells = [build_cells(samples) for samples in heights]
    peaks = [build_peaks(samples) for samples in heights]
    packed = HeightFields()
    sizes = [(*field.half_size, field.top, field.base) for field in fields]
    packed.size = wp.array(np.asarray(sizes, np.float32).reshape(-1, 4), dtype=wp.vec4, device=device)
    packed.rows = _integers([samples.shape[0] for samples in heights], device)
    packed.columns = _integers([samples.shape[1] for samples in heights], device)
    packed.height_start = _integers(_starts([samples.size for samples in heights]), device)
    peak_starts, cell_starts = _starts([entry.size for entry in peaks]), _starts([len(entry) for entry in cells])
    grids = np.zeros((len(fields), 2, 4), np.float32)
    counts = grids.view(np.int32)
    for index, (field, samples) in enumerate(zip(fields, heights, strict=True)):
        rows, columns = samples.shape[0] - 1, samples.shape[1] - 1
        half_x, half_y = field.half_size
        grids[index, 0, :3] = 0.5 * columns / half_x, 0.5 * rows / half_y, samples.max()
        counts[index, 0, 3] = count_levels(samples.shape)
        counts[index, 1] = columns, rows, peak_starts[index], cell_starts[index]
    packed.grids = wp.array(grids.reshape(-1, 4), dtype=wp.vec4, device=device)
    packed.heights = wp.array(_joined(heights), dtype=wp.float32, device=device)
    packed.cells = wp.array(_joined(cells).reshape(-1, 4), dtype=wp.vec4, device=device)
    packed.peaks = wp.array(_joined(peaks), dtype=wp.float32, device=device)
    return packed


def count_levels(shape: tuple[int, ...]) -> int:
    """The least n of which 2^n cells are as long as the longer side of a grid of (rows, columns) samples."""
    return (max(shape) - 2).bit_length()


def build_cells(heights: np.ndarray) -> np.ndarray:
    """Compute the bounds of each cell for the trace, (cell, 4) float32: see ``HeightFields.cells``."""
    corner, along_x = heights[:-1, :-1], heights[:-1, 1:]
    along_y, opposite = heights[1:, :-1], heights[1:, 1:]
    rise_x, rise_y = opposite - along_y, along_y - corner
    return np.stack((corner, rise_x, rise_y, along_x - corner - rise_x), axis=-1).reshape(-1, 4)


def build_peaks(heights: np.ndarray) -> np.ndarray:
    """Greatest heights of blocks of cells, 2-D float32: see ``HeightFields.peaks``. A block owns its border."""
    levels = count_levels(heights.shape)
    peaks = np.full((2**levels, heights.shape[1] // 2), -np.inf, np.float32)
    blocks = np.maximum.reduce((heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]))
    for level in range(1, levels + 1):
        blocks = np.maximum.reduceat(blocks, range(0, len(blocks), 2), axis=0)
        blocks = np.maximum.reduceat(blocks, range(0, blocks.shape[1], 2), axis=1)
        first = 2 ** (levels - level)
        peaks[first : first + blocks.shape[0], : blocks.shape[1]] = blocks
    return peaks


def _checked(field: HeightField) -> np.ndarray:
    heights = np.ascontiguousarray(field.heights, np.float32)
    where = f"height field '{field.name}'"
    if heights.ndim != 2 or min(heights.shape) < 2 or max(heights.shape) > MAX_SAMPLES:
        raise WarpcamError(f"{where}: heights must be 2 to {MAX_SAMPLES} rows and columns, got shape {heights.shape}")
    usable = np.abs(heights) < MAX_HEIGHT
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
        raise WarpcamError(f"height fields: all of them have {starts[-1]} entries of one kind; fewer than 2^31 fit")
    return [int(start) for start in starts[:-1]]


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.float32), *(part.reshape(-1) for part in parts)])


def _integers(values: Sequence[int], device: wp.Device) -> wp.array:
    return wp.array(np.asarray(values, np.int32), dtype=wp.int32, device=device)
