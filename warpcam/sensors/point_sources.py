"""What point clouds are made of: images of a renderer's cameras, or points that a user has."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.outputs import OUTPUTS
from warpcam.render.drawn_cameras import DrawnCamera
from warpcam.sensors.kernels.point_clouds import GIVEN_POINTS, ORTHOGRAPHIC_DEPTH, PINHOLE_DEPTH, PointSource

Positions = Literal["points", "depth"]
DEPTH_KINDS = {"pinhole": PINHOLE_DEPTH, "orthographic": ORTHOGRAPHIC_DEPTH}
DTYPES = {wp.uint8: "uint8", wp.int32: "int32", wp.float32: "float32"}


@dataclass(frozen=True, eq=False)
class Attribute:
    """Something that belongs to each pixel.

    Attributes:
        values: uint8, int32 or float32 (world, pixel, channel).
        rest: What a rest of zeros has instead.
    """

    values: wp.array
    rest: int = 0

    @property
    def is_scalar(self) -> bool:
        """True for one channel: clouds have (world, point) then."""
        return int(self.values.shape[2]) == 1


@dataclass(frozen=True, eq=False)
class PixelPoints:
    """Pixels of one camera, or a user's points.

    Attributes:
        where: Prefix of error messages about them.
        points: float32 (world, pixel, 3) [m], or of depth (world, pixel, 1) [m].
        attributes: By name.
        kind: How points are found: a kind of ``PointSource``.
        width: Of the image [pixels].
        views: View (world,), of depth.
        valid: uint8 (world, pixel): 0 leaves a pixel out; or None.
    """

    where: str
    points: wp.array
    attributes: Mapping[str, Attribute]
    kind: int = GIVEN_POINTS
    width: int = 1
    views: wp.array | None = None
    valid: wp.array | None = None
    kept: list[Any] = field(default_factory=list)  # arrays that the struct has by their addresses

    @property
    def num_pixels(self) -> int:
        return int(self.points.shape[1])

    def source(self, first_pixel: int, excluded: Mapping[str, np.ndarray]) -> Any:
        """The struct for kernels, without the ids ``excluded`` by name of the attribute."""
        source, device = PointSource(), self.points.device
        source.kind, source.points, source.width = self.kind, self.points, self.width
        source.num_pixels, source.first_pixel = self.num_pixels, first_pixel
        if self.views is not None:
            source.views = self.views
        if self.valid is not None:
            source.valid = self.valid
        addresses, sizes = [], []
        for name, ids in excluded.items():
            values = self.attributes[name].values
            if values.dtype is not wp.int32 or not self.attributes[name].is_scalar:
                raise WarpcamError(
                    f"{self.where}: exclude has {name!r}, which is {_told(values)} and no ids: int32 of one channel"
                )
            _check_contiguous(values, f"{self.where}: exclude: {name!r}")
            dropped = np.zeros(int(ids.max(initial=0)) + 1, np.uint8)
            dropped[ids] = 1
            table = wp.array(dropped, dtype=wp.uint8, device=device)
            self.kept.extend((table, values))
            addresses += [values.ptr, table.ptr]
            sizes.append(len(dropped))
        source.num_filters = len(sizes)
        source.filters = wp.array(np.array(addresses, np.uint64), dtype=wp.uint64, device=device)
        source.filter_sizes = wp.array(np.array(sizes, np.int32), dtype=wp.int32, device=device)
        return source


def of_camera(
    drawn: DrawnCamera, positions: Positions | None, images: Mapping[str, Any] | None, names: Sequence[str], where: str
) -> PixelPoints:
    """Pixels of a camera.

    Args:
        drawn: The camera.
        positions: The output that says where points are; see ``PointClouds``.
        images: In place of some of the camera's own: tensors or Warp arrays by output.
        names: Outputs that clouds have, or that ids are excluded of.
        where: Prefix of error messages.
    """
    camera = drawn.camera
    here = f"{where}: {camera.where}"
    if positions is not None and not (isinstance(positions, str) and positions in get_args(Positions)):
        raise WarpcamError(f'{where}: positions must be "points", "depth" or None, got {positions!r}')
    own: dict[str, wp.array] = dict(drawn.images)
    if not isinstance(images, Mapping | None):
        raise WarpcamError(f"{here}: images must be a dictionary of tensors by output, got {images!r}")
    given = dict({} if images is None else images)
    late = given.pop("frame_age", None) is not None
    for name, value in given.items():
        own[name] = _as_image(value, name, own, drawn, f"{here}: images: {name}")
    others = {name for name, image in own.items() if name not in drawn.images or image.ptr != drawn.images[name].ptr}
    measured = drawn.measured | others
    preferred = ("depth",) if "depth" in measured and "points" not in measured else get_args(Positions)
    if late and positions is None and set(get_args(Positions)) <= set(own):
        raise WarpcamError(
            f'{here}: its images arrive late: positions must be "points", true ones of when they were captured, or '
            '"depth", as it was measured, seen from the pose of now'
        )
    chosen = positions or next((name for name in preferred if name in own), None)
    if chosen not in own:
        wanted = repr(chosen) if chosen else "'points' or 'depth'"
        raise WarpcamError(f"{here}: outputs must have {wanted}, got {', '.join(own)}")
    if chosen == "depth" and drawn.projection not in DEPTH_KINDS:
        raise WarpcamError(
            f"{here}: its lens is a table of rays, along which planar depth finds no points; give it the output "
            '"points", and positions="points" if its depth is measured'
        )
    attributes = {}
    for name in names:
        if name not in own:
            raise WarpcamError(f"{here}: outputs must have {name!r}, got {', '.join(own)}")
        attributes[name] = Attribute(_flat(own[name]), -1 if OUTPUTS[name].miss == "-1" else 0)
    kind = GIVEN_POINTS if chosen == "points" else DEPTH_KINDS[drawn.projection]
    return PixelPoints(here, _flat(own[str(chosen)]), attributes, kind, camera.width, drawn.views)


def of_tensors(points: Any, valid: Any, attributes: Mapping[str, Any], where: str) -> PixelPoints:
    """A user's points (world, ..., 3), what is valid of them (world, ...), and what belongs to them."""
    device_rule.resolve()  # starts Warp, which a scene has not done here
    shape = _shape(points)
    array = None
    if len(shape) > 2 and shape[-1] == 3 and 0 not in shape:
        array = _merged(points, len(shape) - 1, f"{where}: points")
    if array is None or array.dtype is not wp.float32:
        raise WarpcamError(f"{where}: points must be float32 (world, ..., 3) on a device, got {_told(points)}")
    _check_contiguous(array, f"{where}: points")
    size = shape[:-1]
    mask = None
    if valid is not None:
        fits = _shape(valid) in (size, (*size, 1))
        mask = _merged(valid, len(size), f"{where}: valid") if fits else None
        if mask is None or mask.dtype not in (wp.bool, wp.uint8):
            raise WarpcamError(f"{where}: valid must be bool or uint8 {size}, got {_told(valid)}")
        _check_contiguous(mask, f"{where}: valid")
        device_rule.require_same(array.device, "points are", mask.device, f"{where}: valid")
        mask = (mask if mask.dtype is wp.uint8 else mask.view(wp.uint8)).reshape(mask.shape[:2])
    found = {}
    for name, value in attributes.items():
        shape = _shape(value)
        fits = shape[: len(size)] == size and 0 not in shape
        values = _merged(value, len(size), f"{where}: attributes: {name}") if fits else None
        if values is None or values.dtype not in DTYPES:
            allowed = ", ".join(DTYPES.values())
            shapes = f"{size} or {(*size, 'n')}"
            raise WarpcamError(f"{where}: attributes: {name} must be {shapes} of {allowed}, got {_told(value)}")
        device_rule.require_same(array.device, "points are", values.device, f"{where}: attributes: {name}")
        found[name] = Attribute(values)
    return PixelPoints(where, array, found, valid=mask)


