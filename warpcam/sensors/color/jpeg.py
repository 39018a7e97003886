"""Artefacts of JPEG compression."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.jpeg import code_chroma, code_luma

Subsampling = Literal["4:4:4", "4:2:0"]
# Quantisation of luma and chroma at quality 50, row by row: ITU-T T.81, tables K.1 and K.2.
LUMA = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMA = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *((99,) * 8,) * 4,
)


@dataclass(frozen=True, eq=False)
class JpegArtifacts(Effect):
    """Loss of JPEG compression: what an image is after it was coded and decoded.

    Colours become bytes of luma and chroma (JFIF), blocks of 8 x 8 go through the cosine transform, and frequencies
    are rounded to multiples of the tables of ITU-T T.81, Annex K, scaled by the quality as libjpeg does. Chroma of
    half resolution is the mean of 2 x 2 pixels, and is interpolated when decoded, as libjpeg does.

    Attributes:
        quality: From 1 to 100, whole numbers as libjpeg's; a number or (world,).
        subsampling: "4:2:0", chroma of half resolution across and down, or "4:4:4".
    """

    quality: Any = parameter(low=1.0, high=100.0)
    subsampling: Subsampling = "4:2:0"

    kind = "display"

    def check(self, where: str) -> None:
        if self.subsampling not in get_args(Subsampling):
            allowed = ", ".join(map(repr, get_args(Subsampling)))
            raise WarpcamError(f"{where}: subsampling must be {allowed}, got {self.subsampling!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        scale = 1 if self.subsampling == "4:4:4" else 2
        numbers = np.array([LUMA, CHROMA], np.float32).reshape(2, 64)
        tables = wp.array(numbers, dtype=wp.float32, device=frame.device)
        size, worlds = (frame.width, frame.height), len(frame.worlds)
        of_chroma, of_luma = ([-(-side // (8 * times)) for side in size] for times in (scale, 1))
        chroma = wp.empty((worlds, 64 * math.prod(of_chroma)), dtype=wp.vec2ub, device=frame.device)
        common = [frame.mask, tables, frame.params.quality, wp.vec2i(*size), scale]
        inputs = [*common, wp.vec2i(*of_chroma), frame.source, chroma]
        outputs = [*common, 8 * of_chroma[0], wp.vec2i(*of_luma), frame.source, chroma, frame.target]
        return [
            bind_launch(code_chroma, worlds * math.prod(of_chroma), inputs, frame.device),
            bind_launch(code_luma, worlds * math.prod(of_luma), outputs, frame.device),
        ]
