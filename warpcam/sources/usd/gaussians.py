"""Gaussian splats of a stage."""

import numpy as np
from pxr import Usd

from warpcam.accel.gaussians import GaussianCloud
from warpcam.sources.common.gaussian_cloud import MIN_RESPONSE, CloudGeometry, colors_of
from warpcam.sources.usd.attributes import AttributeReader

KIND = "ParticleField3DGaussianSplat"
HARMONICS = "radiance:sphericalHarmonicsCoefficients"


def read_splats(prim: Usd.Prim, time: Usd.TimeCode, attributes: AttributeReader) -> CloudGeometry | None:
    """The prim's cloud; None if its arrays do not fit each other, or there are no positions."""

    def array(name: str) -> np.ndarray | None:
        """An attribute, or its twin of half precision."""
        for candidate in (name, f"{name}h"):
            value: np.ndarray | None = attributes.get(prim, candidate, time)
            if value is not None and len(value):
                return value
        return None

    positions = array("positions")
    if positions is None or len(positions) == 0:
        return None
    count = len(positions)
    rotations = _or(array("orientations"), np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))  # x y z w
    scales = _or(array("scales"), np.ones((count, 3)))
    opacities = _or(array("opacities"), np.ones(count))
    harmonics = _or(array(HARMONICS), np.zeros((count, 3)))
    if any(len(array) != count for array in (rotations, scales, opacities)) or len(harmonics) % count:
        return None
    spaces = [prim.GetAttribute(name).GetColorSpace() for name in (HARMONICS, f"{HARMONICS}h")]
    kept = max(coefficients for coefficients in (1, 4, 9, 16) if coefficients <= len(harmonics) // count)
    cloud = GaussianCloud(
        name=str(prim.GetPath()),
        positions=positions.astype(np.float32),
        rotations=rotations[:, [3, 0, 1, 2]].astype(np.float32),
        scales=scales.astype(np.float32),
        opacities=opacities.astype(np.float32),
        least_response=MIN_RESPONSE,
        **colors_of(harmonics.reshape(count, -1, 3)[:, :kept], any(s.startswith("lin_") for s in spaces if s)),
    )
    return CloudGeometry(cloud)


def _or(array: np.ndarray | None, default: np.ndarray) -> np.ndarray:
    return default if array is None else array