def _shape(value: Any) -> tuple[int, ...]:
    """Shape of a tensor or a Warp array; () of anything else."""
    return tuple(value.shape) if torch_interop.is_tensor(value) or isinstance(value, wp.array) else ()


def _merged(value: Any, places: int, where: str) -> wp.array | None:
    """A tensor or Warp array (world, ..., channels) as (world, pixel, channel), in its own memory.

    ``places`` is the number of dimensions before the channels. Worlds may share memory, as an expanded tensor's do.
    None for dtypes and devices that Warp lacks.
    """
    shape = _shape(value)
    merged = (shape[0], math.prod(shape[1:places]), math.prod(shape[places:]))
    if isinstance(value, wp.array):
        _check_contiguous(value, where)
        return value.reshape(merged)
    try:
        return torch_interop.as_array(value.view(merged))
    except RuntimeError:
        raise WarpcamError(f"{where} must be contiguous, got strides {value.stride()}") from None


def _as_image(value: Any, name: str, own: Mapping[str, wp.array], drawn: DrawnCamera, where: str) -> wp.array:
    """An image that takes the place of a camera's own."""
    if name not in OUTPUTS:
        raise WarpcamError(f"{where} is no output; allowed are {', '.join(OUTPUTS)}")
    output, camera, views = OUTPUTS[name], drawn.camera, drawn.views
    shape = (views.shape[0], camera.height, camera.width, output.channels)
    array = torch_interop.as_array(value)
    if array is None or array.shape != shape or array.dtype is not output.dtype:
        raise WarpcamError(f"{where} must be {DTYPES[output.dtype]} {shape}, got {_told(value)}")
    _check_contiguous(array, where)
    device_rule.require_same(views.device, "the scene is", array.device, where)
    return array


def _flat(image: wp.array) -> wp.array:
    return image.reshape((image.shape[0], image.shape[1] * image.shape[2], image.shape[3]))


def _check_contiguous(array: wp.array, where: str) -> None:
    if not array.is_contiguous:
        raise WarpcamError(f"{where} must be contiguous, got strides {array.strides}")


def _told(value: Any) -> str:
    if isinstance(value, wp.array):
        return f"{value.dtype.__name__} {tuple(value.shape)}"
    return f"{str(value.dtype).removeprefix('torch.')} {_shape(value)}" if _shape(value) else type(value).__name__
