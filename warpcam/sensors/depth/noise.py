"""Noise, bias and drift of depth, pixel by pixel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels import depth_noise as kernels


@dataclass(frozen=True, eq=False)
class PolynomialNoise(Effect):
    """Gaussian noise whose standard deviation is a polynomial of the depth z.

    ``sigma = constant + linear z + quadratic z^2``, not below 0, around ``z + offset``. Source: the range sensors of
    aerial_gym 2.0.1, which subtracts its ``mean_offset``. With ``linear`` alone the noise is proportional to depth, as
    that of aerial_gym's cameras, whose ``linear`` is 0.01.

    Attributes:
        constant: Standard deviation at no distance [m]; a number or (world,), as all that follow.
        linear: Growth with depth.
        quadratic: Growth with its square [1/m].
        offset: Mean error [m].
    """

    constant: Any = parameter(0.0)
    linear: Any = parameter(0.0)
    quadratic: Any = parameter(0.0)
    offset: Any = parameter(0.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [
            frame.mask,
            frame.size,
            frame.randomness,
            params.constant,
            params.linear,
            params.quadratic,
            params.offset,
        ]
        return [frame.per_strip(kernels.add_polynomial_noise, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class AzureKinectNoise(Effect):
    """Gaussian noise that grows with the depth z beyond a start: ``sigma = constant + slope max(z - start, 0)``.

    Source of formula and defaults: the Azure Kinect model of BlenderProc 2.8, after Tölgyessy et al., "Evaluation of
    the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors 2021.

    Attributes:
        constant: Least standard deviation [m]; a number or (world,), as all that follow.
        slope: Growth with depth.
        start: Depth where the growth begins [m].
    """

    constant: Any = parameter(0.0005, low=0.0)
    slope: Any = parameter(0.001, low=0.0)
    start: Any = parameter(0.5, low=0.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.randomness, params.constant, params.slope, params.start]
        return [frame.per_strip(kernels.add_ramp_noise, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class DepthBias(Effect):
    """Error that stays: ``scale z + offset``.

    Attributes:
        offset: Added to depth [m]; a number or (world,).
        scale: Depth is multiplied by it; a number or (world,).
    """

    offset: Any = parameter(0.0)
    scale: Any = parameter(1.0, low=0.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        inputs = [frame.mask, frame.size, frame.params.offset, frame.params.scale, frame.source, frame.target]
        return [frame.per_strip(kernels.add_bias, inputs)]


@dataclass(frozen=True, eq=False)
class DepthDrift(Effect):
    """Error of all pixels of a world that walks at random from frame to frame.

    In each measured frame ``drift = (1 - relaxation) drift + sigma N(0, 1)``: after n frames without relaxation its
    standard deviation is ``sigma sqrt(n)``, with relaxation r it tends to ``sigma / sqrt(1 - (1 - r)^2)``.
    ``Rig.reset`` sets it to 0.

    Attributes:
        sigma: Standard deviation of a step [m]; a number or (world,).
        relaxation: Part of the drift that is lost in a frame, from 0 to 1; a number or (world,).
    """

    sigma: Any = parameter(low=0.0)
    relaxation: Any = parameter(0.0, low=0.0, high=1.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        drift, params = frame.keep("drift", ()), frame.params
        return [
            frame.per_world(kernels.walk, [frame.mask, frame.randomness, params.sigma, params.relaxation, drift]),
            frame.per_strip(kernels.add_drift, [frame.mask, frame.size, drift, frame.source, frame.target]),
        ]


@dataclass(frozen=True, eq=False)
class DepthFixedPattern(Effect):
    """Error of each pixel that is equal in all frames: one device's own, drawn from the rig's seed and the world.

    Gaussian over the pixels, with standard deviation ``constant + linear z``.

    Attributes:
        constant: Standard deviation at no distance [m]; a number or (world,).
        linear: Growth with depth; a number or (world,).
    """

    constant: Any = parameter(0.0, low=0.0)
    linear: Any = parameter(0.0, low=0.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        inputs = [
            frame.mask,
            frame.size,
            frame.randomness,
            frame.params.constant,
            frame.params.linear,
            frame.source,
            frame.target,
        ]
        return [frame.per_strip(kernels.add_fixed_pattern, inputs)]
