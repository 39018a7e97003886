"""Effects on depth images that a test makes up, without a scene."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from effect_frames import effect_frame

from warpcam import sensors
from warpcam.kernels.runtime.launch import run
from warpcam.kernels.types import View

FOCAL = 200.0  # of all images across, and down unless a test says otherwise [pixels]


@dataclass
class DepthBench:
    """One effect on images of (world, height, width), frame after frame.

    The camera looks along -z in every world; ``normals`` and ``colors`` are those of all pixels.
    """

    effect: sensors.Effect
    device: wp.Device
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    color: tuple[int, int, int] = (128, 128, 128)
    seed: int = 0
    focal_y: float = FOCAL
    frames: int = 0
    memory: dict[str, wp.array] = field(default_factory=dict)

    def measure(self, depth: Any) -> np.ndarray:
        depth = np.asarray(depth, np.float32)
        self.frames += 1
        source = wp.array(depth.reshape(len(depth), -1), dtype=wp.float32, device=self.device)
        target = wp.zeros_like(source)
        run(list(self.effect.bind(self._frame(depth.shape, source, target))))
        return target.numpy().reshape(depth.shape)

    def _frame(self, shape: tuple[int, ...], source: wp.array, target: wp.array) -> sensors.EffectFrame:
        worlds, height, width = shape
        views = np.zeros(worlds, View.numpy_dtype())
        views["rotation"], views["scale"] = np.eye(3), (1.0 / FOCAL, 1.0 / self.focal_y)
        views["center"] = 0.5 * width, 0.5 * height
        normals = np.broadcast_to(np.float32(self.normal), (*shape, 3))
        colors = np.broadcast_to(np.uint8(self.color), (*shape, 3))
        return effect_frame(
            self.effect,
            source,
            target,
            (width, height),
            wp.full(worlds, self.frames, dtype=wp.int32, device=self.device),
            seed=self.seed,
            truth={
                "normals": wp.array(normals, dtype=wp.float32, device=self.device),
                "rgb": wp.array(colors, dtype=wp.uint8, device=self.device),
            },
            views=wp.array(views, dtype=View, device=self.device),
            memory=self.memory,
        )


def tilted(degrees: float) -> tuple[float, float, float]:
    """Normal of a surface that the middle of an image sees at that angle."""
    return 0.0, float(np.sin(np.radians(degrees))), float(np.cos(np.radians(degrees)))
