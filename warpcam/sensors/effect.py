"""Effects of a sensor: the steps from a rendered image to a measured one, and the parameters that they have."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.arrays import as_numbers, per_world
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.indices import COLOR_STRIP, strips_of
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.kernels.color_images import color_source, color_target
from warpcam.sensors.kernels.random import Randomness

Kind = Literal["depth", "linear", "display", "delivery"]


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    low: float = -np.inf,
    high: float = np.inf,
    width: tuple[int | None, ...] = (),
) -> Any:
    """Declare a field of an effect that is a number, or a row of numbers, in each world.

    Args:
        default: What it is unless given; nothing makes it an argument that must be given. With None the effect does
            without, and has no such parameter then.
        low: Lowest value allowed.
        high: Highest value allowed.
        width: Shape of an entry; () is a number. None in it is as many as the user gives.
    """
    return field(default=default, metadata={"low": low, "high": high, "width": width})


class Effect:
    """One step from a rendered image to a measured one.

    Subclasses are dataclasses, frozen and without comparison (``@dataclass(frozen=True, eq=False)``). A field that is
    declared by ``parameter`` takes a number for all worlds or numbers for each, (world, *width): numpy, torch or Warp.
    A float32 tensor for each world on the scene's device is used where it lies, so that what is written to it later
    counts; ``Rig.parameters`` has a tensor for each parameter, however it was given.

    Attributes:
        kind: Image that it changes: "depth" [m]; "linear", colours in linear light, white is 1; "display", colours as
            a display takes them, from 0 to 1; "delivery", all images, after all other effects. Effects on linear light
            come before those on display colours.
        reads: Outputs of the camera that it needs beside the image that it changes.
        in_place: It reads the pixel that it writes and no other of the image, so one image can be both.
        encodes: It takes linear light and gives display colours, in place of the sRGB curve.
        takes_light: An effect on display colours that encodes linear light itself, by the sRGB curve, where
            ``EffectFrame.is_linear`` is true; others get display colours.
        reads_bytes: An effect on colours that reads ``EffectFrame.color_source``, which has the renderer's bytes if it
            is the first; others get linear light of them.
        writes_bytes: An effect on colours that writes ``EffectFrame.color_target``, which has the bytes of the result
            if it is the last. One that reads bytes, too, takes light through the sRGB curve there where display values
            are to follow. Colours of others go through a pass of their own.
        starts_with_bytes: An effect that reads bytes and makes bytes of numbers first: the one before it writes bytes
            where it can.
        needs_pinhole: It reads focal length or rays from ``EffectFrame.views``, which only a pinhole lens has there.
        timed: It needs the simulation's time.
        least_size: Width and height that images must have at least [pixels].
    """

    kind: ClassVar[Kind]
    reads: ClassVar[tuple[str, ...]] = ()
    in_place: ClassVar[bool] = True
    encodes: ClassVar[bool] = False
    takes_light: ClassVar[bool] = False
    reads_bytes: ClassVar[bool] = False
    writes_bytes: ClassVar[bool] = False
    starts_with_bytes: ClassVar[bool] = False
    needs_pinhole: ClassVar[bool] = False
    timed: ClassVar[bool] = False
    least_size: ClassVar[int] = 1

    def check(self, where: str) -> None:
        """Raise a WarpcamError for settings that are no parameters and not allowed; ``where`` begins the message."""

    def bind(self, frame: "EffectFrame") -> Sequence[Stage]:
        """Bind the stages that write ``frame.target`` from ``frame.source``, in their order."""
        raise NotImplementedError


@dataclass(frozen=True)
class EffectFrame:
    """Arrays of one camera for one effect, of some worlds one after another.

    Attributes:
        source: The image before: (world, pixel) float32 or vec3, pixels row by row from the top; perhaps
            (world, pixel, channel) uint8 of an effect that reads bytes.
        target: The image after, likewise; ``source`` itself where the effect is in place and not the first.
        truth: Outputs by name as they were rendered, (world, height, width, channels), also those of a stereo camera;
            but "depth" is infinite where nothing is hit, whatever the camera's ``depth_clipping``.
        views: (world,) ``View``: pose and lens as the trace had them.
        times: (world,) float32: the simulation's time [s]; NaN where it keeps none.
        elapsed: (world,) float32: time since the frame of the world before [s]; NaN where it is not known.
        renders: (world,) int32: how many frames the renderer has drawn of the world, this one among them, whoever asked
            for them.
        mask: (world,) uint8; worlds with 0 are left alone.
        params: The effect's parameters as attributes: (world,) float32, or (world, n) for rows.
        randomness: Random numbers of this effect.
        width: Of the image [pixels].
        height: Of the image [pixels].
        device: Where all arrays lie.
        memory: Arrays of the effect that last from frame to frame: ``keep``.
        worlds: Which worlds of the scene the arrays have.
        pinhole: Rays of pixels follow from ``views``, from one point.
        is_linear: Colours of ``source`` are linear light.
        gives_light: Colours that the effect gives are linear light.
        through_srgb: ``color_target`` takes numbers through the sRGB curve.
    """

    source: wp.array
    target: wp.array
    truth: Mapping[str, wp.array]
    views: wp.array
    times: wp.array
    elapsed: wp.array
    renders: wp.array
    mask: wp.array
    params: SimpleNamespace
    randomness: Randomness
    width: int
    height: int
    device: wp.Device
    memory: dict[str, wp.array]
    worlds: range
    pinhole: bool = False
    is_linear: bool = False
    gives_light: bool = False
    through_srgb: bool = False

    @property
    def color_source(self) -> Any:
        """``source`` as a ``ColorSource``."""
        return color_source(self.source)

    @property
    def color_target(self) -> Any:
        """``target`` as a ``ColorTarget``; an alpha is that of the truth."""
        return color_target(self.target, self.truth, self.gives_light, self.through_srgb)

    @property
    def size(self) -> wp.vec2i:
        """Width and height of the image [pixels]."""
        return wp.vec2i(self.width, self.height)

    def per_pixel(self, kernel: wp.Kernel, inputs: Sequence[Any]) -> Stage:
        """Bind a kernel with a thread for each pixel of each world; the index of a thread is world * pixels + pixel."""
        return bind_launch(kernel, len(self.worlds) * self.width * self.height, inputs, self.device)

    def per_strip(self, kernel: wp.Kernel, inputs: Sequence[Any]) -> Stage:
        """Bind a kernel with a thread for each strip of each world, which ``strip_of`` finds for the thread's index."""
        return bind_launch(kernel, len(self.worlds) * strips_of(self.width, self.height), inputs, self.device)

    def per_color_strip(self, kernel: wp.Kernel, parameters: Sequence[Any]) -> Stage:
        """Bind a kernel of mask, size, parameters, ``ColorSource`` and ``ColorTarget``, by ``color_strip_of``."""
        strips = strips_of(self.width, self.height, COLOR_STRIP)
        inputs = [self.mask, self.size, *parameters, self.color_source, self.color_target]
        return bind_launch(kernel, len(self.worlds) * strips, inputs, self.device)

    def per_world(self, kernel: wp.Kernel, inputs: Sequence[Any]) -> Stage:
        """Bind a kernel with a thread for each world."""
        return bind_launch(kernel, len(self.worlds), inputs, self.device)

    def keep(self, name: str, width: tuple[int, ...], dtype: Any = wp.float32) -> wp.array:
        """Memory (world, *width) that is 0 at first and after a reset of the world.

        Raises:
            WarpcamError: The dtype has not 4 bytes or a multiple of it.
        """
        if wp.types.type_size_in_bytes(dtype) % 4:
            raise WarpcamError(f"EffectFrame.keep: dtype of {name!r} must have 4 bytes or a multiple, got {dtype!r}")
        if name not in self.memory:
            self.memory[name] = wp.zeros((len(self.worlds), *width), dtype=dtype, device=self.device)
        return self.memory[name]


