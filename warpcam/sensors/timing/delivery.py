"""Delivery of a camera's frames: rate, latency, jitter, and frames that are lost."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.device import free_bytes
from warpcam.core.errors import OutOfMemoryError, WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels import delivery as kernels

Images = Mapping[str, wp.array]
DISTRIBUTIONS = {"normal": kernels.NORMAL, "uniform": kernels.UNIFORM, "exponential": kernels.EXPONENTIAL}
REACH = {"normal": 3.0, "uniform": 1.0, "exponential": 3.0}  # how many times the jitter is reckoned with
ARRAYS = {  # DeliveryState
    "started": wp.int32,
    "last": wp.float32,
    "period": wp.int32,
    "epoch": wp.int32,
    "deviation": wp.float32,
    "shown": wp.float32,
}


@dataclass(frozen=True, eq=False)
class Delivery(Effect):
    """Frame rate, latency and losses of all images of a camera; the last of its effects.

    A read captures a world's frame if a period of the camera began since its last one: periods begin at the times
    (k + phase) / rate of the simulation. The frame arrives ``latency`` + ``jitter`` x later, where x is drawn, and no
    earlier than it was captured. A read shows the newest frame that has arrived. A frame that arrives after a newer
    one is never shown.

    The first frame of a world, and the first after a reset or after a clock that went back, is shown at once.

    Times are rounded to float32 by simulators, so a frame may be captured a hundredth of a period early.

    Attributes:
        rate: Frames per second of the simulation [Hz]; 0 captures a frame at every read. A number or (world,).
        phase: Share of a period by which frames are late, from 0 to 1. A number or (world,).
        latency: Time from capture to arrival [s]: the mean of a "normal" distribution, the least of the others. Frames
            for which latency and jitter are below 0 together arrive at once. A number or (world,).
        jitter: Spread of the latency [s]: the standard deviation ("normal"), the width above the latency ("uniform"),
            or the mean excess ("exponential"). A number or (world,).
        drop: Probability that a frame never arrives, from 0 to 1. A number or (world,).
        hold: Probability that a frame has the jitter of the one before, from 0 to 1. A number or (world,).
        redraw: Time for which a drawn jitter stays [s]; 0 draws one for each frame. A number or (world,).
        distribution: Of the latency.
        capacity: How many frames of a world may be under way at once. One more is lost, and counted in
            ``Deliveries.overrun``.
    """

    rate: Any = parameter(0.0, low=0.0)
    phase: Any = parameter(0.0, low=0.0, high=1.0)
    latency: Any = parameter(0.0)
    jitter: Any = parameter(0.0, low=0.0)
    drop: Any = parameter(0.0, low=0.0, high=1.0)
    hold: Any = parameter(0.0, low=0.0, high=1.0)
    redraw: Any = parameter(0.0, low=0.0)
    distribution: Literal["normal", "uniform", "exponential"] = "normal"
    capacity: int = 4

    kind = "delivery"
    timed = True

    def check(self, where: str) -> None:
        if self.distribution not in tuple(DISTRIBUTIONS):
            allowed = ", ".join(map(repr, DISTRIBUTIONS))
            raise WarpcamError(f"{where}: distribution must be one of {allowed}, got {self.distribution!r}")
        whole = isinstance(self.capacity, int | np.integer) and not isinstance(self.capacity, bool)
        if not whole or self.capacity < 1:
            raise WarpcamError(f"{where}: capacity must be a whole number of at least 1, got {self.capacity!r}")


@dataclass(frozen=True, eq=False)
class Deliveries:
    """State of a camera's delivery, tensors (world,) on the scene's device. Resets leave the counts as they are.

    Attributes:
        age: float32: time since the frame that is shown was captured, at the world's last read [s].
        captured: int32: how many frames were captured, those that were lost among them.
        dropped: int32: how many were lost by ``Delivery.drop``.
        overrun: int32: how many were lost because ``Delivery.capacity`` frames were under way.
    """

    age: torch_interop.Tensor
    captured: torch_interop.Tensor
    dropped: torch_interop.Tensor
    overrun: torch_interop.Tensor


@dataclass(frozen=True, eq=False)
class _Copies:
    """An output's arrays, (world, element, channel), elements being pixels or, of bytes, words where they fit.

    Attributes:
        source: As it is measured.
        ring: Frames under way, (world, slot, element, channel).
        target: As it is shown.
    """

    source: wp.array
    ring: wp.array
    target: wp.array

    @classmethod
    def of(cls, source: wp.array, target: wp.array, slots: int) -> "_Copies":
        worlds, height, width, channels = source.shape
        shape, dtype = (height * width, channels), wp.int32
        if source.dtype is wp.uint8 and height * width * channels % 4:
            dtype = wp.uint8
        elif source.dtype is wp.uint8:
            shape = (height * width * channels // 4, 1)
        ring = wp.zeros((worlds, slots, *shape), dtype=dtype, device=source.device)
        return cls(shared(source, (worlds, *shape), dtype), ring, shared(target, (worlds, *shape), dtype))


class DeliveredImages:
    """Images of one camera as they are delivered, and the ring of those under way.

    Attributes:
        images: All outputs of the camera, as the renderer has them.
        status: For the user.
    """

    def __init__(self, effect: Delivery, params: Images, sources: Images, where: str):
        some = next(iter(sources.values()))
        self._effect, self._device = effect, some.device
        worlds, slots = some.shape[0], int(effect.capacity)
        _check_capacity(effect, params, where)
        _check_room(effect, sources, where)
        self.images = {name: wp.zeros_like(image) for name, image in sources.items()}
        self._copies = [_Copies.of(image, self.images[name], slots) for name, image in sources.items()]
        self._stored, self._shown = (wp.full(worlds, kernels.NO_FRAME, wp.int32, device=self._device) for _ in range(2))
        self._ages = wp.zeros(worlds, dtype=wp.float32, device=self._device)
        self._counts = wp.zeros((worlds, 3), dtype=wp.int32, device=self._device)
        counts = torch_interop.to_torch(self._counts)
        self.status = Deliveries(torch_interop.to_torch(self._ages), *(counts[:, column] for column in range(3)))

    def bind(self, frame: EffectFrame) -> list[Stage]:
        """Bind the stages that decide, store and show, for the worlds of a frame."""
        within = slice(frame.worlds.start, frame.worlds.stop)
        params, state = kernels.DeliveryParams(), kernels.DeliveryState()
        for name in ("rate", "phase", "latency", "jitter", "hold", "redraw", "drop"):
            setattr(params, name, getattr(frame.params, name))
        params.distribution = DISTRIBUTIONS[self._effect.distribution]
        for name, dtype in ARRAYS.items():
            setattr(state, name, frame.keep(name, (), dtype))
        slots = (int(self._effect.capacity),)
        state.pending = frame.keep("pending", slots, wp.int32)
        state.captured, state.arrival = frame.keep("captured", slots), frame.keep("arrival", slots)
        stored, shown = self._stored[within], self._shown[within]
        decided = [params, frame.times, state, self._counts[within], stored, shown, self._ages[within]]
        stages = [frame.per_world(kernels.deliver, [frame.mask, frame.randomness, *decided])]
        for copies in self._copies:
            source, ring, target = copies.source[within], copies.ring[within], copies.target[within]
            count = source.shape[0] * source.shape[1]
            inputs = [stored, shown, source, ring, target]
            stages.append(bind_launch(kernels.move_frames, count, inputs, self._device))
        return stages


def _check_capacity(effect: Delivery, params: Images, where: str) -> None:
    """Raise where more frames are under way than there is room for."""
    rate, latency, jitter = (params[name].numpy() for name in ("rate", "latency", "jitter"))
    needed = math.floor((rate * (latency + REACH[effect.distribution] * jitter)).max(initial=0.0)) + 1
    if effect.capacity < needed:
        raise WarpcamError(
            f"{where}: Delivery: capacity must be at least {needed} for frames under way so long at this rate, got "
            f"{effect.capacity}"
        )


def _check_room(effect: Delivery, sources: Images, where: str) -> None:
    """Raise where frames under way have no room: 2^31 bytes of an output in a world, and what the device has free."""
    some = next(iter(sources.values()))
    sizes = [image.size // len(image) * wp.types.type_size_in_bytes(image.dtype) for image in sources.values()]
    each, free, device = len(some) * sum(sizes), free_bytes(some.device), some.device.alias
    most = (2**31 - 1) // max(sizes)
    if effect.capacity > most:
        raise WarpcamError(
            f"{where}: Delivery: capacity must be at most {most}, for which an output of a world has less than 2^31 "
            f"bytes, got {effect.capacity}, for which all worlds need {each * effect.capacity:,} bytes"
        )
    if free is not None and each * effect.capacity > free:
        raise OutOfMemoryError(
            f"{where}: Delivery: capacity must be at most {free // each}, for which there is room, got "
            f"{effect.capacity}; {each * effect.capacity:,} bytes are needed, {free:,} are free on {device}"
        )
