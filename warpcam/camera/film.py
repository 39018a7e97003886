"""What a camera does to light before it is shown: automatic exposure and bloom."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.arrays import MAX_EXPOSURE
from warpcam.core.errors import WarpcamError

WIDEST = 0.25  # standard deviation of a bloom, of the image's height
NARROWEST = 1e-3  # the same [pixels]: from there on no other pixel has a weight that float32 holds


@dataclass(frozen=True, kw_only=True)
class AutoExposure:
    """Automatic exposure for ``Camera(auto_exposure=...)``: one for each world, measured on the device in every frame.

    The exposure is log2(key / L) stops, where L is the geometric mean of the luminance of the pixels that show light
    (Reinhard et al., Photographic Tone Reproduction for Digital Images, 2002, equations 1 and 2, without a term for
    pixels in the dark, which do not count). Luminance is that of Rec. 709, before the camera's ``exposure``, ``gain``
    and bloom.

    Attributes:
        key: What L becomes; middle grey unless given. More than 0.
        limits: Least and greatest automatic exposure [stops]; an image without light has the greatest.
        rate: How far each frame goes from the exposure of the frame before to its own, in (0, 1]. With 1 the exposure
            is that of the frame alone.

    Raises:
        WarpcamError: An argument cannot be used.
    """

    key: float = 0.18
    limits: tuple[float, float] = (-16.0, 16.0)
    rate: float = 1.0

    def __post_init__(self) -> None:
        _set(self, "key", _number("AutoExposure: key", self.key, 2.0**-MAX_EXPOSURE, 2.0**MAX_EXPOSURE))
        _set(self, "rate", _number("AutoExposure: rate", self.rate, 0.0, 1.0, above=True))
        text = f"AutoExposure: limits must be two numbers of stops, from {-MAX_EXPOSURE} to {MAX_EXPOSURE}"
        pair = self.limits
        if not isinstance(pair, tuple | list | np.ndarray) or len(pair) != 2:
            raise WarpcamError(f"{text}, got {pair!r}")
        lowest, highest = (_number("AutoExposure: limits", each, -MAX_EXPOSURE, MAX_EXPOSURE) for each in pair)
        if lowest > highest:
            raise WarpcamError(f"{text}, the lower first, got {pair!r}")
        _set(self, "limits", (lowest, highest))


@dataclass(frozen=True, kw_only=True)
class Bloom:
    """Bloom for ``Camera(bloom=...)``: a lens scatters a share of all light to the pixels around.

    There is no threshold: each pixel keeps 1 - ``strength`` of its light, the rest is spread by a Gaussian. At the
    image's borders light is reflected, so that the sum of all pixels stays.

    Attributes:
        strength: Share of the light that is scattered, in [0, 1].
        radius: Standard deviation of the Gaussian, of the image's height, in (0, 0.25].

    Raises:
        WarpcamError: An argument cannot be used.
    """

    strength: float = 0.05
    radius: float = 0.05

    def __post_init__(self) -> None:
        _set(self, "strength", _number("Bloom: strength", self.strength, 0.0, 1.0))
        _set(self, "radius", _number("Bloom: radius", self.radius, 0.0, WIDEST, above=True))

    def weights(self, height: int) -> np.ndarray:
        """Weights of a pixel and of those from 1 pixel away on, to each side, out to three standard deviations.

        Args:
            height: Of the image [pixels].

        Returns:
            float32, (pixels + 1,); the first and twice the others add up to 1.
        """
        sigma = max(self.radius * height, NARROWEST)
        away = np.arange(int(np.ceil(3.0 * sigma)) + 1)
        weights = np.exp(-0.5 * (away / sigma) ** 2)
        return np.asarray(weights / (2.0 * weights.sum() - 1.0), np.float32)


def _set(options: Any, name: str, value: Any) -> None:
    object.__setattr__(options, name, value)


def _number(what: str, value: Any, lowest: float, highest: float, above: bool = False) -> float:
    """The number that came, or the error that it is none, or not from ``lowest``, or above it, to ``highest``."""
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not is_number or not lowest <= value <= highest or (above and value == lowest):
        allowed = f"a number in {'(' if above else '['}{lowest:g}, {highest:g}]"
        raise WarpcamError(f"{what} must be {allowed}, got {value!r}")
    return float(value)
