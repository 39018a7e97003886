"""Units of a depth camera's driver."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.depth_dropout import quantize_depth


@dataclass(frozen=True, eq=False)
class DepthQuantization(Effect):
    """Whole units in 16 bits, as drivers give depth: rounded to a multiple of the unit, in metres again.

    Depth beyond 65535 units is no measurement.

    Attributes:
        unit: Least difference [m]; a number or (world,). 1 mm is what librealsense's Z16 and Azure Kinect's DEPTH16
            have; 0 rounds nothing.
    """

    unit: Any = parameter(0.001, low=0.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [
            frame.per_strip(quantize_depth, [frame.mask, frame.size, frame.params.unit, frame.source, frame.target])
        ]
