"""The light of a clear sky and of its sun, by closed formulas.

The sky is that of Preetham, Shirley and Smits, A Practical Analytic Model for Daylight (1999), appendix A.2; the sun is
dimmed by air and aerosols as in A.1, without ozone, gases and vapour, at one wavelength for each channel.
"""

import math
from typing import Any

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError

WHITE = 30.0  # luminance that is 1 in images [kcd/m^2]: about that of a white surface under a clear noon
SUN_ILLUMINANCE = 133.0  # outside of the atmosphere [klx]
SUN_RADIUS = math.radians(0.266)  # of its disk
WAVELENGTHS = np.array((0.61, 0.55, 0.465))  # of red, green and blue [um]
LOWEST_SUN = 1.0e-3  # sine of its least elevation
TURBIDITIES = (2.0, 10.0)
SIZES = (8, 4096)  # rows of an image
# For turbidity t and 1: A, B, C, D and E of Perez's formula, of Y, x and y.
PEREZ = np.array(
    (
        ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)),
        ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)),
        ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)),
    )
)
# Of x and y at the zenith: rows for t^2, t and 1; columns for the cube, the square, ... of the sun's angle from there.
ZENITH = np.array(
    (
        (
            (0.00166, -0.00375, 0.00209, 0.0),
            (-0.02903, 0.06377, -0.03202, 0.00394),
            (0.11693, -0.21196, 0.06052, 0.25886),
        ),
        (
            (0.00275, -0.00610, 0.00317, 0.0),
            (-0.04214, 0.08970, -0.04153, 0.00516),
            (0.15346, -0.26756, 0.06670, 0.26688),
        ),
    )
)
RGB_OF_XYZ = np.array(  # IEC 61966-2-1
    ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
)


def sky_image(sun_direction: Any, turbidity: float, albedo: float, sun: bool, height: int) -> np.ndarray:
    """Radiance by longitude and latitude, (height, 2 height, 3) float32, as ``Environments.sky`` tells.

    Raises:
        WarpcamError: An argument cannot be used.
    """
    where = "Environments.sky"
    toward = _direction(sun_direction, f"{where}: sun_direction")
    _check(turbidity, f"{where}: turbidity", *TURBIDITIES)
    _check(albedo, f"{where}: albedo", 0.0, 1.0)
    if not isinstance(sun, bool | np.bool_):
        raise WarpcamError(f"{where}: sun must be True or False, got {sun!r}")
    is_whole = isinstance(height, int | np.integer) and not isinstance(height, bool)
    if not is_whole or not SIZES[0] <= height <= SIZES[1]:
        raise WarpcamError(f"{where}: height must be a whole number from {SIZES[0]} to {SIZES[1]}, got {height!r}")
    around, angles = _texels(height)
    above = around[..., 2] > 0.0
    light = np.where(above[..., None], sky_radiance(around, toward, turbidity), 0.0)
    beam = sun_irradiance(toward[2], turbidity) if sun else np.zeros(3)
    on_ground = (light * (angles * np.maximum(around[..., 2], 0.0))[..., None]).sum(axis=(0, 1)) + beam * toward[2]
    light = np.where(above[..., None], light, albedo / np.pi * on_ground)
    if sun:
        disk = _disk(around, toward, np.pi / height) * above
        light += disk[..., None] * beam / (disk * angles).sum()
    return light.astype(np.float32)


def sky_radiance(directions: np.ndarray, toward: np.ndarray, turbidity: float) -> np.ndarray:
    """Of the sky without its sun, (..., 3): linear, Rec. 709; 1 is ``WHITE``.

    Args:
        directions: Unit vectors, (..., 3), +z up.
        toward: The unit vector to the sun.
        turbidity: From 2, clear, to 10, hazy.
    """
    t = np.array((turbidity, 1.0))
    a, b, c, d, e = np.moveaxis(PEREZ @ t, -1, 0)
    angle = math.acos(toward[2])
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * angle)
    brightness = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192  # [kcd/m^2]
    chroma = ZENITH @ angle ** np.arange(3, -1, -1) @ turbidity ** np.arange(2, -1, -1)

    def perez(cosine: Any, gamma: Any) -> Any:
        cosine, gamma = np.maximum(cosine, 1e-3)[..., None], np.asarray(gamma)[..., None]
        return (1.0 + a * np.exp(b / cosine)) * (1.0 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)

    gamma = np.arccos(np.clip(directions @ toward, -1.0, 1.0))
    share = perez(directions[..., 2], gamma) / perez(np.float64(1.0), angle)
    luminance, x, y = np.moveaxis(share * (brightness, *chroma), -1, 0)
    xyz = np.stack((luminance * x / y, luminance, luminance * (1.0 - x - y) / y), axis=-1)
    return np.maximum(xyz @ RGB_OF_XYZ.T, 0.0) / WHITE


def sun_irradiance(sine: float, turbidity: float) -> np.ndarray:
    """Of a surface that faces the sun, (3,), in units of ``WHITE`` times 1 sr; ``sine``: of the sun's elevation."""
    angle = math.degrees(math.acos(sine))
    mass = 1.0 / (sine + 0.15 * (93.885 - angle) ** -1.253)
    aerosols = 0.04608 * turbidity - 0.04586
    depth = 0.008735 * WAVELENGTHS**-4.08 + aerosols * WAVELENGTHS**-1.3
    return np.asarray(SUN_ILLUMINANCE / WHITE * np.exp(-depth * mass))


def _texels(height: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions of texels' middles, (height, 2 height, 3), and their solid angles, (height, 1) [sr]."""
    width = 2 * height
    longitude = 2.0 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)
    edges = np.pi * (0.5 - np.arange(height + 1) / height)
    latitude = 0.5 * (edges[:-1] + edges[1:])[:, None]
    flat = np.cos(latitude)
    parts = flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)
    around = np.stack([np.broadcast_to(part, (height, width)) for part in parts], axis=-1)
    return around, ((np.sin(edges[:-1]) - np.sin(edges[1:])) * 2.0 * np.pi / width)[:, None]


def _disk(around: np.ndarray, toward: np.ndarray, texel: float) -> np.ndarray:
    """How much of the sun each texel shows, (height, width): at its edge, over the width of a texel, ever less."""
    away = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(around - toward, axis=-1), 0.0, 1.0))
    return np.clip((SUN_RADIUS + texel - away) / texel, 0.0, 1.0)


def _direction(value: Any, where: str) -> np.ndarray:
    vector = as_numbers(value, where, "three numbers").astype(np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise WarpcamError(f"{where} must be three finite numbers, not all 0, got {value!r}")
    vector /= np.abs(vector).max()  # whose squares are neither too large nor too small
    vector /= np.linalg.norm(vector)
    if vector[2] < LOWEST_SUN:
        raise WarpcamError(f"{where} must be above the horizon, +z is up, got {value!r}")
    return vector


def _check(value: Any, where: str, lowest: float, highest: float) -> None:
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not is_number or not lowest <= value <= highest:
        raise WarpcamError(f"{where} must be a number from {lowest:g} to {highest:g}, got {value!r}")
