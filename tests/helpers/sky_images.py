"""Images of the light from all around, and their light by plain summation."""

from collections.abc import Callable

import numpy as np


def directions(height: int, width: int) -> np.ndarray:
    """Of the texels' middles in the image's axes, (height, width, 3): towards its middle, to the left, up."""
    longitude = 2.0 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    parts = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
    return np.stack([np.broadcast_to(part, (height, width)) for part in parts], axis=-1)


def angles(height: int, width: int) -> np.ndarray:
    """Solid angle of each texel, (height, 1) [sr]."""
    edges = np.sin(np.pi * (0.5 - np.arange(height + 1) / height))
    return ((edges[:-1] - edges[1:]) * 2.0 * np.pi / width)[:, None]


def image_of(radiance: Callable[[np.ndarray], np.ndarray], height: int, width: int) -> np.ndarray:
    """The image of a function of directions (..., 3) with values (..., 3), float32."""
    return radiance(directions(height, width)).astype(np.float32)


def smooth_radiance(d: np.ndarray) -> np.ndarray:
    """All terms of spherical harmonics up to order 2, another mixture for each colour; nowhere below 0."""
    x, y, z = np.moveaxis(d, -1, 0)
    terms = np.stack([np.ones_like(x), x, y, z, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y], axis=-1)
    rates = np.array(
        (
            (2.0, 0.3, -0.2, 0.5, 0.4, -0.3, 0.1, 0.2, -0.3),
            (1.5, -0.2, 0.4, 0.1, -0.3, 0.2, 0.2, -0.1, 0.2),
            (1.8, 0.1, 0.3, -0.6, 0.2, 0.4, -0.1, 0.3, 0.1),
        )
    )
    return terms @ rates.T


def bumpy_radiance(d: np.ndarray) -> np.ndarray:
    """A bright patch on light that changes quickly from place to place."""
    patch = 20.0 * np.exp(30.0 * (d @ np.array((0.48, 0.6, 0.64)) - 1.0))
    waves = 1.0 + 0.5 * np.sin(7.0 * d[..., 0] + 3.0 * d[..., 2]) * np.cos(5.0 * d[..., 1])
    return np.stack((waves + patch, waves, 0.5 * patch + 0.1), axis=-1)


def irradiance(image: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Over pi, on surfaces that face ``normals`` (n, 3) in the image's axes, (n, 3)."""
    height, width = image.shape[:2]
    light = (image * angles(height, width)[..., None]).reshape(-1, 3).astype(np.float64)
    cosines = np.maximum(normals @ directions(height, width).reshape(-1, 3).T, 0.0)
    return cosines @ light / np.pi


def turn_of(quaternion: tuple[float, ...], yaw: float) -> np.ndarray:
    """From the image's axes to the world's, (3, 3): a yaw to the left [degrees], then a quaternion wxyz."""
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    s, c = np.sin(np.radians(yaw)), np.cos(np.radians(yaw))
    turn = np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )
    return turn @ np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
