"""Depth of field: lenses that are in focus at one distance."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.core.shared_memory import shared
from warpcam.kernels.runtime.launch import Stage, bind_launch
from warpcam.sensors.effect import Effect, EffectFrame, parameter, side_by_side
from warpcam.sensors.kernels import depth_of_field as kernels

MAX_RADIUS = 64.0


@dataclass(frozen=True, eq=False)
class DepthOfField(Effect):
    """Blur of what is out of focus: each pixel's light spreads over its circle of confusion.

    A thin lens of focal length f and aperture A = f / f_number that is focused at d_f shows a point at depth d as a
    circle of diameter ``A f |d - d_f| / (d (d_f - f))`` on the sensor (similar triangles behind a thin lens). A pixel
    is f / (camera's focal length in pixels) wide; where that differs across and down, the geometric mean counts.

    A blurred surface spreads over what is behind it, and lets what is beside its edge through; a sharp one stays sharp
    before a blurred background. What a surface hides from the middle of the lens is not known, and is taken to be like
    what is beside it. Circles with a radius of up to half a pixel change nothing. At the border of the image, light
    comes from within it alone.

    Attributes:
        focus_distance: Depth that is sharp, more than the focal length [m]; a number or (world,).
        f_number: Focal length over diameter of the aperture; a number or (world,).
        focal_length: Of the lens [m]; a number or (world,).
        max_radius: Largest radius of a circle, at most 64 [pixels]; larger ones count as that. Cost grows with the area
            of the circles in sight.
    """

    focus_distance: Any = parameter(low=1e-3)
    f_number: Any = parameter(low=0.1, high=1e6)
    focal_length: Any = parameter(low=1e-6, high=10.0)
    max_radius: float = 16.0

    kind = "linear"
    reads = ("depth",)
    in_place = False
    needs_pinhole = True

    def check(self, where: str) -> None:
        radius = self.max_radius
        is_number = isinstance(radius, int | float | np.integer | np.floating) and not isinstance(radius, bool)
        if not is_number or not 0.0 < radius <= MAX_RADIUS:
            raise WarpcamError(f"{where}: max_radius must be above 0 and at most {MAX_RADIUS:g}, got {radius!r}")
        focus, focal = side_by_side(self, where, "focus_distance", "focal_length")
        near = focus[focus <= focal]
        if near.size:
            raise WarpcamError(f"{where}: focus_distance must be greater than focal_length, got {near[0]:g}")

    def bind(self, frame: EffectFrame) -> Sequence[Stage]:
        worlds, pixels = len(frame.worlds), frame.width * frame.height
        tiles = -(-frame.width // kernels.TILE) * -(-frame.height // kernels.TILE)
        lens, circles = kernels.ThinLens(), kernels.Circles()
        lens.focus_distance, lens.f_number = frame.params.focus_distance, frame.params.f_number
        lens.focal_length, lens.max_radius = frame.params.focal_length, self.max_radius
        circles.circle = wp.empty((worlds, pixels), dtype=wp.vec2, device=frame.device)
        circles.largest, circles.reach = (
            wp.empty((worlds, tiles), dtype=wp.float32, device=frame.device) for _ in range(2)
        )
        circles.width, circles.height = frame.width, frame.height
        depth = shared(frame.truth["depth"], (worlds, pixels), wp.float32)
        return [
            frame.per_pixel(kernels.find_circles, [frame.mask, frame.views, lens, depth, circles]),
            bind_launch(kernels.find_largest, worlds * tiles, [frame.mask, circles], frame.device),
            bind_launch(kernels.find_reach, worlds * tiles, [frame.mask, self.max_radius, circles], frame.device),
            frame.per_pixel(kernels.gather_light, [frame.mask, circles, frame.source, frame.target]),
        ]
