"""Shutters: cameras that read their lines one after another, and motion during the exposure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.kernels.types import View
from warpcam.sensors.effect import Effect, EffectFrame, Kind, parameter
from warpcam.sensors.kernels import shutter as kernels

DIRECTIONS = {"down": kernels.DOWN, "up": kernels.UP, "right": kernels.RIGHT, "left": kernels.LEFT}
CHANGES: Mapping[str, Kind] = {"colors": "linear", "depth": "depth"}


@dataclass(frozen=True, eq=False)
class RollingShutter(Effect):
    """A shutter that reads line after line: each shows the scene at a time of its own, the last as it is now.

    With n lines, line k shows the scene readout (n - 1 - k) / (n - 1) ago. The scene between the frame before and this
    one is reconstructed from both and from ``flow``; docs/sensors_time.md has the formula and its error.

    Attributes:
        readout: Time from the first line to the last [s]; a number or (world,). One that is longer than the time
            between two reads takes motion to go on as it is.
        direction: From the first line to the last: "down" and "up" read rows, "right" and "left" columns.
        changes: "colors" or "depth". A camera with both outputs takes an effect for each.
    """

    readout: Any = parameter(low=0.0)
    direction: Literal["down", "up", "right", "left"] = "down"
    changes: Literal["colors", "depth"] = "colors"

    in_place = False
    timed = True

    @property
    def kind(self) -> Kind:  # type: ignore[override]
        return CHANGES.get(self.changes, "linear")

    @property
    def reads(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("depth", "flow", "flow_valid") if self.changes == "depth" else ("depth", "flow")

    def check(self, where: str) -> None:
        for name, allowed in (("direction", DIRECTIONS), ("changes", CHANGES)):
            if getattr(self, name) not in tuple(allowed):
                names = ", ".join(map(repr, allowed))
                raise WarpcamError(f"{where}: {name} must be one of {names}, got {getattr(self, name)!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        exposure = kernels.Exposure()
        exposure.readout = frame.params.readout
        exposure.duration = wp.zeros(len(frame.worlds), dtype=wp.float32, device=frame.device)
        exposure.direction, exposure.samples = DIRECTIONS[self.direction], 1
        return _bind_exposure(frame, exposure, self.kind == "depth")


@dataclass(frozen=True, eq=False)
class MotionBlur(Effect):
    """Motion during the exposure, which ends now: the mean of the light at moments spread over it.

    The scene at these moments is reconstructed as ``RollingShutter`` does. ``Accumulation`` takes true samples of a
    simulation that is stepped for each.

    Attributes:
        exposure: How long the shutter is open [s]; a number or (world,).
        samples: How many moments. Moments should be less than two pixels of motion apart.
    """

    exposure: Any = parameter(low=0.0)
    samples: int = 8

    kind = "linear"
    reads = ("depth", "flow")
    in_place = False
    timed = True

    def check(self, where: str) -> None:
        require_count(f"{where}: samples", self.samples)

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        exposure = kernels.Exposure()
        exposure.readout = wp.zeros(len(frame.worlds), dtype=wp.float32, device=frame.device)
        exposure.duration = frame.params.exposure
        exposure.direction, exposure.samples = kernels.DOWN, int(self.samples)
        return _bind_exposure(frame, exposure, False)


def require_count(where: str, value: Any) -> None:
    """Raise unless it is a whole number from 1 on."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise WarpcamError(f"{where} must be a whole number of at least 1, got {value!r}")


def _bind_exposure(frame: EffectFrame, exposure: Any, is_depth: bool) -> list[Stage]:
    worlds, pixels = len(frame.worlds), frame.width * frame.height
    motion = kernels.Motion()
    motion.mask, motion.elapsed = frame.mask, wp.zeros(worlds, dtype=wp.float32, device=frame.device)
    known = frame.keep("known", (), wp.int32)
    motion.flow = shared(frame.truth["flow"], (worlds, pixels), wp.vec2)
    motion.depth = shared(frame.truth["depth"], (worlds, pixels), wp.float32)
    motion.width, motion.height = frame.width, frame.height
    motion.turns = wp.zeros(worlds, dtype=wp.mat33, device=frame.device)
    motion.miss = wp.full(worlds, math.nan, dtype=wp.float32, device=frame.device)
    turns = []
    if frame.pinhole:
        views = [frame.views, wp.zeros(worlds, dtype=View, device=frame.device)]
        turns.append(frame.per_world(kernels.find_turns, [motion, *views]))
    motion.tile = max(8, max(frame.width, frame.height) // 40)
    tiles = -(-frame.width // motion.tile) * -(-frame.height // motion.tile)
    motion.tile_flow, motion.spread_flow = (
        wp.zeros((worlds, tiles), dtype=wp.vec4, device=frame.device) for _ in range(2)
    )
    motion.tile_depth = wp.zeros((worlds, tiles), dtype=wp.float32, device=frame.device)
    before = wp.zeros((worlds, pixels), dtype=frame.source.dtype, device=frame.device)
    images = [frame.source, before, frame.target]
    if is_depth:
        valid = shared(frame.truth["flow_valid"], (worlds, pixels), wp.uint8)
        expose = frame.per_pixel(kernels.expose_depth, [motion, exposure, valid, *images])
        remember = kernels.remember_depth
    else:
        expose = frame.per_pixel(kernels.expose_colors, [motion, exposure, *images])
        remember = kernels.remember_colors
    return [
        frame.per_world(kernels.follow_frames, [frame.mask, frame.renders, frame.elapsed, known, motion.elapsed]),
        *turns,
        bind_launch(kernels.find_tile_flow, worlds * tiles, [motion], frame.device),
        bind_launch(kernels.spread_tile_flow, worlds * tiles, [motion, exposure], frame.device),
        expose,
        frame.per_pixel(remember, [frame.mask, frame.source, before]),
    ]
