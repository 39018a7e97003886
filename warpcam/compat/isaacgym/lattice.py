"""Triangles whose vertices stand on a grid, as heights: programs make their terrains so, of samples."""

import numpy as np

NEAR = 1e-2  # of a step: as near as that a vertex is on the grid
WIDEST = 64  # steps that a triangle may span


def heights_of(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The surface as it is seen from above, or None if the vertices are no grid of as many.

    Vertices may have been moved to others' places along the grid, as steep slopes are made upright; the places that
    they left are inside of triangles, or notches of the rim.

    Args:
        points: (vertex, 3) [m].
        faces: (face, 3).

    Returns:
        Heights by x and y [m], the first place (2,) and the steps (2,) [m].
    """
    flat = points[:, :2].astype(np.float64)
    first, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    steps = np.zeros(2)
    for axis in range(2):
        gaps = np.diff(np.unique(flat[:, axis]))
        gaps = gaps[gaps > 1e-5 * extent[axis]]
        if not len(gaps):
            return None
        steps[axis] = extent[axis] / np.rint(gaps / gaps.min()).sum()  # one by one: far off float32 is coarse
    counts = np.rint(extent / steps).astype(np.int64) + 1
    if counts.prod() != len(points):
        return None
    places = (flat - first) / steps
    cells = np.rint(places).astype(np.int32)
    if np.abs(places - cells).max() > NEAR:
        return None
    heights = np.full(counts, -np.inf)
    np.maximum.at(heights, tuple(cells.T), points[:, 2])
    if not np.isfinite(heights).all():
        _cover(heights, cells, points[:, 2].astype(np.float64), faces)
        _fill_rim(heights)
    return (heights, first, steps) if np.isfinite(heights).all() else None


def _cover(heights: np.ndarray, cells: np.ndarray, z: np.ndarray, faces: np.ndarray) -> None:
    """Raise places to the triangles that cover them; those of a single step cover none but their corners."""
    wide = np.zeros(len(faces), bool)
    for axis in range(2):
        first, second, third = (cells[corner, axis] for corner in faces.T)
        low, high = np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
        wide |= high - low > 1
    faces = faces[wide]
    corners = cells[faces]
    low = corners.min(axis=1)
    span = corners.max(axis=1) - low
    a, b, c = (corners[:, i].astype(np.float64) for i in range(3))
    area, z = _cross(b - a, c - a), z[faces]
    usable = (area != 0.0) & (span <= WIDEST).all(axis=1)
    a, b, c, area, low, span, z = (rows[usable] for rows in (a, b, c, area, low, span, z))
    for right, up in np.ndindex(*(span.max(axis=0, initial=0) + 1)):
        place = low + np.array((right, up))
        shares = np.stack([_cross(c - b, place - b), _cross(a - c, place - c), _cross(b - a, place - a)], axis=1)
        shares /= area[:, None]
        inside = (shares >= -1e-9).all(axis=1) & (place <= low + span).all(axis=1)
        np.maximum.at(heights, tuple(place[inside].T), (shares * z).sum(axis=1)[inside])


def _fill_rim(heights: np.ndarray) -> None:
    """Give places at the rim that no triangle covers the lowest height beside them: the lower vertices move."""
    end = np.array(heights.shape) - 1
    for place in np.argwhere(~np.isfinite(heights)):
        if (place == 0).any() or (place == end).any():
            low = np.maximum(place - 1, 0)
            beside = heights[low[0] : place[0] + 2, low[1] : place[1] + 2]
            heights[tuple(place)] = beside.min(initial=np.inf, where=np.isfinite(beside))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
