"""Limits of a depth camera's range."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter, side_by_side
from warpcam.sensors.kernels.range_limits import limit_range


@dataclass(frozen=True, eq=False)
class DepthRange(Effect):
    """Limits of the range: depth outside of it is no measurement. ``min`` must not be above ``max``.

    Attributes:
        min: Least depth that is measured [m]; a number or (world,).
        max: Greatest depth that is measured [m]; a number or (world,).
        invalid: Depth of pixels without a measurement, also of those that were 0, infinite or not finite before [m];
            0 is what depth cameras' drivers give.
    """

    min: Any = parameter(low=0.0)
    max: Any = parameter(low=0.0)
    invalid: Any = parameter(0.0)

    kind = "depth"

    def check(self, where: str) -> None:
        least, greatest = side_by_side(self, where, "min", "max")
        empty = least > greatest
        if empty.any():
            raise WarpcamError(f"{where}: min must be at most max, got {least[empty][0]:g} and {greatest[empty][0]:g}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, params.min, params.max, params.invalid, frame.source, frame.target]
        return [frame.per_strip(limit_range, inputs)]
