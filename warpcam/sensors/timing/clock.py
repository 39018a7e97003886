"""The simulation's time at each frame of each world."""

import math
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.render.renderer import Renderer
from warpcam.sensors.kernels.clock import advance


class Clock:
    """Times of the frames that are measured.

    Attributes:
        times: (world,) float32: time of each world's last frame [s], NaN before the first or where it is not known.
        elapsed: (world,) float32: time between that and the one before [s], NaN likewise.
    """

    def __init__(self, renderer: Renderer):
        self._scene, self._device, self._num_worlds = renderer.scene, renderer.scene.device, renderer.scene.num_worlds
        self._own: Any = torch_interop.as_array(renderer.times)
        self._now, self.times, self.elapsed = (
            wp.full(self._num_worlds, math.nan, dtype=wp.float32, device=self._device) for _ in range(3)
        )

    def require(self, time: Any, user: str) -> None:
        """Raise if there is no time."""
        if time is None and self._scene.clock() is None:
            raise WarpcamError(
                f"Rig.read: {user} needs the simulation's time, and this scene keeps none; give it: time=... [s], a "
                f"number or float32 ({self._num_worlds},)"
            )

    def check(self, time: Any) -> Any:
        """The scene's times for None, an array on the scene's device, a number, or a host's array.

        Raises:
            WarpcamError: It is none of these.
        """
        if time is None:
            return self._own
        name, allowed = "Rig.read: time", f"a number or float32 ({self._num_worlds},) [s]"
        array = torch_interop.as_array(time)
        if array is not None and (array.device == self._device or not array.device.is_cpu):
            device_rule.require_same(self._device, "the scene is", array.device, name)
            if array.dtype is wp.float32 and array.shape == (self._num_worlds,):
                return array
            came = f"{array.dtype.__name__} {tuple(array.shape)}"
        else:
            host = as_numbers(time, name, allowed)
            if host.shape in ((), (self._num_worlds,)):
                if torch_interop.is_capturing(self._device):
                    raise WarpcamError(
                        "Rig.read: a capture is under way, and a time on the host cannot become part of it; give a "
                        f"float32 tensor ({self._num_worlds},) on {self._device.alias}"
                    )
                return host.astype(np.float32) if host.shape else float(host)
            came = f"{host.dtype} {host.shape}"
        raise WarpcamError(f"{name} must be {allowed}, got {came}")

    def set(self, given: Any) -> None:
        """Take what ``check`` has returned as the time of the frame to come."""
        if isinstance(given, wp.array):
            wp.copy(self._now, given)
        elif isinstance(given, float):
            self._now.fill_(given)
        else:
            self._now.assign(given)

    def bind(self, mask: wp.array) -> Stage:
        """Bind the stage that puts the clocks of worlds forward."""
        return bind_launch(advance, self._num_worlds, [mask, self._now, self.times, self.elapsed], self._device)
