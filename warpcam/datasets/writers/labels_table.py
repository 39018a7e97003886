"""Labels of a frame as plain values, for formats that have no scheme of their own."""

from typing import Any

import numpy as np

from warpcam.datasets.generate.frames import Frame


def as_json(frame: Frame) -> dict[str, Any]:
    """A frame's labels for JSON: boxes in pixels, poses in the camera's frame (x right, y up, z backward) [m].

    Numbers that are not finite are None.
    """
    return {
        "sample": frame.sample,
        "camera": frame.camera,
        "intrinsics": frame.intrinsics,
        "camera_position": _numbers(frame.camera_position),
        "camera_rotation": _numbers(frame.camera_rotation),
        "instances": [
            {
                "id": each.id,
                "name": each.name,
                "class": frame.classes[each.category],
                "category": each.category,
                "visible_box": each.visible_box,
                "visible_pixels": each.visible_pixels,
                "amodal_box": each.amodal_box,
                "amodal_pixels": each.amodal_pixels,
                "visibility": each.visibility,
                "truncated": each.truncated,
                "position": _numbers(each.position),
                "rotation": _numbers(each.rotation),
                "box_center": _numbers(each.box_center),
                "half_extents": _numbers(each.half_extents),
                "corners": _numbers(each.corners),
                "depth": _numbers(np.float64(each.depth)),
                "keypoints": _numbers(each.keypoints),
            }
            for each in frame.instances
        ],
    }


def _numbers(values: Any) -> Any:
    """Nested lists, None in place of what is not finite."""
    if np.ndim(values):
        return [_numbers(each) for each in values]
    return float(values) if np.isfinite(values) else None
