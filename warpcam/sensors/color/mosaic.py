"""Bayer mosaic of a colour sensor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage
from warpcam.sensors.effect import Effect, EffectFrame
from warpcam.sensors.kernels.mosaics import Mosaic, interpolate_bilinearly, interpolate_with_gradients

Filters = Literal["RGGB", "BGGR", "GRBG", "GBRG"]
Interpolation = Literal["bilinear", "malvar"]


@dataclass(frozen=True, eq=False)
class BayerMosaic(Effect):
    """Bayer mosaic: a pixel measures one channel, the other two are interpolated.

    "bilinear" takes means of the nearest pixels with the channel. "malvar" has the linear filters of 5 x 5 pixels of
    Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images", ICASSP
    2004, cut off below 0. The image is mirrored at its borders; it must have at least 3 x 3 pixels.

    Attributes:
        filters: Filters of the first 2 x 2 pixels, row by row.
        interpolation: "bilinear" or "malvar".
    """

    filters: Filters = "RGGB"
    interpolation: Interpolation = "malvar"

    kind = "linear"
    in_place = False
    writes_bytes = True
    least_size = 3

    def check(self, where: str) -> None:
        for name, kind in (("filters", Filters), ("interpolation", Interpolation)):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in get_args(kind):
                raise WarpcamError(f"{where}: {name} must be {', '.join(map(repr, get_args(kind)))}, got {value!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        mosaic = Mosaic()
        mosaic.numbers = shared(frame.source, (len(frame.worlds), 3 * frame.width * frame.height), wp.float32)
        mosaic.width, mosaic.height = frame.width, frame.height
        mosaic.red_row, mosaic.red_column = divmod(self.filters.index("R"), 2)
        kernel = interpolate_bilinearly if self.interpolation == "bilinear" else interpolate_with_gradients
        return [frame.per_strip(kernel, [frame.mask, frame.size, mosaic, frame.color_target])]
