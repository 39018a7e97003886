"""Table of how much light the microfacets of a rough surface reflect at once: native/path/reflection.h."""

import functools

import numpy as np

CELLS = 32  # ALBEDO_CELLS of native/path/reflection.h
MIN_ROUGHNESS = 0.045  # of native/shading/ggx.h
DRAWN = (64, 32)  # facets for each cell: from the pole of the seen ones to their edge, and around half a circle


@functools.cache
def facet_albedo() -> np.ndarray:
    """Return the table, (CELLS + 1, CELLS, 2) float32.

    The rows are roots of cosines to the eye, from 0 to 1, the last one has means over all cosines, weighted by them;
    columns are roughnesses from 0 to 1. Light that arrives from everywhere is reflected as the first number times the
    reflectance at normal incidence, plus the second one times that at grazing incidence: Schlick's Fresnel term.

    Facets are GGX's, drawn as they are seen (Dupuy and Benyoub 2023) and weighted by the masking towards the light
    given that towards the eye (Heitz 2014).
    """
    table = np.zeros((CELLS + 1, CELLS, 2), np.float32)
    cosines = np.linspace(0.0, 1.0, CELLS, dtype=np.float32) ** 2
    for column, roughness in enumerate(np.linspace(0.0, 1.0, CELLS)):
        table[:CELLS, column] = _reflected(np.maximum(cosines, 1e-4), np.float32(max(roughness, MIN_ROUGHNESS) ** 4))
    table[CELLS] = _mean(table[:CELLS])
    return table


def _mean(rows: np.ndarray) -> np.ndarray:
    """The integral of 2 c E(c) over cosines c, with E between the rows as it is looked up: exactly, by Gauss's rule."""
    points, weights = np.polynomial.legendre.leggauss(3)
    total = np.zeros(rows.shape[1:])
    for on, weight in zip(0.5 * (points + 1.0), 0.5 * weights, strict=True):
        roots = ((np.arange(CELLS - 1) + on) / (CELLS - 1))[:, None, None]
        total += weight * (4.0 * roots**3 * ((1.0 - on) * rows[:-1] + on * rows[1:])).mean(axis=0)
    return total


def _reflected(cosines: np.ndarray, square: np.float32) -> np.ndarray:
    """Parts for cosines to the eye, (cosine, 2); ``square`` is that of alpha."""
    v, u = np.meshgrid(*((np.arange(count, dtype=np.float32) + 0.5) / count for count in DRAWN), indexing="ij")
    alpha, eye_z = np.sqrt(square), cosines[:, None, None]
    eye_x = np.sqrt(1.0 - eye_z**2)
    length = np.sqrt(square * eye_x**2 + eye_z**2)
    bent_x, bent_z = alpha * eye_x / length, eye_z / length
    z = (1.0 - v) * (1.0 + bent_z) - bent_z
    radius = np.sqrt(np.clip(1.0 - z**2, 0.0, 1.0))
    half = np.stack((alpha * (radius * np.cos(np.pi * u) + bent_x), alpha * radius * np.sin(np.pi * u)))
    half_z = np.maximum(z + bent_z, 0.0)
    norm = np.sqrt((half**2).sum(axis=0) + half_z**2)
    along = (eye_x * half[0] + eye_z * half_z) / norm
    light_z = 2.0 * along * half_z / norm - eye_z
    masked = light_z * np.sqrt(eye_z**2 * (1.0 - square) + square)
    with np.errstate(divide="ignore", invalid="ignore"):
        shadowed = eye_z * np.sqrt(light_z**2 * (1.0 - square) + square)
        weight = light_z * (eye_z + np.sqrt(eye_z**2 * (1.0 - square) + square)) / (masked + shadowed)
    weight = np.where(light_z > 0.0, weight, 0.0)
    grazing = np.clip(1.0 - along, 0.0, 1.0) ** 5
    return np.stack((weight * (1.0 - grazing), weight * grazing), axis=-1).mean(axis=(1, 2))
