"""Images of the light from all around by longitude and latitude, as the terms that irradiance is computed from."""

import numpy as np

from warpcam.core.color import srgb_to_linear

MIN_ROWS, MIN_COLUMNS = 128, 256  # that an image is cut into
# Spherical harmonics of order 2 as native/shading/environment.h has them: the squares of what norms each term.
NORMS = np.array((1.0, 3.0, 3.0, 3.0, 15.0, 15.0, 1.25, 15.0, 3.75)) / (4.0 * np.pi)
LINEAR = srgb_to_linear(np.arange(256) / 255.0)


def _light(row: np.ndarray) -> np.ndarray:
    return LINEAR[row] if row.dtype == np.uint8 else row.astype(np.float64)


def sky_of_panorama(pixels: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Terms of an image by longitude and latitude, (SKY_TERMS, 3).

    Args:
        pixels: (height, width, 3), uint8, sRGB-coded, or float, linear; its middle lies along +z, its top is +y, of the
            dome.
        turn: (3, 3), rotation from the dome's axes to the world's.
    """
    height, width = pixels.shape[:2]
    pieces = -(-MIN_COLUMNS // width)  # of a column
    longitude = 2.0 * np.pi * (0.5 - (np.arange(width * pieces) + 0.5) / (width * pieces))
    s, c = np.sin(longitude), np.cos(longitude)
    waves = np.stack((np.ones_like(s), s, c, s * s, s * c, c * c)) * 2.0 * np.pi / len(s)
    waves = waves.reshape(len(waves), width, pieces).sum(axis=2)
    rows = np.concatenate([waves @ _light(pixels[row])[None] for row in range(height)])  # one at a time: they are large
    parts = -(-MIN_ROWS // height)
    rows = np.repeat(rows, parts, axis=0)
    edges = np.linspace(0.5 * np.pi, -0.5 * np.pi, height * parts + 1)
    middle = 0.5 * (edges[:-1] + edges[1:])
    u, f = np.sin(middle)[:, None], np.cos(middle)[:, None]
    one, x, z, xx, xz, zz = np.moveaxis(rows, 1, 0)
    first = np.stack((f * x, u * one, f * z))
    second = np.stack((f * f * xx, f * u * x, f * f * xz, f * u * x, u * u * one, f * u * z, f * f * xz, f * u * z,
                       f * f * zz))  # fmt: skip
    areas = np.sin(edges[:-1]) - np.sin(edges[1:])
    total = np.einsum("h,hc->c", areas, one)
    along = turn @ np.einsum("h,dhc->dc", areas, first)
    across = np.einsum("ij,jkc,lk->ilc", turn, np.einsum("h,dhc->dc", areas, second).reshape(3, 3, -1), turn)
    moments = np.stack(
        (
            total, *along, across[0, 1], across[1, 2], 3.0 * across[2, 2] - total, across[0, 2],
            across[0, 0] - across[1, 1],
        )
    )  # fmt: skip
    return NORMS[:, None] * moments
