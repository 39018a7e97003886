"""Lenses whose rays begin at places of their own, and how their images are compared."""

from typing import Any

import numpy as np
from custom_ray_tables import HEIGHT, WIDTH

import warpcam as wc
from warpcam.accel import ray_tables

COLUMN, ROW = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
SPAN = 2.7  # metres from bottom to top, of parallel rays
FOCAL = 0.5 * HEIGHT / np.tan(np.radians(35.0))


def parallel() -> wc.Rays:
    """Return the rays of Orthographic(SPAN)."""
    step = SPAN / HEIGHT
    origins = np.stack([(COLUMN - 0.5 * WIDTH) * step, (0.5 * HEIGHT - ROW) * step, np.zeros_like(ROW)], -1)
    return wc.Rays(np.broadcast_to((0.0, 0.0, -1.0), origins.shape), origins=origins)


def pinholes(ahead: float, more: float) -> wc.Rays:
    """A pinhole's rays that begin farther along them, the more the farther to the right."""
    rays = np.stack([(COLUMN - 0.5 * WIDTH) / FOCAL, (0.5 * HEIGHT - ROW) / FOCAL, np.full_like(ROW, -1.0)], -1)
    return wc.Rays(rays, origins=(ahead + more * COLUMN / WIDTH)[..., None] * ray_tables.unit(rays))


def swaying(seed: int = 5) -> np.ndarray:
    """Places of a camera that moves while it looks, and jumps."""
    random = np.random.default_rng(seed)
    origins = 0.3 * np.stack([np.sin(ROW / 4.0), np.cos(COLUMN / 9.0), np.sin((ROW + COLUMN) / 11.0)], -1)
    origins[:, 20:] += random.uniform(-0.4, 0.4, 3)
    return origins + 0.02 * random.normal(size=origins.shape)


def assert_alike(seen: dict[str, Any], expected: dict[str, Any], least: float = 0.995) -> None:
    same = (seen["segmentation"] == expected["segmentation"])[..., 0]
    assert same.mean() > least and len(np.unique(expected["segmentation"])) > 1
    for name, most in (("depth", 2e-5), ("distance", 2e-5), ("points", 2e-5), ("normals", 2e-3)):
        if name in seen:
            np.testing.assert_allclose(seen[name][same], expected[name][same], atol=most, rtol=2e-4, err_msg=name)
    for name in ("rgb", "albedo"):
        if name in seen:
            difference = np.abs(seen[name][same].astype(int) - expected[name][same])
            assert np.percentile(difference, 99) <= 4, name
