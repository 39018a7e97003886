"""Noise of photons and electronics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter, side_by_side
from warpcam.sensors.kernels.electrons import LinearCamera, add_normal, count_electrons, measure_linearly


@dataclass(frozen=True, eq=False)
class ShotNoise(Effect):
    """Photon shot noise: a pixel's electrons are a Poisson number whose mean is its light.

    Light L becomes N / electrons with N ~ Poisson(L * electrons), so its variance is L / electrons. Channels of a
    pixel are independent. The distribution is exact to 1e-6 below a mean of 4 electrons; from there on it is the
    expansion of Giles, "Algorithm 955" (ACM TOMS 42(1), 2016), to 1 / mean, whose distribution function is off by less
    than 4e-4.

    Attributes:
        electrons: Electrons that white light, 1, gives in a pixel [e-]; a number or (world,).
    """

    electrons: Any = parameter(low=1e-3, high=1e7)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(count_electrons, [frame.randomness, frame.params.electrons])]


@dataclass(frozen=True, eq=False)
class ReadNoise(Effect):
    """Noise of reading: a normal number is added to each channel of linear light.

    Attributes:
        sigma: Standard deviation, white is 1: that in electrons over the electrons of white. A number or (world,).
    """

    sigma: Any = parameter(low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(add_normal, [frame.randomness, frame.params.sigma])]


@dataclass(frozen=True, eq=False)
class Emva1288(Effect):
    """The linear camera model of EMVA 1288, from photons to digital numbers.

    With light L, mean electrons are ``quantum_efficiency * photons_at_white * L + dark_current * exposure_time``. Their
    number is a Poisson number (see ``ShotNoise``), at most ``full_well``; a normal number of standard deviation
    ``dark_noise`` is added, and the digital number is ``gain`` times that plus ``black_level``, rounded and limited to
    0 to 2^bits - 1. The variance of digital numbers is then

        gain^2 * (dark_noise^2 + dark_current * exposure_time) + 1/12 + gain * (mean - mean in the dark).

    The result is linear light again: digital numbers less ``black_level``, over
    ``gain * quantum_efficiency * photons_at_white``; that of dark current stays in. Source: EMVA Standard 1288, release
    4.0 linear, the mathematical model; data sheets by this standard state these parameters. Each channel of a pixel is
    a measurement of its own; ``BayerMosaic`` after it keeps one of them.

    Attributes:
        photons_at_white: Photons that white light, 1, brings to a pixel in an exposure; a number or (world,).
        quantum_efficiency: Electrons for each photon, eta, up to 1; a number or (world,).
        full_well: Most electrons that a pixel holds [e-]: the saturation capacity; a number or (world,).
        gain: Overall system gain, K [DN / e-]; a number or (world,).
        dark_noise: Temporal dark noise, standard deviation [e-]; a number or (world,).
        dark_current: [e- / s]; a number or (world,).
        exposure_time: Time in which dark current gathers [s]; a number or (world,).
        black_level: Digital number of no electrons [DN], below the greatest of so many bits; a number or (world,).
        bits: Of the converter, to the next whole number; a number or (world,).
    """

    photons_at_white: Any = parameter(low=1e-3, high=1e7)
    quantum_efficiency: Any = parameter(low=1e-3, high=1.0)
    full_well: Any = parameter(low=1.0, high=1e7)
    gain: Any = parameter(low=1e-6)
    dark_noise: Any = parameter(low=0.0)
    bits: Any = parameter(low=1.0, high=16.0)
    dark_current: Any = parameter(0.0, low=0.0)
    exposure_time: Any = parameter(0.0, low=0.0)
    black_level: Any = parameter(0.0, low=0.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True

    def check(self, where: str) -> None:
        black, bits = side_by_side(self, where, "black_level", "bits")
        greatest = 2.0 ** np.floor(bits + 0.5) - 1.0
        if (above := black >= greatest).any():
            raise WarpcamError(
                f"{where}: black_level must be below the greatest number of the bits, {greatest[above][0]:g}, got "
                f"{black[above][0]:g}"
            )

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        camera = LinearCamera()
        for name, values in vars(frame.params).items():
            setattr(camera, name, values)
        return [frame.per_color_strip(measure_linearly, [frame.randomness, camera])]
