"""Bounds that the trace has of a height field's cells and blocks."""

import numpy as np
import pytest
import warp as wp

from warpcam.accel.heightfields import HeightField, build_cells, build_peaks, count_levels, pack_height_fields

SHAPES = pytest.mark.parametrize("shape", [(2, 2), (2, 5), (7, 3), (17, 16), (3, 34)])


def heights_of(shape: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(0).normal(size=shape).astype(np.float32)


@SHAPES
def test_peaks_of_every_block(shape: tuple[int, int]) -> None:
    heights, levels = heights_of(shape), count_levels(shape)
    assert 2**levels >= max(shape) - 1 and (levels == 0 or 2 ** (levels - 1) < max(shape) - 1)
    peaks = build_peaks(heights)
    assert peaks.shape == (2**levels, (shape[1] - 1 + 1) // 2)
    for level in range(1, levels + 1):
        span = 2**level
        for row, column in np.ndindex(-(-(shape[0] - 1) // span), -(-(shape[1] - 1) // span)):
            seen = heights[row * span : (row + 1) * span + 1, column * span : (column + 1) * span + 1]
            assert peaks[2 ** (levels - level) + row, column] == seen.max()


@SHAPES
def test_cells_are_two_triangles(shape: tuple[int, int]) -> None:
    heights = heights_of(shape)
    rows, columns = shape[0] - 1, shape[1] - 1
    cells = build_cells(heights).reshape(rows, columns, 4).astype(np.float64)
    for u, v in ((0, 0), (1, 0), (0, 1), (1, 1)):
        expected = heights[v : v + rows, u : u + columns]
        height = cells @ (1.0, u, v, max(u - v, 0.0))
        np.testing.assert_allclose(height, expected, atol=1e-6)


def test_fields_lie_one_after_another() -> None:
    first = HeightField("first", heights_of((4, 7)), (2.0, 3.0), 1.0, 0.1)
    second = HeightField("second", heights_of((9, 3)), (0.5, 4.0), 1.0, 0.2)
    packed = pack_height_fields([first, second], wp.get_device("cpu"))
    grids, counts = packed.grids.numpy(), packed.grids.numpy().view(np.int32)
    for index, field in enumerate((first, second)):
        row, columns = 2 * index, field.heights.shape[1] - 1
        np.testing.assert_allclose(grids[row, 0] * 2 * field.half_size[0], columns)
        np.testing.assert_allclose(grids[row, 1] * 2 * field.half_size[1], len(field.heights) - 1)
        assert grids[row, 2] == field.heights.max()
        assert counts[row, 3] == count_levels(field.heights.shape) == 3
        assert counts[row + 1, :2].tolist() == [columns, len(field.heights) - 1]
        peaks, cells = build_peaks(field.heights).reshape(-1), build_cells(field.heights)
        np.testing.assert_array_equal(packed.peaks.numpy()[counts[row + 1, 2] :][: len(peaks)], peaks)
        np.testing.assert_array_equal(packed.cells.numpy()[counts[row + 1, 3] :][: len(cells)], cells)
