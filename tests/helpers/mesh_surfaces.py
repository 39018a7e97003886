"""Surfaces of many faces, and whether rays meet them."""

import functools

import numpy as np


def grid(count: int, place) -> tuple[np.ndarray, np.ndarray]:
    """A square of 2 * count**2 faces, whose points are at place(u, v), u and v in [0, 1]."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, count + 1), np.linspace(0.0, 1.0, count + 1), indexing="ij")
    points = np.stack(place(u, v), axis=-1).reshape(-1, 3).astype(np.float32)
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    corner = (i * (count + 1) + j).ravel()
    right, up, both = corner + count + 1, corner + 1, corner + count + 2
    faces = np.concatenate([np.stack([corner, right, both], 1), np.stack([corner, both, up], 1)])
    return points, faces.astype(np.int32)


def ball(u, v):
    around, down = 2.0 * np.pi * u, np.pi * v
    return np.sin(down) * np.cos(around), -np.sin(down) * np.sin(around), np.cos(down)


def hills(u, v):
    return u, v, 0.1 * np.sin(9.0 * u) * np.cos(7.0 * v)


def bowl(u, v):  # seen from inside
    around, down = 2.0 * np.pi * u, 0.5 * np.pi * v
    return np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), -np.cos(down)


def ridges(u, v):  # sharp, and of faces of very different sizes
    return u**3, v**2, 0.2 * np.abs(np.mod(6.0 * u, 2.0) - 1.0)


def soup(seed: int, count: int, reach: float, thickness: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Faces anywhere, of which those of a dense soup run through each other."""
    random = np.random.default_rng(seed)
    place = random.uniform(-reach, reach, (count, 1, 3)) * (1.0, 1.0, thickness)
    corners = place + size * random.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def floors() -> tuple[np.ndarray, np.ndarray]:
    """One above the other, both seen from above."""
    points, faces = grid(6, lambda u, v: (u, v, 0.0 * u))
    over = points * (0.5, 0.5, 1.0) + (0.3, 0.2, 0.15)
    return np.concatenate([points, over]).astype(np.float32), np.concatenate([faces, faces + len(points)])


SHAPES = {
    "ball": lambda: grid(20, ball),
    "hills": lambda: grid(16, hills),
    "bowl": lambda: grid(16, bowl),
    "ridges": lambda: grid(16, ridges),
    "soup": lambda: soup(3, 60, 3.0, 1.0, 0.3),
    "floors": floors,
} | {f"dense{seed}": functools.partial(soup, seed, 30, 1.0, 0.2, 0.15) for seed in (0, 2, 5)}


def torus(u, v):
    around, across = 2.0 * np.pi * u, 2.0 * np.pi * v
    out = 1.0 + 0.35 * np.cos(across)
    return out * np.cos(around), out * np.sin(around), 0.35 * np.sin(across)


def cup(u, v):
    """Closed, with thin walls: a turned outline."""
    outline = np.array([(0, 0), (0.9, 0), (1, 0.1), (1, 1.5), (0.94, 1.5), (0.94, 0.12), (0.88, 0.06), (0, 0.06)])
    place = v * (len(outline) - 1)
    out, up = (np.interp(place, np.arange(len(outline)), outline[:, k]) for k in (0, 1))
    return out * np.cos(2.0 * np.pi * u), out * np.sin(2.0 * np.pi * u), up


def welded(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points that are the same but for rounding made so, and faces without area left out."""
    points = np.round(points.astype(np.float64), 5).astype(np.float32) + np.float32(0.0)
    corners = points[faces]
    whole = ~((corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1))
    return points, faces[whole]


CLOSED = {
    "ball": lambda: welded(*grid(20, ball)),
    "torus": lambda: welded(*grid(24, torus)),
    "cup": lambda: welded(*grid(28, cup)),
}


def meets(
    origins: np.ndarray, directions: np.ndarray, corners: np.ndarray, near: float, far: float = np.inf
) -> np.ndarray:
    """Return whether rays (ray, 3) meet one of the faces between two distances, from either side, (ray,)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    met = np.zeros(len(origins), bool)
    for a, e, f in zip(corners[:, 0], first, second, strict=True):
        p = np.cross(directions, f)
        size = p @ e
        with np.errstate(divide="ignore", invalid="ignore"):
            away = origins - a
            u = (away * p).sum(1) / size
            q = np.cross(away, e)
            v = (directions * q).sum(1) / size
            t = q @ f / size
            met |= (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > near) & (t < far)
    return met
