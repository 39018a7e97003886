"""Rays that come as a list, in rows as images are traced."""

import numpy as np

from warpcam.accel.ray_tables import TILE_WIDTH


def columns_of(offsets: np.ndarray, directions: np.ndarray) -> int:
    """Length of the rows that rays make, as images are traced in tiles of rows.

    A row of a grid begins at one y, one of a camera has one slope y / z, one of a lidar that turns one z. Rays without
    such rows have rows of a tile's width, or one.
    """
    count, height = len(directions), directions[:, 2]
    slopes = directions[:, 1] / np.where(np.abs(height) > 1e-6, height, 1.0)
    lengths = [count]
    for values in (slopes, height):
        beside = (np.abs(offsets[:, 1] - offsets[0, 1]) > 1e-6) | (np.abs(values - values[0]) > 1e-6)
        first = int(np.argmax(beside)) if beside.any() else count
        lengths += [first] * (first >= TILE_WIDTH and count % first == 0)
    found = min(lengths)
    return TILE_WIDTH if found == count and count % TILE_WIDTH == 0 else found
