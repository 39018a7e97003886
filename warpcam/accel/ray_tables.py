"""Tables of rays, as native/camera/ray_table.h reads them."""

import math
from typing import Any

import numpy as np

TILE_WIDTH, TILE_HEIGHT = 8, 4  # pixels; native/camera/ray_table.h has the same numbers
BLIND = 3.0e18  # in place of the coordinates of a pixel that sees nothing
BEHIND = 4.0e6  # of a ray straight back, whose coordinates would be infinite
ROUNDING = 1e-6  # of the cosine of a cone's half angle
MOST_PIXELS = 2**15 - 1  # of a side


def table_floats(width: int, height: int) -> int:
    """Floats of the table of one image; tables lie one after the other."""
    tiles = -(-width // TILE_WIDTH) * -(-height // TILE_HEIGHT)
    return 4 * tiles + -(-2 * width * height // 4) * 4


def pack_rays(directions: np.ndarray) -> np.ndarray:
    """The tables of some images.

    Args:
        directions: (n, height, width, 3) in the camera's frame, of any length; 0 sees nothing.

    Returns:
        float32 (n, table_floats(width, height)): for each tile, row after row, the axis of a cone that holds its rays
        and the cosine of its half angle; then for each pixel two coordinates.
    """
    count, height, width = directions.shape[:3]
    packed = np.zeros((count, table_floats(width, height)), np.float32)
    for first in range(0, count, chunk := max(1, 2**22 // (width * height))):
        some = unit(directions[first : first + chunk])
        cones = tile_cones(some).reshape(len(some), -1)
        packed[first : first + len(some), : cones.shape[1]] = cones
        points = flattened(some).reshape(len(some), -1)
        packed[first : first + len(some), cones.shape[1] : cones.shape[1] + points.shape[1]] = points
    return packed


def unit(directions: np.ndarray) -> np.ndarray:
    """Normalise directions to length 1, or 0 for zero vectors; float64."""
    wide = directions.astype(np.float64)
    largest = np.abs(wide).max(axis=-1, keepdims=True)
    wide = np.divide(wide, largest, out=np.zeros_like(wide), where=largest > 0.0)
    length = np.linalg.norm(wide, axis=-1, keepdims=True)
    return np.divide(wide, length, out=np.zeros_like(wide), where=length > 0.0)


def flattened(directions: np.ndarray) -> np.ndarray:
    """Return where the line from (0, 0, 1) through each unit direction meets the plane z = 0: (..., 2)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    aside = x * x + y * y
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(z < 0.0, 1.0 / (1.0 - z), (1.0 + z) / aside)
        points = np.stack([rate * x, rate * y], axis=-1)
    back = (aside <= BEHIND**-2) & (z > 0.0)
    points[back] = (BEHIND, 0.0)
    points[(aside == 0.0) & (z == 0.0)] = (BLIND, 0.0)
    return points


def tile_cones(directions: np.ndarray) -> np.ndarray:
    """For each tile the axis of a cone about its rays and the cosine of its half angle: (n, tile, 4).

    Half angles may be anything up to 180 degrees. Tiles that see nothing have a cone of no width.
    """
    count, height, width = directions.shape[:3]
    down, across = -(-height // TILE_HEIGHT), -(-width // TILE_WIDTH)
    beyond = ((0, 0), (0, down * TILE_HEIGHT - height), (0, across * TILE_WIDTH - width), (0, 0))
    whole = np.pad(directions, beyond).reshape(count, down, TILE_HEIGHT, across, TILE_WIDTH, 3)
    rays = whole.transpose(0, 1, 3, 2, 4, 5).reshape(count, down * across, TILE_HEIGHT * TILE_WIDTH, 3)
    axis = rays.mean(axis=2)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    narrow = length > 1e-6
    axis = np.where(narrow, axis / np.where(narrow, length, 1.0), (0.0, 0.0, -1.0))
    seeing = rays.any(axis=-1)
    along = np.where(seeing, np.einsum("ntkc,ntc->ntk", rays, axis), 1.0)
    cosine = np.maximum(along.min(axis=2) - ROUNDING, -1.0)
    return np.concatenate([axis, cosine[..., None]], axis=-1)


def pixel_angle(directions: np.ndarray) -> float:
    """The angle between neighbouring rays, of most of an image (height, width, 3) [rad]."""
    rays = unit(directions)
    pairs = [(rays[:, 1:], rays[:, :-1]), (rays[1:], rays[:-1])]
    angles = [
        2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=-1), 0.0, 1.0))[a.any(axis=-1) & b.any(axis=-1)]
        for a, b in pairs
    ]
    found = np.concatenate([part.reshape(-1) for part in angles])
    return max(float(np.median(found)), 1e-6) if found.size else 0.5 * math.pi


def table_handles(table: int, count: int, floats: int, width: int, height: int, angles: Any) -> np.ndarray:
    """Return the values of View.scale and View.center for each table: float32 (count, 4), bits.

    Args:
        table: Address of the first.
        count: How many.
        floats: That each has.
        width: Of the image [pixels].
        height: Of the image [pixels].
        angles: Of each, between neighbouring rays [rad]; with offset rays see ``offset_pixel_width``. Or one for all.
    """
    addresses = table + 4 * floats * np.arange(count, dtype=np.uint64)
    words = np.empty((count, 4), np.uint32)
    words[:, 0] = width | height << 16
    words[:, 1] = np.asarray(angles, np.float32).view(np.uint32)
    words[:, 2] = addresses & np.uint64(0xFFFFFFFF)
    words[:, 3] = addresses >> np.uint64(32)
    return words.view(np.float32)
