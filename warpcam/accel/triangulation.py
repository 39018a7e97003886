"""Cutting polygons into triangles."""

import numpy as np

FLAT = 1e-9  # of a polygon's longest edge squared: turns smaller than this are no turns


def triangulate(counts: np.ndarray, indices: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut faces into triangles that keep the faces' winding; also faces that are not convex.

    Args:
        counts: (face,) corners of each face; faces of less than 3 make no triangles.
        indices: (corner,) vertices of the faces' corners, face after face.
        points: (vertex, 3).

    Returns:
        corners: (triangle, 3) int64, places in ``indices``.
        faces: (triangle,) int64, which face each was cut from, ascending.
    """
    counts = np.asarray(counts, np.int64)
    starts = np.concatenate(([0], np.cumsum(counts)))[:-1]
    corners, faces = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for count in np.unique(counts[counts >= 3]):
        which = np.flatnonzero(counts == count)
        places = starts[which, None] + np.arange(count)
        cut = np.arange(3)[None] if count == 3 else _fan(int(count))
        order = np.broadcast_to(cut, (len(which), *cut.shape))
        if count > 3:
            flat = _flattened(np.asarray(points, np.float64)[indices[places]])
            reflex = _turns(flat) < -FLAT * _longest(flat)[:, None]
            odd = np.flatnonzero(reflex.any(axis=1))
            if len(odd):
                order = order.copy()
                for row in odd:
                    if count == 4:  # a fan from the one corner that points inwards
                        order[row] = (cut + np.argmax(reflex[row])) % 4
                    else:
                        order[row] = _clip_ears(flat[row])
        triangles = np.take_along_axis(places[:, None, :], order.reshape(len(which), 1, -1), axis=2)
        corners.append(triangles.reshape(-1, 3))
        faces.append(np.repeat(which, count - 2))
    of_face = np.concatenate(faces)
    sort = np.argsort(of_face, kind="stable")
    return np.concatenate(corners)[sort], of_face[sort]


def _fan(count: int) -> np.ndarray:
    second = np.arange(1, count - 1)
    return np.stack((np.zeros_like(second), second, second + 1), axis=1)


def _flattened(points: np.ndarray) -> np.ndarray:
    """Polygons (n, corner, 3) in the planes they span, (n, corner, 2), counterclockwise."""
    normal = np.cross(points - points[:, :1], np.roll(points, -1, axis=1) - points[:, :1]).sum(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0.0, normal / np.where(length > 0.0, length, 1.0), (0.0, 0.0, 1.0))
    away = np.eye(3)[np.abs(normal).argmin(axis=1)]
    across = np.cross(away, normal)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(normal, across)
    local = points - points[:, :1]
    return np.stack((np.einsum("nci,ni->nc", local, across), np.einsum("nci,ni->nc", local, up)), axis=-1)


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _turns(flat: np.ndarray) -> np.ndarray:
    """Positive where a corner turns left."""
    return _cross(flat - np.roll(flat, 1, axis=-2), np.roll(flat, -1, axis=-2) - flat)


def _longest(flat: np.ndarray) -> np.ndarray:
    return ((np.roll(flat, -1, axis=-2) - flat) ** 2).sum(axis=-1).max(axis=-1)


def _clip_ears(flat: np.ndarray) -> np.ndarray:
    """Triangles of one polygon (corner, 2), counterclockwise: corners, (corner - 2, 3)."""
    left = list(range(len(flat)))
    eps = FLAT * float(_longest(flat))
    triangles: list[tuple[int, ...]] = []
    start = 0
    while len(left) > 3:
        turns = _turns(flat[left])
        hollow = np.array(left)[turns < eps]
        best = -1
        for step in range(len(left)):
            place = (start + step) % len(left)
            if turns[place] > eps and _is_ear(flat, left, place, hollow):
                best = place
                break
        if best < 0:  # it crosses itself, or has no area: anything will do
            best = int(np.argmax(turns))
        triangles.append((left[best - 1], left[best], left[(best + 1) % len(left)]))
        del left[best]
        start = best + 1  # not the neighbour at once: slivers
    triangles.append(tuple(left))
    return np.array(triangles)


def _is_ear(flat: np.ndarray, left: list[int], place: int, hollow: np.ndarray) -> bool:
    corners = (left[place - 1], left[place], left[(place + 1) % len(left)])
    a, b, c = flat[list(corners)]
    others = flat[hollow[~np.isin(hollow, corners)]]
    same = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    others = others[~same]  # bridges to holes pass a point twice
    inside = (
        (_cross(b - a, others - a) >= 0.0) & (_cross(c - b, others - b) >= 0.0) & (_cross(a - c, others - c) >= 0.0)
    )
    return not inside.any()
