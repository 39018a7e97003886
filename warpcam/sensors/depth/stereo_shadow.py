"""Holes behind edges: what the second imager of a stereo camera does not see."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter
from warpcam.sensors.kernels.stereo_shadow import PARTS, drop_hidden, find_nearest, find_nearest_of_parts


@dataclass(frozen=True, eq=False)
class StereoShadow(Effect):
    """No measurement where the second imager sees something nearer.

    Each pixel is projected into the second image, ``f B / z`` pixels aside. It is a hole if a nearer surface of its row
    covers that place: neighbours whose disparities differ by at most a pixel are one surface and cover what lies
    between them, an end of a surface covers half a pixel more. That is exact up to the pixels of the image for all that
    the first imager sees itself; a surface that it does not see casts no shadow. Only pixels nearer to the second
    imager's side than the row's greatest disparity are looked at, so the cost is that of as many loads.

    Attributes:
        baseline: Place of the second imager to the right of the first one, whose depth it is; negative to the left [m];
            a number or (world,).
        border: Pixels whose place lies outside of the second image are holes, too: the band at the edge that Intel's
            datasheet calls invalid.
    """

    baseline: Any = parameter()
    border: bool = True

    kind = "depth"
    in_place = False
    needs_pinhole = True

    def check(self, where: str) -> None:
        if not isinstance(self.border, bool | np.bool_):
            raise WarpcamError(f"{where}: border must be True or False, got {self.border!r}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        worlds, rows = len(frame.worlds), len(frame.worlds) * frame.height
        parts = wp.empty((worlds, frame.height, PARTS), dtype=wp.float32, device=frame.device)
        nearest = wp.empty((worlds, frame.height), dtype=wp.float32, device=frame.device)
        inputs = [frame.mask, frame.views, frame.size, int(self.border), frame.params.baseline, nearest]
        of_parts = [frame.mask, frame.width, frame.source, parts]
        return [
            bind_launch(find_nearest_of_parts, rows * PARTS, of_parts, frame.device),
            bind_launch(find_nearest, rows, [frame.mask, parts, nearest], frame.device),
            frame.per_strip(drop_hidden, [*inputs, frame.source, frame.target]),
        ]
