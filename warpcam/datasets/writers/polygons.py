"""Outlines of masks."""

import numpy as np

# Steps along edges of pixels, (column, row): right, down, left, up; and the pixels to the right and to the left ahead,
# from the corner where the step begins.
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
RIGHT_AHEAD = ((0, 0), (-1, 0), (-1, -1), (0, -1))
LEFT_AHEAD = ((0, -1), (0, 0), (-1, 0), (-1, -1))


def outline(mask: np.ndarray) -> np.ndarray:
    """The longest outer outline of a mask along the edges of its pixels.

    Args:
        mask: (height, width) bool, with at least one pixel.

    Returns:
        (corner, 2): columns and rows of corners, clockwise, without those on straight edges. Parts that touch at a
        corner count as apart; holes are filled.
    """
    padded = np.pad(mask, 1)
    longest, steps = np.zeros((0, 2)), -1
    # An outline has a pixel whose upper neighbour is free, and begins there.
    open_tops = padded & ~np.roll(padded, 1, axis=0)
    while open_tops.any():
        row, column = np.unravel_index(int(open_tops.argmax()), open_tops.shape)
        corners, area, count = _follow(padded, open_tops, int(column), int(row))
        if area > 0 and count > steps:  # a hole is walked the other way round
            longest, steps = np.array(corners, np.float64) - 1.0, count
    return longest


def _follow(mask: np.ndarray, open_tops: np.ndarray, column: int, row: int) -> tuple[list[tuple[int, int]], int, int]:
    """Walk once around, with the mask on the right; returns corners, twice the signed area, and steps."""
    x, y, heading = column, row, 0
    corners, area, count = [(x, y)], 0, 0
    while True:
        if heading == 0:
            open_tops[y, x] = False
        dx, dy = STEPS[heading]
        area += x * (y + dy) - (x + dx) * y
        x, y, count = x + dx, y + dy, count + 1
        (rx, ry), (lx, ly) = RIGHT_AHEAD[heading], LEFT_AHEAD[heading]
        if not mask[y + ry, x + rx]:
            turn = 1
        else:
            turn = -1 if mask[y + ly, x + lx] else 0
        heading = (heading + turn) % 4
        if (x, y, heading) == (column, row, 0):
            return corners, area, count
        if turn:
            corners.append((x, y))
