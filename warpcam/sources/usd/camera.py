"""Cameras of a stage."""

import math

from pxr import Usd, UsdGeom

from warpcam.sources.common.scene_graph import CameraNode


def read_camera(camera: UsdGeom.Camera, node: int, name: str, time: Usd.TimeCode, unit: float) -> CameraNode:
    """The camera at a time.

    Focal length, apertures and offsets are all in tenths of a stage unit, so that only their ratios matter, but for an
    orthographic camera, whose aperture is what it sees. Pixels are square: the vertical aperture says nothing.
    """
    near, far = (float(depth) * unit for depth in camera.GetClippingRangeAttr().Get(time))
    clipping = None
    if camera.GetClippingRangeAttr().HasAuthoredValue() and 0.0 <= near < far:
        clipping = (near, far)
    width = float(camera.GetHorizontalApertureAttr().Get(time)) or math.nan  # of nothing there is no image
    orthographic = camera.GetProjectionAttr().Get(time) == UsdGeom.Tokens.orthographic
    return CameraNode(
        name=name,
        node=node,
        projection="orthographic" if orthographic else "pinhole",
        focal=(10.0 / unit if orthographic else float(camera.GetFocalLengthAttr().Get(time))) / width,
        offset=(
            float(camera.GetHorizontalApertureOffsetAttr().Get(time)) / width,
            float(camera.GetVerticalApertureOffsetAttr().Get(time)) / width,
        ),
        clipping=clipping,
    )
