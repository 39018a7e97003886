"""Solids cut into triangles, for where the kernels have no exact shape: vertices, faces, normals."""

import itertools
from typing import Any

import numpy as np

SEGMENTS = 256  # around the axis
RINGS = 64  # from a pole to the equator
FAR = 1e4  # half width of what has no end [its own unit]

Cut = tuple[np.ndarray, np.ndarray, np.ndarray]
Line = tuple[Any, Any, Any, Any]  # where it starts and ends, (radius, z), and its normals there


def cone(radius: float, half: float) -> Cut:
    return cylinder(radius, 0.0, half)


def cylinder(bottom: float, top: float, half: float) -> Cut:
    """Radii at -half and +half along z."""
    slope = np.array((2.0 * half, bottom - top))
    side = slope / np.linalg.norm(slope)
    profile = [
        ((0.0, -half), (bottom, -half), (0.0, -1.0), (0.0, -1.0)),
        ((bottom, -half), (top, half), side, side),
        ((top, half), (0.0, half), (0.0, 1.0), (0.0, 1.0)),
    ]
    return _turned(profile)


def capsule(bottom: float, top: float, half: float) -> Cut:
    """Half spheres at -half and +half along z, and what lies between their equators: nothing in a sphere."""
    angles = np.linspace(-0.5 * np.pi, 0.0, RINGS + 1)
    low = [(np.array((np.cos(a), np.sin(a))), bottom, -half) for a in angles]
    high = [(np.array((np.cos(a), np.sin(a))), top, half) for a in angles + 0.5 * np.pi]
    profile: list[Line] = []
    for ring in (low, high):
        for (first, radius, z), (second, _, _) in itertools.pairwise(ring):
            profile.append((radius * first + (0.0, z), radius * second + (0.0, z), first, second))
    slope = np.array((2.0 * half, bottom - top))
    side = slope / max(float(np.linalg.norm(slope)), 1e-300)
    if half > 0.0:
        profile.append(((bottom, -half), (top, half), side, side))
    return _turned(profile)


def box(half: np.ndarray) -> Cut:
    """Half extents, (3,)."""
    vertices: list[Any] = []
    faces: list[Any] = []
    normals: list[Any] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, axis] = sign
            corners[:, first] = np.array((-1.0, 1.0, 1.0, -1.0)) * sign
            corners[:, second] = (-1.0, -1.0, 1.0, 1.0)
            start = 4 * len(vertices)
            vertices.append(corners * half)
            faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
            normals += [np.tile(sign * np.eye(3)[axis], (3, 1))] * 2
    return np.concatenate(vertices), np.array(faces, np.int32), np.array(normals)


def rectangle(x: float, y: float) -> Cut:
    """Half widths; it faces +z."""
    vertices = np.array(((-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)))
    return vertices, np.array(((0, 1, 2), (0, 2, 3)), np.int32), np.tile((0.0, 0.0, 1.0), (2, 3, 1))


def _turned(profile: list[Line]) -> Cut:
    """Lines (radius, z) to (radius, z) with normals at their ends, turned about z; outside is to the right of them."""
    angles = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    vertices: list[Any] = []
    faces: list[Any] = []
    normals: list[Any] = []
    this, after = np.arange(SEGMENTS), (np.arange(SEGMENTS) + 1) % SEGMENTS
    count = 0
    for start, end, start_normal, end_normal in profile:
        rings = [_ring(angles, *place) for place in (start, end)]
        directions = [_ring(angles, *normal) for normal in (start_normal, end_normal)]
        vertices += rings
        a, b, c, d = count + this, count + after, count + SEGMENTS + after, count + SEGMENTS + this
        corner_normals = [directions[0][this], directions[0][after], directions[1][after], directions[1][this]]
        if start[0] > 0.0:
            faces.append(np.stack((a, b, c), axis=1))
            normals.append(np.stack([corner_normals[k] for k in (0, 1, 2)], axis=1))
        if end[0] > 0.0:
            faces.append(np.stack((a, c, d), axis=1))
            normals.append(np.stack([corner_normals[k] for k in (0, 2, 3)], axis=1))
        count += 2 * SEGMENTS
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int32), np.concatenate(normals)


def _ring(angles: np.ndarray, radius: float, z: float) -> np.ndarray:
    return np.stack((radius * np.cos(angles), radius * np.sin(angles), np.full_like(angles, z)), axis=1)
