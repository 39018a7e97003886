"""Stereo cameras: lookups beside the pixel, noise and steps of the disparity, windows that do not match."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.depth_lookup import shift_bilinear
from warpcam.sensors.kernels.disparity import add_disparity_noise, quantize_disparity
from warpcam.sensors.kernels.matching_window import MAX_RADIUS, MatchingRule, bind_matches


@dataclass(frozen=True, eq=False)
class ShiftedLookup(Effect):
    """Depth looked up at a Gaussian distance, between pixels.

    The lookup is bilinear where all four pixels are measured; elsewhere it takes the nearest pixel, so that depth is
    never mixed with what is no measurement. Source: simkinect (Handa et al., "A Benchmark for RGB-D Visual Odometry, 3D
    Reconstruction and SLAM", ICRA 2014), whose standard deviation is the default.

    Attributes:
        sigma: Standard deviation of both coordinates [pixels of the sensor]; a number or (world,).
        focal_length: Focal length of the sensor [pixels], for images that have fewer pixels than it; 0 is the camera's
            own; a number or (world,).
        focal_length_y: That of columns, where pixels of the sensor are not square; 0 is ``focal_length``; a number or
            (world,).
    """

    sigma: Any = parameter(0.5, low=0.0)
    focal_length: Any = parameter(0.0, low=0.0)
    focal_length_y: Any = parameter(0.0, low=0.0)

    kind = "depth"
    in_place = False
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.views, frame.size, frame.randomness, params.sigma, params.focal_length]
        inputs += [params.focal_length_y, frame.source, frame.target]
        return [frame.per_strip(shift_bilinear, inputs)]


@dataclass(frozen=True, eq=False)
class DisparityNoise(Effect):
    """Gaussian noise of the disparity ``d = f B / z``, with focal length f and baseline B.

    To first order depth has the standard deviation ``z^2 sigma / (f B)``, the formula of Intel's "Best-Known-Methods
    for Tuning Intel RealSense D400 Depth Cameras for Best Performance". A disparity that is not above 0 is no
    measurement.

    Attributes:
        baseline: Distance of the two imagers [m]; a number or (world,), as all that follow.
        sigma: Standard deviation of the disparity [pixels of the sensor].
        bias: Error of the disparity that stays, as of a calibration [pixels of the sensor].
        cell: Width of the squares of pixels that share one random number [pixels of the image], rounded, at least 1:
            windows of neighbouring pixels overlap, so their errors are alike.
        focal_length: Focal length of the sensor [pixels], for images that have fewer pixels than it; 0 is the camera's
            own.
    """

    baseline: Any = parameter(low=1e-6)
    sigma: Any = parameter(low=0.0)
    bias: Any = parameter(0.0)
    cell: Any = parameter(1.0, low=1.0)
    focal_length: Any = parameter(0.0, low=0.0)

    kind = "depth"
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.views, frame.size, frame.randomness, params.baseline, params.sigma, params.bias]
        inputs += [params.cell, params.focal_length, frame.source, frame.target]
        return [frame.per_strip(add_disparity_noise, inputs)]


@dataclass(frozen=True, eq=False)
class DisparityQuantization(Effect):
    """Steps of the disparity ``d = f B / z``: depth comes in steps of ``z^2 step / (f B)``.

    Depth whose disparity rounds to 0 is no measurement. Source of the step: simkinect (``ShiftedLookup``), whose focal
    length is 480 pixels and whose baseline is 0.075 m.

    Attributes:
        baseline: Distance of the two imagers [m]; a number or (world,), as all that follow.
        step: Least difference of two disparities [pixels of the sensor]; 0 rounds nothing.
        focal_length: Focal length of the sensor [pixels], for images that have fewer pixels than it; 0 is the camera's
            own.
    """

    baseline: Any = parameter(low=1e-6)
    step: Any = parameter(0.125, low=0.0)
    focal_length: Any = parameter(0.0, low=0.0)

    kind = "depth"
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.views, params.baseline, params.step, params.focal_length]
        return [frame.per_strip(quantize_disparity, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class MatchingWindow(Effect):
    """Dropout of pixels whose window does not match: too little of the neighbourhood has about the same disparity.

    A neighbour at r pixels counts if its disparity differs from the mean of the window by less than ``tolerance 1.44
    r^2``, the pixel itself by less than ``tolerance``. Source of the rule and of the defaults: the filter of simkinect
    (``ShiftedLookup``), which counts projected dots alone and fills what lies between them; here every pixel is a dot.

    Attributes:
        baseline: Distance of the two imagers [m]; a number or (world,), as all parameters.
        tolerance: Difference of disparities [pixels of the sensor].
        share: Part of the pixels of the window that must count, from 0 to 1.
        focal_length: Focal length of the sensor [pixels], for images that have fewer pixels than it; 0 is the camera's
            own.
        radius: Half the width of the window [pixels], a whole number from 1 to 15: 4 is a window of 9x9.
    """

    baseline: Any = parameter(low=1e-6)
    tolerance: Any = parameter(0.1, low=0.0)
    share: Any = parameter(1.0 / 1.2, low=0.0, high=1.0)
    focal_length: Any = parameter(0.0, low=0.0)
    radius: int = 4

    kind = "depth"
    in_place = False
    needs_pinhole = True

    def check(self, where: str) -> None:
        whole = isinstance(self.radius, int | np.integer) and not isinstance(self.radius, bool)
        if not whole or not 1 <= self.radius <= MAX_RADIUS:
            raise WarpcamError(f"{where}: radius must be a whole number from 1 to {MAX_RADIUS}, got {self.radius!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        rule = MatchingRule()
        rule.views, rule.radius = frame.views, int(self.radius)
        rule.baseline, rule.tolerance, rule.share = params.baseline, params.tolerance, params.share
        rule.focal = params.focal_length
        return [bind_matches(frame.width, frame.height, frame.mask, rule, frame.source, frame.target)]
