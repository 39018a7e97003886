"""Exposures made of several frames."""

from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame
from warpcam.sensors.kernels.accumulation import add_light, count_samples
from warpcam.sensors.timing.shutter import require_count


@dataclass(frozen=True, eq=False)
class Accumulation(Effect):
    """Exposure over several reads: the mean of their light, which is motion blur without an approximation.

    The simulation is stepped and read ``samples`` times for each image. In between, images show the mean of those that
    were read so far; the first read after an image is complete begins the next, and so does one after a reset. Outputs
    other than colours are those of the last read.

    Attributes:
        samples: How many reads an image is made of.
    """

    samples: int = 8

    kind = "linear"

    def check(self, where: str) -> None:
        require_count(f"{where}: samples", self.samples)

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        counts = frame.keep("counts", (), wp.int32)
        sums = wp.zeros((len(frame.worlds), frame.width * frame.height), dtype=wp.vec3, device=frame.device)
        return [
            frame.per_world(count_samples, [frame.mask, int(self.samples), counts]),
            frame.per_pixel(add_light, [frame.mask, counts, frame.source, sums, frame.target]),
        ]
