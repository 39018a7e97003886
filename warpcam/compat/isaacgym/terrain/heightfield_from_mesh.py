"""Triangles as heights, exactly where their vertices stand on a grid: programs make their terrains so, of samples."""

import numpy as np

NEAR = 1e-2  # of a step: as near as that a vertex is on the grid
CLOSE = 1e-9  # of a step: places as far outside of a triangle are covered, too
SMALL = 0.02  # the share of edges that are shorter than a step from place to place
MOST = 1 << 22  # places
AT_ONCE = 1 << 20
THIN = 1e-9  # of its extent's square: a triangle of less area is upright, and rounding alone says where it is


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
        # Those of a single step cover none but their corners.
        wide = np.maximum(*(np.ptp(cells[:, axis][faces], axis=1) for axis in range(2))) > 1
        _cover(heights, cells.astype(np.float64), points[:, 2].astype(np.float64), faces[wide])
        _fill_rim(heights)
    return (heights, first, steps) if np.isfinite(heights).all() else None


def seen_from_above(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface of any triangles, at places about as far apart as corners of small triangles are.

    Args:
        points: (vertex, 3) [m], not all of one x or y.
        faces: (face, 3).

    Returns:
        Heights by x and y [m], that of the lowest vertex where there is no triangle, the first place (2,) and the steps
        (2,) [m].
    """
    flat = points[:, :2].astype(np.float64)
    first, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    edges = np.linalg.norm(flat[faces] - flat[np.roll(faces, 1, axis=1)], axis=-1)
    edges = edges[edges > 1e-6 * extent.max()]  # not the upright ones
    short = float(np.quantile(edges, SMALL)) if len(edges) else 0.0
    step = max(short, float(np.sqrt(extent.prod() / MOST)))
    counts = np.maximum(np.rint(extent / step).astype(np.int64) + 1, 2)
    steps = extent / (counts - 1)
    heights = np.full(counts, -np.inf)
    _cover(heights, (flat - first) / steps, points[:, 2].astype(np.float64), faces)
    heights[~np.isfinite(heights)] = points[:, 2].min()
    return heights, first, steps


def is_convex(points: np.ndarray, faces: np.ndarray) -> bool:
    """Return whether a small mesh is a convex closed body: no face has vertices on both of its sides."""
    if len(points) * len(faces) > MOST:
        return False
    _, same = np.unique(points, axis=0, return_inverse=True)
    corners = same.reshape(-1)[faces]
    edges = np.sort(np.stack((corners, np.roll(corners, -1, axis=1)), axis=-1).reshape(-1, 2), axis=1)
    if (np.unique(edges, axis=0, return_counts=True)[1] != 2).any():
        return False  # as valleys and open boxes, which their hulls would fill
    a, b, c = (points[faces[:, corner]].astype(np.float64) for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    away = normals @ points.T.astype(np.float64) - (normals * a).sum(axis=1, keepdims=True)
    near = 1e-5 * np.ptp(points, axis=0).max()
    above, below = (away > near).any(axis=1), (away < -near).any(axis=1)
    return bool((above | below).any() and not (above & below).any())


def _cover(heights: np.ndarray, places: np.ndarray, z: np.ndarray, faces: np.ndarray) -> None:
    """Raise the places of a grid to the triangles that cover them.

    Args:
        heights: By x and y; to be changed.
        places: (vertex, 2) by the grid's steps.
        z: (vertex,) heights.
        faces: (face, 3).
    """
    corners = places[faces]
    a, b, c = (corners[:, i] for i in range(3))
    area, z = _cross(b - a, c - a), z[faces]
    low = np.maximum(np.ceil(corners.min(axis=1) - CLOSE), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) + CLOSE), np.array(heights.shape) - 1).astype(np.int64)
    spans = high - low + 1
    usable = (np.abs(area) > THIN * np.ptp(corners, axis=1).max(axis=1) ** 2) & (spans > 0).all(axis=1)
    # Triangles of about one size together: places in as many steps as the largest of them has, of a few at a time.
    sizes = np.ceil(np.log2(np.maximum(spans, 1))).astype(np.int64)
    for size in np.unique(sizes[usable], axis=0):
        alike = np.flatnonzero(usable & (sizes == size).all(axis=1))
        offsets = np.stack(np.meshgrid(*(np.arange(2**n) for n in size), indexing="ij"), axis=-1).reshape(-1, 2)
        many = max(AT_ONCE // len(offsets), 1)
        for begin in range(0, len(alike), many):
            rows = alike[begin : begin + many]
            place = low[rows, None] + offsets
            shares = (
                np.stack(
                    [
                        _cross(end[rows, None] - start[rows, None], place - start[rows, None])
                        for start, end in ((b, c), (c, a), (a, b))
                    ],
                    axis=-1,
                )
                / area[rows, None, None]
            )
            inside = (shares >= -CLOSE).all(axis=-1) & (place <= high[rows, None]).all(axis=-1)
            over = (shares * z[rows, None]).sum(axis=-1)
            np.maximum.at(heights, tuple(place[inside].T), over[inside])


def _fill_rim(heights: np.ndarray) -> None:
    """Give places at the rim that no triangle covers the lowest height beside them: the lower vertices move."""
    end = np.array(heights.shape) - 1
    for place in np.argwhere(~np.isfinite(heights)):
        if (place == 0).any() or (place == end).any():
            low = np.maximum(place - 1, 0)
            beside = heights[low[0] : place[0] + 2, low[1] : place[1] + 2]
            heights[tuple(place)] = beside.min(initial=np.inf, where=np.isfinite(beside))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
