"""Exposure, gain and white balance."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.exposure import amplify, balance, expose

# XYZ of CIE 1931 to linear light of IEC 61966-2-1 (sRGB).
XYZ_TO_RGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]],
)
TEMPERATURES = (1667.0, 25000.0)


@dataclass(frozen=True, eq=False)
class Exposure(Effect):
    """Exposure: linear light times ``2^stops * time / reference_time``.

    Attributes:
        stops: Exposure value [EV]; one more is twice the light. A number or (world,).
        time: Time for which the shutter is open [s]; a number or (world,).
        reference_time: Time for which the rendered light is right [s]; a number or (world,).
    """

    stops: Any = parameter(0.0, low=-64.0, high=64.0)
    time: Any = parameter(1.0, low=0.0)
    reference_time: Any = parameter(1.0, low=1e-9)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        return [frame.per_color_strip(expose, [params.stops, params.time, params.reference_time])]


@dataclass(frozen=True, eq=False)
class Gain(Effect):
    """Gain: linear light times a factor; a gain of d decibels is the factor 10^(d / 20).

    After noise it makes noise brighter, too, which ``Exposure`` before noise does not.

    Attributes:
        factor: A number or (world,).
    """

    factor: Any = parameter(1.0, low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(amplify, [frame.params.factor])]


@dataclass(frozen=True, eq=False)
class WhiteBalance(Effect):
    """White balance: red, green and blue of linear light times a gain each.

    Attributes:
        gains: (3,) or (world, 3).
    """

    gains: Any = parameter((1.0, 1.0, 1.0), low=0.0, width=(3,))

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    @classmethod
    def from_temperature(cls, kelvin: Any) -> "WhiteBalance":
        """Make the effect that shows light of a black body as grey; green stays.

        The colour of the light is that of the Planckian locus by the cubic polynomials of Kim et al. (US patent
        7024034, 2006) in CIE 1931 chromaticities, in the primaries of sRGB.

        Args:
            kelvin: Temperature of the light [K], from 1,904, where blue light begins, to 25,000; a number or (world,).

        Raises:
            WarpcamError: A temperature is out of range.
        """
        return cls(gains_of(kelvin))

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(balance, [frame.params.gains])]


def gains_of(kelvin: Any) -> np.ndarray:
    """Gains (..., 3) that make light of those temperatures [K] grey."""
    where = "WhiteBalance.from_temperature: kelvin"
    temperature = as_numbers(kelvin, where).astype(np.float64)
    low, high = TEMPERATURES
    x, y = chromaticity(np.clip(np.nan_to_num(temperature), low, high))
    light = np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], axis=-1) @ XYZ_TO_RGB.T
    allowed = (temperature >= low) & (temperature <= high) & (light > 0.0).all(axis=-1)
    if not allowed.all():
        raise WarpcamError(
            f"{where} must be from 1904 to 25000, below which the light has no blue in sRGB, got "
            f"{temperature[~allowed].flat[0]:g}"
        )
    return light[..., 1:2] / light


def chromaticity(kelvin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """CIE 1931 x and y of a black body, from 1667 K to 25000 K."""
    inverse = 1.0e3 / kelvin
    cool = np.polyval((-0.2661239, -0.2343589, 0.8776956, 0.179910), inverse)
    warm = np.polyval((-3.0258469, 2.1070379, 0.2226347, 0.240390), inverse)
    x = np.where(kelvin <= 4000.0, cool, warm)
    least = np.polyval((-1.1063814, -1.34811020, 2.18555832, -0.20219683), x)
    middle = np.polyval((-0.9549476, -1.37418593, 2.09137015, -0.16748867), x)
    greatest = np.polyval((3.0817580, -5.87338670, 3.75112997, -0.37001483), x)
    return x, np.where(kelvin <= 2222.0, least, np.where(kelvin <= 4000.0, middle, greatest))
