"""A camera around a scene, and its rays: for tests that compare images with other tracers."""

from typing import Any

import numpy as np
import pytest

import warpcam as wc

# Cut solids lie inside of round ones: relative to the scene's radius.
ROUGH = 2e-3


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a camera at ``eye`` that has ``target`` in its middle; z is up."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross((0.0, 0.0, 1.0) if abs(back[2]) < 0.99 else (0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    return np.stack((right, np.cross(back, right), back), axis=1)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """w x y z of a proper rotation, (3, 3)."""
    r = np.asarray(rotation, np.float64)
    k = np.array(
        (
            (r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0),
            (r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0),
            (r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0),
            (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)),
        )
    )
    x, y, z, w = np.linalg.eigh((k + np.tril(k, -1).T) / 3.0)[1][:, -1]
    return np.array((w, x, y, z))


class Around:
    """A camera outside of a box, and the rays of its pixels."""

    def __init__(self, low: np.ndarray, high: np.ndarray, direction: tuple, size: int = 96, fovy: float = 40.0):
        middle, radius = 0.5 * (low + high), max(0.5 * float(np.linalg.norm(high - low)), 1e-6)
        away = np.array(direction, float) / np.linalg.norm(direction)
        self.eye = middle + away * radius / np.sin(np.radians(0.5 * fovy))
        self.rotation = look_at(self.eye, middle)
        self.size, self.fovy, self.radius = size, fovy, radius

    def camera(self, *outputs: str) -> wc.Camera:
        return wc.Camera(
            "around",
            width=self.size,
            height=self.size,
            lens=wc.Pinhole(fovy=self.fovy),
            position=self.eye,
            rotation=quaternion(self.rotation),
            outputs=outputs,
        )

    def rays(self) -> np.ndarray:
        """Directions whose planar depth is 1, (pixel, 3)."""
        at = (np.arange(self.size) + 0.5) / self.size * 2.0 - 1.0
        x, y = np.meshgrid(at, -at)
        tangent = np.tan(np.radians(0.5 * self.fovy))
        return np.stack((x * tangent, y * tangent, -np.ones_like(x)), axis=-1).reshape(-1, 3) @ self.rotation.T


def depth(scene: wc.Scene, around: Around, world: int = 0) -> np.ndarray:
    image = wc.Renderer(scene, [around.camera("depth")]).render()["around"]["depth"]
    return image[world, ..., 0].cpu().numpy()


def cast(mesh: Any, around: Around) -> np.ndarray:
    """Planar depth of a trimesh by Embree."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("embreex")
    rays = around.rays()
    tracer = trimesh.ray.ray_pyembree.RayMeshIntersector(mesh, scale_to_box=True)
    origins = np.broadcast_to(around.eye, rays.shape)
    places, index, _ = tracer.intersects_location(origins, rays, multiple_hits=False)
    planar = np.full(len(rays), np.inf)
    planar[index] = (around.eye - places) @ around.rotation[:, 2]
    return planar.reshape(around.size, around.size)


def compare(scene: wc.Scene, mesh: Any, directions: tuple = ((0.6, -0.8, 0.5), (-0.7, 0.3, -0.4))) -> None:
    """Hold a scene's depth against Embree's."""
    low, high = mesh.bounds
    for direction in directions:
        around = Around(low, high, direction)
        ours, theirs = depth(scene, around), cast(mesh, around)
        hit = np.isfinite(ours) & np.isfinite(theirs)
        near = np.where(hit, np.abs(np.where(hit, ours, 0.0) - np.where(hit, theirs, 0.0)), 0.0)
        wrong = (np.isfinite(ours) != np.isfinite(theirs)) | (near > ROUGH * around.radius)
        assert np.isfinite(theirs).mean() > 0.003
        assert wrong.mean() < 0.006, f"{wrong.mean():.4f} of the pixels differ"
        assert np.median(near[hit]) < 2e-4 * around.radius
