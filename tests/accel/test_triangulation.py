"""Cutting polygons: areas, windings, and what a polygon that is not convex covers."""

import numpy as np
import pytest

from warpcam.accel.triangulation import triangulate

L_SHAPE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
ARROW = [(0, 0), (1, 0.4), (2, 0), (1, 2)]
COMB = [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
# A square with a square hole, joined by a bridge that is passed twice.
FRAME = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
SPIRAL = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.linspace(0, 11, 60), np.linspace(1, 4, 60), strict=True)]
SPIRAL += [
    (np.cos(a) * (r - 0.4), np.sin(a) * (r - 0.4))
    for a, r in zip(np.linspace(11, 0, 60), np.linspace(4, 1, 60), strict=True)
]


def area(points: np.ndarray) -> float:
    x, y = np.asarray(points, float).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def contains(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """By the crossings of a ray."""
    inside = np.zeros(len(points), bool)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = ((ay > points[:, 1]) != (by > points[:, 1])) & (
                points[:, 0] < (bx - ax) * (points[:, 1] - ay) / (by - ay) + ax
            )
        inside ^= crosses
    return inside


def covered(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    count = np.zeros(len(points), int)
    for a, b, c in triangles:
        sides = [(q - p)[0] * (points - p)[:, 1] - (q - p)[1] * (points - p)[:, 0] for p, q in ((a, b), (b, c), (c, a))]
        count += np.all([side > 0 for side in sides], axis=0)
    return count


@pytest.mark.parametrize(
    "polygon", [L_SHAPE, ARROW, COMB, FRAME, SPIRAL], ids=["L", "arrow", "comb", "frame", "spiral"]
)
@pytest.mark.parametrize("shift", [0, 1, 3])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("flip", [False, True])
def test_triangles_cover_the_polygon_once(polygon: list, shift: int, axis: int, flip: bool) -> None:
    flat = np.roll(np.array(polygon, float), shift, axis=0)
    if flip:
        flat = flat[::-1]
    points = np.roll(np.column_stack((flat, np.full(len(flat), 0.3))), axis, axis=1)
    corners, faces = triangulate(np.array([len(flat)]), np.arange(len(flat)), points)
    assert corners.shape == (len(flat) - 2, 3)
    assert (faces == 0).all()
    areas = [area(flat[triangle]) for triangle in corners]
    assert sum(areas) == pytest.approx(area(flat))
    sign = np.sign(area(flat))
    assert all(sign * a >= -1e-9 for a in areas)
    random = np.random.default_rng(0).uniform(flat.min(axis=0), flat.max(axis=0), (2000, 2))
    turned = flat[corners] if sign > 0 else flat[corners][:, ::-1]
    np.testing.assert_array_equal(covered(random, turned), contains(flat, random))


def test_faces_of_several_sizes_keep_their_order() -> None:
    counts = np.array([4, 3, 2, 5, 3])
    points = np.random.default_rng(1).normal(size=(30, 3))
    indices = np.random.default_rng(2).integers(0, 30, counts.sum())
    corners, faces = triangulate(counts, indices, points)
    assert faces.tolist() == [0, 0, 1, 3, 3, 3, 4]
    starts = np.concatenate(([0], np.cumsum(counts)))
    for triangle, face in zip(corners, faces, strict=True):
        assert ((triangle >= starts[face]) & (triangle < starts[face + 1])).all()


def test_polygons_without_area_end() -> None:
    line = np.column_stack((np.arange(7.0), np.zeros(7), np.zeros(7)))
    corners, _ = triangulate(np.array([7]), np.arange(7), line)
    assert corners.shape == (5, 3)
    corners, _ = triangulate(np.array([6]), np.zeros(6, int), np.zeros((1, 3)))
    assert corners.shape == (4, 3)


def test_nothing_makes_no_triangles() -> None:
    corners, faces = triangulate(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))
    assert corners.shape == (0, 3)
    assert faces.shape == (0,)
