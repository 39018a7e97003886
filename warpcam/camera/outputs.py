"""Outputs that a camera can be asked for, as data."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.types import HEIGHT_FIELD, MESH


@dataclass(frozen=True)
class Output:
    """One kind of image, (world, height, width, channels).

    Attributes:
        dtype: Of its array.
        channels: Length of the last dimension.
        miss: What a pixel shows where nothing is hit, in words.
        trace: The array of the trace it is, or None where it is made of depth and shape in a second pass.
        face: Whether it is derived from the face that was hit, too.
        lit: Whether shadows change it.
        analytic: Whether the trace writes it nevertheless where a scene has neither meshes nor height fields: then it
            is the trace's array of the same name.
    """

    dtype: Any
    channels: int
    miss: str
    trace: str | None = None
    face: bool = False
    lit: bool = False
    analytic: bool = False


OUTPUTS: Mapping[str, Output] = {
    "rgb": Output(wp.uint8, 3, "background", face=True, lit=True),
    "rgba": Output(wp.uint8, 4, "background with alpha 0", face=True, lit=True),
    "hdr": Output(wp.float32, 3, "background", face=True, lit=True),
    "depth": Output(wp.float32, 1, "inf, or what depth_clipping says", trace="depth"),
    "distance": Output(wp.float32, 1, "inf", trace="distance"),
    "normals": Output(wp.float32, 3, "0", face=True, analytic=True),
    "points": Output(wp.float32, 3, "inf", trace="points"),
    "segmentation": Output(wp.int32, 1, "-1", trace="shape"),
    "bodies": Output(wp.int32, 1, "-1", trace="bodies"),
    "instances": Output(wp.int32, 1, "-1", trace="instances"),
    "semantics": Output(wp.int32, 1, "0", trace="semantics"),
    "flow": Output(wp.float32, 2, "0", trace="flow"),
    "flow_valid": Output(wp.uint8, 1, "0", trace="flow_valid"),
    "albedo": Output(wp.uint8, 3, "0", face=True),
}


def smooth_outputs(names: Sequence[str], antialiasing: int) -> list[str]:
    """Return the outputs whose edges are smoothed."""
    return [name for name in names if OUTPUTS[name].lit] if antialiasing > 1 else []


def traced_as(name: str, shape_types: Collection[int]) -> str | None:
    """The array of the trace that an output is in a scene of these types of shapes; None if a second pass makes it."""
    output = OUTPUTS[name]
    if output.analytic and not {MESH, HEIGHT_FIELD} & set(shape_types):
        return name
    return output.trace


def check_outputs(names: Any, where: str) -> tuple[str, ...]:
    """The names in the order given, or the error that lists what there is."""
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise WarpcamError(f'{where}: outputs must be a sequence of names like ("rgb", "depth"), got {names!r}')
    if not names:
        raise WarpcamError(f"{where}: outputs is empty; allowed are {', '.join(OUTPUTS)}")
    for name in names:
        if not isinstance(name, str) or name not in OUTPUTS:
            raise WarpcamError(f"{where}: outputs has {name!r}; allowed are {', '.join(OUTPUTS)}")
    if len(set(names)) < len(names):
        raise WarpcamError(f"{where}: outputs names something twice: {list(names)!r}")
    return tuple(names)
