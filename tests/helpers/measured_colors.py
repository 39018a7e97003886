"""Effects on colours, applied to images that a test makes itself."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from effect_frames import effect_frame

from warpcam.kernels.runtime.launch import Stage, prepare
from warpcam.kernels.types import View
from warpcam.sensors.effect import Effect


class Bench:
    """One effect between two images of vec3, (world, height, width), as a rig would bind it.

    ``depth`` is that of the scene, (world, height, width), where the effect reads it; ``is_linear`` as of a frame.
    """

    def __init__(
        self,
        effect: Effect,
        images: Any,
        device: wp.Device,
        *,
        seed: int = 0,
        views: Sequence[View] = (),
        depth: Any = None,
        is_linear: bool = False,
    ):
        self.shape = np.shape(images)
        worlds, height, width = self.shape[:3]
        self.device = device
        self._images = np.ascontiguousarray(images, np.float32).reshape(worlds, height * width, 3)
        self._source = wp.array(self._images, dtype=wp.vec3, device=device)
        self._target = self._source if effect.in_place else wp.zeros_like(self._source)
        self.frames = wp.zeros(worlds, dtype=wp.int32, device=device)
        effect.check("Bench")
        frame = effect_frame(
            effect,
            self._source,
            self._target,
            (width, height),
            self.frames,
            seed=seed,
            truth={} if depth is None else {"depth": self._depth(depth)},
            views=wp.array(list(views), dtype=View, device=device),
            is_linear=is_linear,
        )
        self.mask, self.params = frame.mask, frame.params
        self._stages: list[Stage] = list(effect.bind(frame))
        prepare(self._stages)

    def _depth(self, depth: Any) -> wp.array:
        numbers = np.broadcast_to(np.asarray(depth, np.float32), self.shape[:3])
        return wp.array(np.ascontiguousarray(numbers)[..., None], dtype=wp.float32, device=self.device)

    def __call__(self) -> np.ndarray:
        """Measure the images once more."""
        self._source.assign(self._images)
        self.frames.assign(self.frames.numpy() + 1)
        for stage in self._stages:
            stage.launch()
        return self._target.numpy().reshape(self.shape).copy()


def measured(effect: Effect, images: Any, device: wp.Device, **options: Any) -> np.ndarray:
    return Bench(effect, images, device, **options)()


def picture(height: int = 20, width: int = 26, worlds: int = 2) -> np.ndarray:
    """Smooth colours with an edge, a gradient and a fine pattern, from 0 to 1."""
    y, x = np.mgrid[:height, :width] / (max(height, width) - 1)
    red = 0.5 + 0.45 * np.sin(7.0 * x + 3.0 * y)
    green = np.where(x + 0.3 * y > 0.6, 0.8, 0.2) + 0.1 * np.sin(40.0 * y)
    image = np.stack([red, green, 0.9 * y + 0.05], axis=-1)
    return np.stack([np.roll(image, shift, axis=1) for shift in range(worlds)]).astype(np.float32)
