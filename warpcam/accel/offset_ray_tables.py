"""Tables of rays with their own origins, as native/camera/ray_table.h and native/camera/offset_rays.h read them."""

import numpy as np

from warpcam.accel.ray_tables import TILE_HEIGHT, TILE_WIDTH, pixel_angle, tile_cones, unit

# Bits of a pixel; native/camera/offset_rays.h has the same.
LEFT, RIGHT, UP, DOWN, BLIND = 1, 2, 4, 8, 16
BESIDE = 4.0  # a pixel that lies so many times as far from one as that on its other side does not belong to it
ROUNDING = 1e-6  # of unit directions, and of places as parts of the greatest


def offset_table_floats(width: int, height: int) -> int:
    """Floats of the table of one image; tables lie one after the other."""
    return 4 * (1 + 2 * -(-width // TILE_WIDTH) * -(-height // TILE_HEIGHT) + 2 * width * height)


def pack_offset_rays(directions: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The tables of some images.

    Args:
        directions: (n, height, width, 3) in the camera's frame, of any length; 0 sees nothing.
        starts: (n, height, width, 3) where rays begin, in the camera's frame [m].

    Returns:
        float32 (n, offset_table_floats(width, height)): a ball that holds all places where rays begin, its middle and
        its radius; for each tile, row after row, the axis of a cone that holds its rays, the cosine of its half angle,
        and such a ball; then for each pixel where its ray begins, its bits, the unit direction, and the image's width.
    """
    count, height, width = directions.shape[:3]
    packed = np.empty((count, offset_table_floats(width, height)), np.float32)
    for first in range(0, count, chunk := max(1, 2**20 // (width * height))):
        some = slice(first, first + chunk)
        rays, places = unit(directions[some]), starts[some].astype(np.float32)
        seeing: np.ndarray = np.asarray(rays.any(axis=-1))
        places = np.where(seeing[..., None], places, np.float32(0.0))
        cones = tile_cones(rays).astype(np.float32)
        whole = bounding_spheres(places.reshape(len(rays), 1, -1, 3), seeing.reshape(len(rays), 1, -1))
        tiles = np.concatenate([cones, bounding_spheres(tiled(places), tiled(seeing[..., None])[..., 0])], axis=-1)
        pixels = np.empty((len(rays), height, width, 8), np.float32)
        pixels[..., :3] = places
        pixels[..., 3] = bits_of(rays, places, seeing).view(np.float32)
        pixels[..., 4:7] = np.where(seeing[..., None], rays, (0.0, 0.0, 1.0))
        pixels[..., 7] = np.int32(width).view(np.float32)
        parts = [part.reshape(len(rays), -1) for part in (whole, tiles, pixels)]
        np.concatenate(parts, axis=1, out=packed[some])
    return packed


def tiled(values: np.ndarray) -> np.ndarray:
    """(n, height, width, c) by tiles, (n, tile, pixel of the tile, c); 0 beyond the image."""
    count, height, width, channels = values.shape
    down, across = -(-height // TILE_HEIGHT), -(-width // TILE_WIDTH)
    beyond = ((0, 0), (0, down * TILE_HEIGHT - height), (0, across * TILE_WIDTH - width), (0, 0))
    whole = np.pad(values, beyond).reshape(count, down, TILE_HEIGHT, across, TILE_WIDTH, channels)
    return whole.transpose(0, 1, 3, 2, 4, 5).reshape(count, down * across, TILE_HEIGHT * TILE_WIDTH, channels)


def bounding_spheres(places: np.ndarray, seeing: np.ndarray) -> np.ndarray:
    """For each set a ball that holds its places, middle and radius: float32 (n, set, 4); of none at 0, of no size.

    Args:
        places: (n, set, place, 3).
        seeing: (n, set, place), which of them count.
    """
    counts = seeing[..., None]
    low, high = np.where(counts, places, np.inf).min(axis=2), np.where(counts, places, -np.inf).max(axis=2)
    with np.errstate(invalid="ignore"):
        middle = np.where(counts.any(axis=2), 0.5 * low + 0.5 * high, 0.0).astype(np.float32)
    off = np.linalg.norm(places.astype(np.float64) - middle[:, :, None], axis=-1)
    radius = np.where(seeing, off, 0.0).max(axis=2)
    return np.concatenate([middle, (radius * (1.0 + ROUNDING)).astype(np.float32)[..., None]], axis=-1)


def bits_of(rays: np.ndarray, places: np.ndarray, seeing: np.ndarray) -> np.ndarray:
    """Return which neighbours each pixel's surface may continue into, as bits: int32 (n, height, width).

    A pixel beside that lies much farther away than the one on the other side, by its direction or by where its ray
    begins, belongs to something else.
    """
    bits = np.where(seeing, 0, BLIND).astype(np.int32)
    near = ROUNDING * (1.0 + np.abs(places).max(initial=0.0))
    for axis, before, after in ((2, LEFT, RIGHT), (1, UP, DOWN)):
        there = np.stack(both_sides(_pairs(seeing, axis, np.logical_and), axis, False))
        apart = np.zeros_like(there)
        for values, least in ((rays, ROUNDING), (places, near)):
            steps = np.linalg.norm(_pairs(values, axis, np.subtract), axis=-1)
            sides = np.stack(both_sides(steps, axis, np.inf))
            apart |= there[::-1] & (sides > BESIDE * sides[::-1] + least)
        linked = there & ~apart
        bits |= before * linked[0] + after * linked[1]
    return bits


def both_sides(steps: np.ndarray, axis: int, beyond: float | bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps before and after each pixel along an axis; ``beyond`` at the image's edges."""
    shape = list(steps.shape)
    shape[axis] = 1
    edge = np.full(shape, beyond)
    return np.concatenate([edge, steps], axis), np.concatenate([steps, edge], axis)


def offset_pixel_width(directions: np.ndarray, starts: np.ndarray) -> float:
    """The angle between neighbouring rays and how far apart they begin, of most of an image [rad, m]."""
    seeing: np.ndarray = np.asarray(directions.any(axis=-1))
    steps = [
        np.linalg.norm(_pairs(starts, axis, np.subtract), axis=-1)[_pairs(seeing, axis, np.logical_and)]
        for axis in (0, 1)
    ]
    found = np.concatenate(steps)
    return pixel_angle(directions) + (float(np.median(found)) if found.size else 0.0)


def _pairs(values: np.ndarray, axis: int, combine: np.ufunc) -> np.ndarray:
    length = values.shape[axis]
    return combine(np.take(values, range(1, length), axis), np.take(values, range(length - 1), axis))
