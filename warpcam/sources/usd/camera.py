"""Cameras of a stage."""

import math

from pxr import Usd, UsdGeom

from warpcam.sources.common.scene_graph import CameraNode
from warpcam.sources.usd.attributes import AttributeReader


def read_camera(
    prim: Usd.Prim, node: int, name: str, time: Usd.TimeCode, unit: float, attributes: AttributeReader
) -> CameraNode:
    """The camera at a time.

    Focal length, apertures and offsets are all in tenths of a stage unit, so that only their ratios matter, but for an
    orthographic camera, whose aperture is what it sees. Pixels are square: the vertical aperture says nothing.
    """
    clipping = None
    if prim.GetAttribute("clippingRange").HasAuthoredValue():
        near, far = (float(depth) * unit for depth in attributes.get(prim, "clippingRange", time, finite=False))
        if 0.0 <= near < far:
            clipping = (near, far)
        else:
            attributes.tell(prim, "has an empty clippingRange, which is left out")
    width = attributes.get(prim, "horizontalAperture", time)
    orthographic = attributes.get(prim, "projection", time) == UsdGeom.Tokens.orthographic
    focal = 10.0 / unit if orthographic else attributes.get(prim, "focalLength", time)
    if not width > 0.0 or not focal > 0.0:
        what = "focalLength" if width > 0.0 else "horizontalAperture"
        attributes.tell(prim, f"has a {what} that is not positive, and makes no image")
        width = math.nan
    offsets = [attributes.get(prim, f"{axis}ApertureOffset", time) / width for axis in ("horizontal", "vertical")]
    return CameraNode(
        name=name,
        node=node,
        projection="orthographic" if orthographic else "pinhole",
        focal=focal / width,
        offset=(offsets[0], offsets[1]),
        clipping=clipping,
    )
