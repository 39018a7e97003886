"""Outputs that a camera can be asked for, as data."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.kernels.types import HEIGHT_FIELD, MESH


@dataclass(frozen=True)
class Output:
    """One kind of image, (world, height, width, channels).

    Attributes:
        dtype: Of its array.
        channels: Length of the last dimension.
        miss: What a pixel shows where nothing is hit, in words.
        picture: How people look at it, a function of ``warpcam.visualize``.
        trace: The array of the trace it is, or None where the pass that has registered for it derives it from depth,
            shape and face.
        span: Lowest and highest value, if not all that the dtype has.
        lit: Whether shadows change it.
        analytic: Whether the trace writes it nevertheless where a scene has neither meshes nor height fields: then it
            is the trace's array of the same name.
    """

    dtype: Any
    channels: int
    miss: str
    picture: str
    trace: str | None = None
    span: tuple[float, float] | None = None
    lit: bool = False
    analytic: bool = False


UNBOUND = (0.0, math.inf)  # of lengths and of light

OUTPUTS: Mapping[str, Output] = {
    "rgb": Output(wp.uint8, 3, "background", "colors", lit=True),
    "rgba": Output(wp.uint8, 4, "background with alpha 0", "colors", lit=True),
    "hdr": Output(wp.float32, 3, "background", "radiance", span=UNBOUND, lit=True),
    "depth": Output(wp.float32, 1, "inf, or what depth_clipping says", "lengths", trace="depth", span=UNBOUND),
    "distance": Output(wp.float32, 1, "inf", "lengths", trace="distance", span=UNBOUND),
    "normals": Output(wp.float32, 3, "0", "directions", span=(-1.0, 1.0), analytic=True),
    "points": Output(wp.float32, 3, "inf", "points", trace="points"),
    "segmentation": Output(wp.int32, 1, "-1", "ids", trace="shape"),
    "bodies": Output(wp.int32, 1, "-1", "ids", trace="bodies"),
    "instances": Output(wp.int32, 1, "-1", "ids", trace="instances"),
    "semantics": Output(wp.int32, 1, "0", "labels", trace="semantics"),
    "flow": Output(wp.float32, 2, "0", "flow", trace="flow"),
    "flow_valid": Output(wp.uint8, 1, "0", "flags", trace="flow_valid", span=(0, 1)),
    "albedo": Output(wp.uint8, 3, "0", "colors"),
    "barycentrics": Output(wp.float32, 2, "0", "weights", span=(0.0, 1.0)),
    "faces": Output(wp.int32, 1, "-1", "ids"),
}


def traced_as(name: str, shape_types: Collection[int]) -> str | None:
    """The array of the trace that an output is in a scene of these types of shapes; None if a later pass makes it."""
    output = OUTPUTS[name]
    if output.analytic and not {MESH, HEIGHT_FIELD} & set(shape_types):
        return name
    return output.trace


def lit_outputs(names: Iterable[str]) -> tuple[str, ...]:
    """Those of the outputs that show light."""
    return tuple(name for name in names if OUTPUTS[name].lit)
