"""The lens of an Isaac Lab camera, from its ``spawn``."""

from typing import Any

import numpy as np

import warpcam as wc
from warpcam.core.errors import WarpcamError

RADIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # OpenCV's order
BASES = "abcdef"  # of fisheye_polynomial_*


def lens_of(spawn: Any, width: int, height: int) -> wc.Lens:
    """The lens of an image of that size [pixels]; a pinhole's numbers come with the camera's intrinsics.

    Args:
        spawn: CameraCfg.spawn, or None.
        width: Of the image.
        height: Of the image.

    Raises:
        WarpcamError: ``spawn`` asks for another projection.
    """
    distortion = getattr(spawn, "distortion", None)
    if distortion is not None:
        return _calibrated(distortion, width, height)
    projection = getattr(spawn, "projection_type", "pinhole")
    if projection == "pinhole":
        return wc.Pinhole(fx=1.0)
    if projection == "fisheyePolynomial":
        return _polynomial(spawn, width, height)
    raise WarpcamError(
        f"CameraCfg.spawn.projection_type is {projection!r}; allowed are 'pinhole' and 'fisheyePolynomial', and "
        "CameraCfg.spawn.distortion"
    )


def unread_lens(prim: Any, spawn: Any) -> str | None:
    """Return the name of a lens attribute of the camera's prim that ``lens_of`` does not read, or None.

    Args:
        prim: Of USD, or None.
        spawn: CameraCfg.spawn, or None, with which the prim was there before.
    """
    if not prim or getattr(spawn, "distortion", None) is not None:
        return None
    names = ("omni:lensdistortion:model", *(["cameraProjectionType"] if spawn is None else []))
    authored = [attribute.Get() for name in names if (attribute := prim.GetAttribute(name))]
    schemas = prim.GetMetadata("apiSchemas")
    authored += [name for name in (schemas.GetAppliedItems() if schemas else ()) if "LensDistortion" in name]
    return next((str(value) for value in authored if value and value != "pinhole"), None)


def _calibrated(distortion: Any, width: int, height: int) -> wc.Lens:
    """Return the calibrated lens as Isaac Lab's Newton renderer has it.

    It stretches pixels of the calibrated image to this one.
    """
    size = distortion.image_size
    if not (size[0] > 0 and size[1] > 0):
        raise WarpcamError(f"CameraCfg.spawn.distortion.image_size must be positive, got {tuple(size)}")
    across, down = width / float(size[0]), height / float(size[1])
    pixels = {
        "fx": across * float(distortion.fx),
        "fy": down * float(distortion.fy),
        "cx": across * float(distortion.cx),
        "cy": down * float(distortion.cy),
    }
    share = 1.0 if distortion.apply_lens_distortion else 0.0
    if distortion.model == "opencvFisheye":
        k = [share * float(getattr(distortion, name)) for name in ("k1", "k2", "k3", "k4")]
        return wc.Fisheye(**pixels, k=k, max_fov=min(float(np.degrees(distortion.max_fov)), 360.0))
    if distortion.model == "opencvPinhole":
        return wc.Distorted(**pixels, coefficients=[share * float(getattr(distortion, name)) for name in RADIAL])
    raise WarpcamError(
        f"CameraCfg.spawn.distortion.model is {distortion.model!r}; allowed are 'opencvPinhole' and 'opencvFisheye'"
    )


def _polynomial(spawn: Any, width: int, height: int) -> wc.FTheta:
    """The angle from the axis [rad] is a polynomial of the distance from the optical centre, in nominal pixels."""
    across = width / float(spawn.fisheye_nominal_width)
    down = height / float(spawn.fisheye_nominal_height)
    polynomial = [float(getattr(spawn, f"fisheye_polynomial_{base}")) for base in BASES]
    return wc.FTheta(
        backward=[each / down**power for power, each in enumerate(polynomial)],
        cx=across * float(spawn.fisheye_optical_centre_x),
        cy=down * float(spawn.fisheye_optical_centre_y),
        linear=(across / down, 0.0, 0.0),
        max_fov=min(float(spawn.fisheye_max_fov), 360.0),
    )
