"""Differences between pixels of one sensor: fixed in all frames, others in each world."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter, side_by_side
from warpcam.sensors.kernels.fixed_patterns import spoil_pixels, vary_dark_signal, vary_response


@dataclass(frozen=True, eq=False)
class Prnu(Effect):
    """Photo response non-uniformity: linear light times ``1 + sigma * n``, n a normal number of pixel and channel.

    EMVA 1288 states sigma as PRNU1288, in per cent.

    Attributes:
        sigma: Standard deviation of the gains about 1; a number or (world,).
    """

    sigma: Any = parameter(low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(vary_response, [frame.randomness, frame.params.sigma])]


@dataclass(frozen=True, eq=False)
class Dsnu(Effect):
    """Dark signal non-uniformity: ``sigma * n`` is added to linear light, n a normal number of pixel and channel.

    EMVA 1288 states DSNU1288 in electrons, of which sigma is the share in those of white.

    Attributes:
        sigma: Standard deviation of the offsets, white is 1; a number or (world,).
    """

    sigma: Any = parameter(low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(vary_dark_signal, [frame.randomness, frame.params.sigma])]


@dataclass(frozen=True, eq=False)
class DeadPixels(Effect):
    """Defective pixels at fixed places: dead ones are black, hot ones bright, whatever the light.

    Each pixel is defective by chance, so the number of them varies from world to world about its mean. Both shares
    together are at most 1.

    Attributes:
        dead: Share of pixels that are black; a number or (world,).
        hot: Share of pixels that are bright; a number or (world,).
        level: Linear light that a hot pixel shows; a number or (world,).
    """

    dead: Any = parameter(0.0, low=0.0, high=1.0)
    hot: Any = parameter(0.0, low=0.0, high=1.0)
    level: Any = parameter(1.0, low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def check(self, where: str) -> None:
        shares = np.add(*side_by_side(self, where, "dead", "hot"))
        if (shares > 1.0 + 1e-6).any():
            raise WarpcamError(f"{where}: dead and hot must be at most 1 together, got {shares.max():g}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        return [frame.per_color_strip(spoil_pixels, [frame.randomness, params.dead, params.hot, params.level])]
