"""The sun of an image of light from all around: its brightest small part, as a distant light."""

import math
from dataclasses import dataclass

import numpy as np

LUMINANCE = np.array((0.2126, 0.7152, 0.0722), np.float32)
MOST_ANGLE = math.radians(5.0)  # from a sun's middle to its edge
RING_ANGLE = math.radians(15.0)  # how far around it the sky is that it is compared with
FAR_ABOVE = 4.0  # times the mean of that sky: what is brighter belongs to the sun
LEAST_SHARE = 0.05  # of the light of the rest: a sun that has less is left in the image
MOST_BESIDE = 0.1  # of its light, what is as bright around it: with more, it is no small part


@dataclass(frozen=True)
class PanoramaSun:
    """A distant light that shines as the part of an image does which is taken out for it.

    Attributes:
        direction: Towards it, unit, (3,), in the image's axes: its middle, to the left of that, up.
        color: What a white surface shows that faces it: its irradiance over pi, linear, (3,).
        sine_squared: Of the angle from its middle to its edge.
        limit: Luminance that is left of texels of more, in their own colour.
        cosine: Of the angle around ``direction`` within which texels are so.
    """

    direction: np.ndarray
    color: np.ndarray
    sine_squared: float
    limit: float
    cosine: float


def sun_of_panorama(light: np.ndarray) -> PanoramaSun | None:
    """Return the sun of an image of linear radiance by longitude and latitude, (height, width, 3), if it has one."""
    bright = light @ LUMINANCE
    height, width = bright.shape
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    areas = (edges[:-1] - edges[1:]) * (2.0 * np.pi / width)  # of a row's texels [sr]
    row, column = np.unravel_index(int(bright.argmax()), bright.shape)
    reach = math.ceil(RING_ANGLE / np.pi * height) + 1
    rows = slice(max(int(row) - reach, 0), int(row) + reach + 1)
    middle = _directions(np.array([row]), height, np.array([column]), width)[0, 0]
    directions = _directions(np.arange(height)[rows], height, np.arange(width), width)
    cosines, area, seen = directions @ middle, areas[rows, None], bright[rows].astype(np.float64)
    near = cosines >= math.cos(MOST_ANGLE)
    ring = ~near & (cosines >= math.cos(RING_ANGLE))
    around = (area * ring).sum()
    limit = FAR_ABOVE * float((area * ring * seen).sum() / around) if around > 0.0 else math.inf
    excess = np.maximum(seen - limit, 0.0) * area
    flux = float((excess * near).sum())
    rest = float((areas @ bright.astype(np.float64)).sum()) - flux
    if not flux > max(LEAST_SHARE * rest, 0.0) or (excess * ring).sum() > MOST_BESIDE * flux:
        return None
    toward = np.einsum("hw,hwc->c", excess * near, directions)
    toward /= np.linalg.norm(toward)
    cosine = math.cos(2.0 * MOST_ANGLE)
    taken = excess * (directions @ toward >= cosine)  # as without_sun() takes it: what lies beside the sun, too
    colors = light[rows] * (taken / np.maximum(seen, 1e-30))[..., None]
    squares = float((excess * near * np.maximum(seen - limit, 0.0)).sum())
    return PanoramaSun(
        direction=toward,
        color=colors.sum(axis=(0, 1)) / np.pi,
        sine_squared=min(flux * flux / squares / np.pi, math.sin(MOST_ANGLE) ** 2),
        limit=limit,
        cosine=cosine,
    )


def without_sun(light: np.ndarray, sun: PanoramaSun) -> np.ndarray:
    """Return an image whose sun has ``sun.limit`` at most, (height, width, 3) float32."""
    height, width = light.shape[:2]
    left = light.copy()
    reach = math.ceil(2.0 * MOST_ANGLE / np.pi * height) + 1
    row = int(math.acos(np.clip(sun.direction[2], -1.0, 1.0)) / np.pi * height)
    rows = slice(max(row - reach, 0), row + reach + 1)
    near = _directions(np.arange(height)[rows], height, np.arange(width), width) @ sun.direction >= sun.cosine
    bright = light[rows] @ LUMINANCE
    factors = np.where(near & (bright > sun.limit), sun.limit / np.maximum(bright, 1e-30), 1.0)
    left[rows] *= factors[..., None].astype(np.float32)
    return left


def _directions(rows: np.ndarray, height: int, columns: np.ndarray, width: int) -> np.ndarray:
    """Unit directions of the middles of texels, (row, column, 3)."""
    up, around = np.pi * (0.5 - (rows + 0.5) / height), 2.0 * np.pi * (0.5 - (columns + 0.5) / width)
    flat = np.cos(up)[:, None]
    parts = (flat * np.cos(around), flat * np.sin(around), np.repeat(np.sin(up)[:, None], len(columns), axis=1))
    return np.stack(parts, axis=-1)
