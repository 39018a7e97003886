"""Artefacts of JPEG compression."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.curves import byte_table
from warpcam.sensors.kernels.jpeg import (
    LANES,
    CodedImage,
    code_full_chroma,
    code_full_luma,
    code_half_chroma,
    code_half_luma,
    find_steps,
)

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
    takes_light = True
    reads_bytes = True
    writes_bytes = True
    starts_with_bytes = True

    def check(self, where: str) -> None:
        if not isinstance(self.subsampling, str) or self.subsampling not in get_args(Subsampling):
            allowed = ", ".join(map(repr, get_args(Subsampling)))
            raise WarpcamError(f"{where}: subsampling must be {allowed}, got {self.subsampling!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        is_full = self.subsampling == "4:4:4"
        scale = 1 if is_full else 2
        code_chroma = code_full_chroma if is_full else code_half_chroma
        code_luma = code_full_luma if is_full else code_half_luma
        worlds, pixels, device = len(frame.worlds), frame.width * frame.height, frame.device
        tables = wp.array(np.array([LUMA, CHROMA], np.float32).ravel(), dtype=wp.float32, device=device)
        image = CodedImage()
        image.width, image.height = frame.width, frame.height
        image.luma_across, image.luma_down = (-(-side // 8) for side in (frame.width, frame.height))
        image.chroma_across, image.chroma_down = (-(-side // (8 * scale)) for side in (frame.width, frame.height))
        of_luma, of_chroma = image.luma_across * image.luma_down, image.chroma_across * image.chroma_down
        image.is_linear = int(frame.is_linear)
        image.bytes_of_light = byte_table(device)
        image.steps = wp.empty((worlds, tables.size), dtype=wp.float32, device=device)
        image.luma = wp.empty((worlds, pixels), dtype=wp.uint8, device=device)
        image.chroma = wp.empty((worlds, 64 * of_chroma), dtype=wp.vec2ub, device=device)
        threads = worlds * (LANES if device.is_cuda else 1)
        inputs = [frame.mask, tables, frame.params.quality, image.steps]
        return [
            bind_launch(find_steps, worlds * tables.size, inputs, device),
            bind_launch(code_chroma, threads * of_chroma, [frame.mask, image, frame.color_source], device),
            bind_launch(code_luma, threads * of_luma, [frame.mask, image, frame.color_target], device),
        ]
