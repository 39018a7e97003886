"""Pixels without a measurement: at edges, at grazing angles, on dark surfaces, at random. Their depth is 0."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels import depth_dropout as kernels


@dataclass(frozen=True, eq=False)
class EdgeDropout(Effect):
    """No measurement where depth in the 3x3 neighbourhood differs by more than a threshold.

    Neighbours where nothing is hit are infinitely far; those whose depth is 0 do not count. Source: the Azure Kinect
    model of BlenderProc 2.8, whose threshold is 0.8 m.

    Attributes:
        threshold: Difference of the greatest and the least depth [m]; a number or (world,).
        probability: That such a pixel has no measurement, from 0 to 1; a number or (world,).
    """

    threshold: Any = parameter(0.8, low=0.0)
    probability: Any = parameter(1.0, low=0.0, high=1.0)

    kind = "depth"
    in_place = False

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.randomness, params.threshold, params.probability]
        return [frame.per_strip(kernels.drop_edges, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class FlyingPixels(Effect):
    """Depth between a near and a far surface, where one pixel sees both.

    Where depth in the 3x3 neighbourhood differs by more than a threshold, the pixel is set, with a probability, to a
    uniform draw between the least and the greatest depth there. Beside pixels where nothing is hit, nothing is mixed.

    Attributes:
        threshold: Difference of the greatest and the least depth [m]; a number or (world,).
        probability: That such a pixel flies, from 0 to 1; a number or (world,).
    """

    threshold: Any = parameter(low=0.0)
    probability: Any = parameter(low=0.0, high=1.0)

    kind = "depth"
    in_place = False

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.randomness, params.threshold, params.probability]
        return [frame.per_strip(kernels.mix_edges, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class GrazingDropout(Effect):
    """No measurement where a surface is seen at a grazing angle.

    The probability grows from 0 at ``start`` to 1 at ``end``, linearly with the angle between the normal and the ray;
    all angles above ``start`` are dropped where ``end`` is not beyond it. Pixels without a normal count as seen
    head-on. Needs the camera's ``normals``.

    Attributes:
        start: Angle where dropout begins, 0 is head-on [degrees]; a number or (world,).
        end: Angle from which on nothing is measured [degrees]; a number or (world,).
    """

    start: Any = parameter(low=0.0, high=90.0)
    end: Any = parameter(low=0.0, high=90.0)

    kind = "depth"
    reads = ("normals",)
    needs_pinhole = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [
            frame.mask,
            frame.size,
            frame.views,
            frame.truth["normals"],
            frame.randomness,
            params.start,
            params.end,
        ]
        return [frame.per_strip(kernels.drop_grazing, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class DarkDropout(Effect):
    """No measurement of dark surfaces, which reflect too little of a camera's own light.

    Brightness is ``0.299 R + 0.587 G + 0.114 B`` of the rendered display colours (ITU-R BT.601). Source: the Azure
    Kinect model of BlenderProc 2.8, whose threshold is 15 of 255. Needs the camera's ``rgb``.

    Attributes:
        threshold: Brightness below which depth is lost, from 0 to 1; a number or (world,).
        probability: That such a pixel has no measurement, from 0 to 1; a number or (world,).
    """

    threshold: Any = parameter(15.0 / 255.0, low=0.0, high=1.0)
    probability: Any = parameter(1.0, low=0.0, high=1.0)

    kind = "depth"
    reads = ("rgb",)

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.truth["rgb"], frame.randomness, params.threshold, params.probability]
        return [frame.per_strip(kernels.drop_dark, [*inputs, frame.source, frame.target])]


@dataclass(frozen=True, eq=False)
class RandomDropout(Effect):
    """No measurement at random pixels, new ones in every frame.

    Attributes:
        probability: That a pixel has no measurement, from 0 to 1; a number or (world,).
        cell: Width of the squares of pixels that are dropped together [pixels], rounded, at least 1; a number or
            (world,).
    """

    probability: Any = parameter(low=0.0, high=1.0)
    cell: Any = parameter(1.0, low=1.0)

    kind = "depth"

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        params = frame.params
        inputs = [frame.mask, frame.size, frame.randomness, params.probability, params.cell]
        return [frame.per_strip(kernels.drop_at_random, [*inputs, frame.source, frame.target])]
