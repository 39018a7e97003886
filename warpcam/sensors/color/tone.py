"""Curves from linear light to display colours, and steps of display colours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.tone import (
    Responses,
    apply_gamma,
    apply_points,
    apply_response,
    apply_srgb,
    find_shapes,
    quantize,
)


@dataclass(frozen=True, eq=False)
class ToneCurve(Effect):
    """A tone curve from linear light to display colours, equal for all channels.

    Attributes:
        points: Light and display value of points of the curve, (point, 2) or (world, point, 2), with straight lines
            between them and constants beyond; light must grow from point to point, also where points are written in
            place. None is the curve of sRGB (IEC 61966-2-1), which colours also go through where a chain has no curve.
    """

    points: Any = parameter(None, width=(None, 2))

    kind = "linear"
    reads_bytes = True
    writes_bytes = True
    encodes = True

    def check(self, where: str) -> None:
        if self.points is None:
            return
        points = as_numbers(self.points, f"{where}: points", "numbers, (point, 2) or (world, point, 2)")
        if points.ndim not in (2, 3) or points.shape[-1] != 2 or points.shape[-2] < 2:
            raise WarpcamError(
                f"{where}: points must have shape (point, 2) or (world, point, 2), two points at least, got "
                f"{points.shape}"
            )
        if not np.isfinite(points).all() or (np.diff(points.astype(np.float32)[..., 0], axis=-1) <= 0.0).any():
            raise WarpcamError(f"{where}: points must be finite, their light growing, got {points.tolist()}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        if self.points is None:
            return [frame.per_color_strip(apply_srgb, [])]
        points = frame.params.points
        return [frame.per_color_strip(apply_points, [shared(points, points.shape[:2], wp.vec2)])]


@dataclass(frozen=True, eq=False)
class GammaCurve(Effect):
    """A power: linear light, limited to 0 to 1, to the power of 1 / gamma.

    Attributes:
        gamma: A number or (world,).
    """

    gamma: Any = parameter(low=0.1, high=10.0)

    kind = "linear"
    reads_bytes = True
    writes_bytes = True
    encodes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(apply_gamma, [frame.params.gamma])]


@dataclass(frozen=True, eq=False)
class ResponseCurve(Effect):
    """The camera response of PPISP (arXiv 2601.18336): a toe and a shoulder that meet, to the power of gamma.

    Numbers have no bounds: exponents are ``0.3 + log(1 + exp(toe))`` and likewise of the shoulder, gamma is
    ``0.1 + log(1 + exp(gamma))``, and toe and shoulder meet at ``1 / (1 + exp(-center))``. The defaults, those of Isaac
    Lab's PPISP, are a straight line to the power of 1.0, to six digits.

    Attributes:
        toe: Of red, green and blue; (3,) or (world, 3).
        shoulder: (3,) or (world, 3).
        gamma: (3,) or (world, 3).
        center: (3,) or (world, 3).
    """

    toe: Any = parameter((0.013659,) * 3, width=(3,))
    shoulder: Any = parameter((0.013659,) * 3, width=(3,))
    gamma: Any = parameter((0.378165,) * 3, width=(3,))
    center: Any = parameter((0.0,) * 3, width=(3,))

    kind = "linear"
    reads_bytes = True
    writes_bytes = True
    encodes = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        responses, stage = bind_responses(frame)
        return [stage, frame.per_color_strip(apply_response, [responses])]


def bind_responses(frame: EffectFrame) -> tuple[Any, Stage]:
    """Response curves of the worlds, and the stage that finds them from the parameters."""
    params, responses = frame.params, Responses()
    responses.shapes = wp.empty((len(frame.worlds), 3), dtype=wp.vec4, device=frame.device)
    responses.heights = wp.empty(len(frame.worlds), dtype=wp.vec3, device=frame.device)
    parameters = [params.toe, params.shoulder, params.gamma, params.center]
    return responses, frame.per_world(find_shapes, [*parameters, responses])


@dataclass(frozen=True, eq=False)
class Quantization(Effect):
    """Steps of display colours: rounded to multiples of 1 / (2^bits - 1).

    Attributes:
        bits: To the next whole number; a number or (world,).
    """

    bits: Any = parameter(low=1.0, high=16.0)

    kind = "display"
    reads_bytes = True
    writes_bytes = True
    takes_light = True

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        return [frame.per_color_strip(quantize, [int(frame.is_linear), frame.params.bits])]