def parameters_of(effect: object) -> Iterator[dataclasses.Field[Any]]:
    """Fields of an effect, or of another dataclass, that have a value for each world."""
    for entry in dataclasses.fields(effect):  # type: ignore[arg-type]
        is_left_out = entry.default is None and getattr(effect, entry.name) is None
        if "width" in entry.metadata and not is_left_out:
            yield entry


def side_by_side(effect: object, where: str, *names: str) -> list[np.ndarray]:
    """Numbers of some parameters in one shape, to be compared as they are when an effect is bound.

    Empty arrays where shapes do not go together, which ``parameter_array`` tells.
    """
    numbers = [as_numbers(getattr(effect, name), f"{where}: {name}") for name in names]
    try:
        return list(np.broadcast_arrays(*numbers))
    except ValueError:
        return [np.zeros(0)] * len(names)


def parameter_array(
    effect: object, entry: dataclasses.Field[Any], where: str, num_worlds: int, device: Any
) -> wp.array:
    """The values of a parameter for all worlds, (world, *width) float32, in the user's own memory where possible.

    Raises:
        WarpcamError: They are of another shape, not finite, or outside of what is allowed.
    """
    where = f"{where}: {type(effect).__name__}: {entry.name}"
    return world_numbers(getattr(effect, entry.name), where, entry.metadata, num_worlds, device)


def world_numbers(value: Any, where: str, limits: Mapping[str, Any], num_worlds: int, device: Any) -> wp.array:
    """Numbers of all worlds, (world, *width) float32, in the user's own memory where possible.

    Args:
        value: What the user gave.
        where: Prefix of error messages.
        limits: "low", "high" and "width", as of ``parameter``.
        num_worlds: How many worlds there are.
        device: Of the scene.

    Raises:
        WarpcamError: They are of another shape, not finite, or outside of what is allowed; or a tensor that would be
            used where it lies is on another device or not contiguous.
    """
    width = limits["width"]
    if None in width:
        given_width = as_numbers(value, where).shape[-len(width) :]
        width = tuple(b if a is None else a for a, b in zip(width, given_width, strict=True))
    numbers = per_world(value, where, num_worlds, width)
    outside = numbers[(numbers < limits["low"]) | (numbers > limits["high"])]
    if outside.size:
        raise WarpcamError(f"{where} must be from {limits['low']:g} to {limits['high']:g}, got {outside[0]:g}")
    given = torch_interop.as_array(value)
    if given is None or given.dtype is not wp.float32 or given.shape != numbers.shape:
        return wp.array(numbers, dtype=wp.float32, device=device)
    device_rule.require_same(device, "the scene is", given.device, where)
    strides = np.empty(given.shape, np.float32).strides
    if any(a != b for a, b, size in zip(given.strides, strides, given.shape, strict=True) if size > 1):
        # A copy would not have what is written later.
        raise WarpcamError(f"{where} must be contiguous, got strides of {given.strides} bytes; give a copy of it")
    return given if given.is_contiguous else shared(given, given.shape, wp.float32)


def names_of(effects: Sequence[Effect]) -> list[str]:
    """Names of effects in an attribute: that of the class in small letters, numbered from the second of a class on."""
    names: list[str] = []
    for effect in effects:
        words = type(effect).__name__
        base = "".join(f"_{c.lower()}" if c.isupper() and k else c.lower() for k, c in enumerate(words))
        count = sum(1 for other in effects[: len(names)] if type(other) is type(effect))
        names.append(f"{base}_{count + 1}" if count else base)
    return names
