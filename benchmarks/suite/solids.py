"""Triangle meshes made from numbers: solids of revolution, smooth or bumpy, with texture coordinates."""

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Solid:
    """A closed mesh whose faces look outwards.

    Attributes:
        points: (vertex, 3) [m].
        faces: (face, 3) indices of points.
        uvs: (corner, 2) texture coordinates.
        corners: (face, 3) indices of uvs.
    """

    points: np.ndarray
    faces: np.ndarray
    uvs: np.ndarray
    corners: np.ndarray

    def add_to(self, spec: mujoco.MjSpec, name: str) -> str:
        """Add the solid as a mesh; returns its name."""
        shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        mesh = spec.add_mesh(name=name, uservert=self.points.ravel(), userface=self.faces.ravel(), inertia=shell)
        mesh.usertexcoord, mesh.userfacetexcoord = self.uvs.ravel(), self.corners.ravel()
        return name


def turned(radius: np.ndarray, height: np.ndarray, around: int) -> Solid:
    """Turn a profile about z.

    Args:
        radius: Of each ring from the lowest to the highest, (ring,) or (ring, around) where it differs around [m].
        height: Of each ring [m], (ring,).
        around: Number of points of a ring.
    """
    rings = len(height)
    radius = np.broadcast_to(radius.reshape(rings, -1), (rings, around))
    angle = 2.0 * np.pi * np.arange(around) / around
    side = np.stack((radius * np.cos(angle), radius * np.sin(angle), np.repeat(height, around).reshape(rings, -1)), -1)
    points = np.concatenate((side.reshape(-1, 3), ((0.0, 0.0, height[0]), (0.0, 0.0, height[-1]))))
    u, v = np.meshgrid(np.arange(around + 1) / around, np.arange(rings) / (rings - 1))
    uvs = np.concatenate((np.stack((u, v), -1).reshape(-1, 2), ((0.5, 0.0), (0.5, 1.0))))
    faces, corners = (grid(rings, around, across, len(of) - 2) for across, of in ((around, points), (around + 1, uvs)))
    return Solid(points, faces, uvs, corners)


def grid(rings: int, around: int, across: int, first_pole: int) -> np.ndarray:
    """Triangles between rings and at both ends, (face, 3), where a ring takes `across` indices."""
    ring, step = (index.ravel() for index in np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij"))
    after = (step + 1) % across
    a, b = ring * across + step, ring * across + after
    sides = np.concatenate((np.stack((a, b, b + across), 1), np.stack((a, b + across, a + across), 1)))
    step, top = np.arange(around), (rings - 1) * across
    after = (step + 1) % across
    bottom = np.stack((np.full(around, first_pole), after, step), 1)
    lid = np.stack((np.full(around, first_pole + 1), top + step, top + after), 1)
    return np.concatenate((sides, bottom, lid)).astype(np.int32)


def smooth(random: np.random.Generator, samples: int, low: float, high: float) -> np.ndarray:
    """Random values in [low, high], (samples,), that change slowly."""
    knots = random.uniform(low, high, 5)
    return np.interp(np.linspace(0.0, 4.0, samples), np.arange(5), knots)


def vessel(random: np.random.Generator, faces: int) -> Solid:
    """Make a bottle, vase or cup about 0.16 m high."""
    around = max(8, round(np.sqrt(faces)))
    rings = max(4, faces // (2 * around))
    height = random.uniform(0.1, 0.22) * np.linspace(0.0, 1.0, rings)
    return turned(smooth(random, rings, 0.02, 0.06), height, around)


def dish(random: np.random.Generator, faces: int) -> Solid:
    """Make a plate or bowl about 0.2 m wide, hollow."""
    around = max(8, round(np.sqrt(faces)))
    rings = max(6, faces // (2 * around))
    wide, deep = random.uniform(0.07, 0.12), random.uniform(0.015, 0.07)
    outside = np.linspace(0.5, 1.0, rings // 2)
    inside = np.linspace(0.95, 0.05, rings - rings // 2)
    radius = wide * np.concatenate((outside, inside))
    height = deep * np.concatenate((outside**2 - 0.25, np.maximum(inside**2 - 0.2, 0.05)))
    return turned(radius, height, around)


def rock(random: np.random.Generator, faces: int) -> Solid:
    """Make a bumpy ball about 0.2 m wide."""
    around = max(6, round(np.sqrt(faces)))
    rings = max(4, faces // (2 * around))
    polar = np.linspace(np.pi, 0.0, rings + 2)[1:-1]
    angle = 2.0 * np.pi * np.arange(around) / around
    bumps = np.zeros((rings, around))
    for _ in range(6):
        along, across = random.integers(1, 7), random.integers(0, 6)
        bumps += np.sin(along * polar[:, None] + random.uniform(0.0, 6.3)) * np.cos(across * angle)
    radius = random.uniform(0.07, 0.12) * (1.0 + 0.06 * bumps)
    return turned(radius * np.sin(polar)[:, None], 0.1 * np.cos(polar), around)


def statue(random: np.random.Generator, faces: int) -> Solid:
    """Make a figure about 0.8 m high, with folds around and along it."""
    around = max(12, round(np.sqrt(faces / 2.0)))
    rings = max(12, faces // (2 * around))
    along, angle = np.linspace(0.0, 1.0, rings), 2.0 * np.pi * np.arange(around) / around
    folds = 1.0 + 0.08 * np.sin(random.integers(5, 12) * angle + 9.0 * along[:, None])
    folds += 0.04 * np.sin(40.0 * along[:, None] + random.integers(2, 5) * angle)
    return turned(smooth(random, rings, 0.06, 0.22)[:, None] * folds, random.uniform(0.5, 1.1) * along, around)


SOLIDS = {"vessel": vessel, "dish": dish, "rock": rock, "statue": statue}
