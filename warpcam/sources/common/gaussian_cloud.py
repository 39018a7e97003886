"""Clouds of Gaussians from files, in frames of their own."""

from dataclasses import replace
from typing import Any

import numpy as np

from warpcam.accel.gaussians import GaussianCloud
from warpcam.core.color import encoded_beyond
from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_matrices, rotation_quaternions
from warpcam.kernels.types import SPLATS
from warpcam.sources.common.geometry import SAME, RenderShape, polar

BASE = 0.28209479177387814  # the spherical harmonic of degree 0, 1 / (2 sqrt(pi))
# Where Gaussians of files end, which say nothing of it: as in "3D Gaussian Ray Tracing", three standard deviations.
MIN_RESPONSE = 0.0113
REST_FIELDS = (0, 9, 24, 45)  # columns of coefficients beyond the first, by degree
PLY_FIELDS = ("opacity", *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4)))


class CloudGeometry:
    """A cloud under linear maps: stretched along its axes by the shape's size, baked under others."""

    def __init__(self, cloud: GaussianCloud):
        self.name, self.cloud = cloud.name, cloud
        self._baked: dict[bytes, GaussianCloud] = {}

    def transformed(self, linear: np.ndarray) -> RenderShape | None:
        if np.linalg.matrix_rank(linear) < 3:
            return None
        rotation, stretch = polar(linear)
        along = np.diag(stretch)
        if np.abs(stretch - np.diag(along)).max() <= SAME * np.abs(stretch).max():
            return RenderShape(SPLATS, rotation, along, cloud=self.cloud)
        scale = np.abs(stretch).max()
        key = (np.rint(np.append(stretch / scale, np.log(scale)) / SAME) + 0.0).tobytes()
        if key not in self._baked:
            self._baked[key] = _stretched(self.cloud, stretch)
        return RenderShape(SPLATS, rotation, np.ones(3), cloud=self._baked[key])


def display_colors(harmonics: np.ndarray, linear: bool = False) -> np.ndarray:
    """Display colours (n, 3) float32 of coefficients of degree 0."""
    colors = np.maximum(BASE * harmonics.astype(np.float64) + 0.5, 0.0)
    if linear:
        colors = encoded_beyond(colors)
    return colors.astype(np.float32)


def colors_of(harmonics: np.ndarray, linear: bool = False) -> dict[str, Any]:
    """The attributes of a ``GaussianCloud`` that are its colours.

    Args:
        harmonics: (gaussian, coefficient, 3), 1, 4, 9 or 16 coefficients by degree.
        linear: Whether they give linear light.
    """
    if harmonics.shape[1] == 1:
        return {"colors": display_colors(harmonics[:, 0], linear)}
    constant = BASE * harmonics[:, 0].astype(np.float64) + 0.5
    return {
        "colors": constant.astype(np.float32),
        "harmonics": harmonics[:, 1:].astype(np.float32),
        "linear": linear,
    }


def cloud_of_ply(name: str, vertices: Any) -> GaussianCloud | None:
    """The cloud in the vertices of a PLY file, as training of splats writes it; None if it is none.

    They are a structured array, or columns by name where the file is text. Scales are logarithms and opacities logits.

    Raises:
        WarpcamError: A column of the cloud has something else than one number for each vertex, or the number of the
            colours' columns is that of no degree.
    """
    names = vertices if isinstance(vertices, dict) else getattr(vertices, "dtype", np.dtype(float)).names or ()
    if not all(field in names for field in (*PLY_FIELDS, "f_dc_0", "f_dc_1", "f_dc_2")):
        return None

    def columns(*fields: str) -> np.ndarray:
        try:
            return np.stack([np.asarray(vertices[field], np.float64).reshape(-1) for field in fields], axis=1)
        except (TypeError, ValueError):
            listed = ", ".join(fields)
            raise WarpcamError(f"{name}: {listed} of its splats must be one number for each vertex") from None

    rest = sum(str(field).startswith("f_rest_") for field in names)
    if rest not in REST_FIELDS:
        raise WarpcamError(
            f"{name}: its splats have {rest} columns f_rest; allowed are 0, 9, 24 and 45: degrees 0 to 3"
        )
    harmonics = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if rest:  # all of red, then all of green, then all of blue
        more = columns(*(f"f_rest_{k}" for k in range(rest))).reshape(-1, 3, rest // 3)
        harmonics = np.concatenate((harmonics, more.transpose(0, 2, 1)), axis=1)
    with np.errstate(over="ignore"):
        return GaussianCloud(
            name=name,
            positions=columns("x", "y", "z").astype(np.float32),
            rotations=columns(*PLY_FIELDS[4:]).astype(np.float32),
            scales=np.exp(columns(*PLY_FIELDS[1:4])).astype(np.float32),
            opacities=(1.0 / (1.0 + np.exp(-columns("opacity")[:, 0]))).astype(np.float32),
            least_response=MIN_RESPONSE,
            **colors_of(harmonics),
        )


def _stretched(cloud: GaussianCloud, stretch: np.ndarray) -> GaussianCloud:
    """Every Gaussian under a symmetric map of its own: its covariance, and new axes for it."""
    axes = rotation_matrices(cloud.rotations.astype(np.float64))
    u, sizes, _ = np.linalg.svd(stretch @ (axes * cloud.scales[:, None, :]))
    u[np.linalg.det(u) < 0.0] *= -1.0
    return replace(
        cloud,
        positions=(cloud.positions @ stretch.T).astype(np.float32),
        rotations=rotation_quaternions(u).astype(np.float32),
        scales=sizes.astype(np.float32),
    )
