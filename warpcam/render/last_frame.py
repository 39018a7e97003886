"""What a renderer keeps of a world from frame to frame, to be forgotten where the world begins anew."""

import math
from collections.abc import Iterable

import warp as wp

from warpcam.kernels.passes import film, flow
from warpcam.kernels.runtime.launch import Stage, prepare
from warpcam.render.camera_binding import CameraBinding
from warpcam.render.flow_history import ShapeHistory


class LastFrame:
    """What the next frame of a world goes on from.

    Args:
        shapes: Poses of the last frame; None where no camera has flow.
        cameras: The cameras, whose automatic exposures go on.
        device: Where their arrays lie.
    """

    def __init__(self, shapes: ShapeHistory | None, cameras: Iterable[CameraBinding], device: wp.Device):
        self._known = None if shapes is None else shapes.frame_state
        self._exposures = [each.arrays["auto_exposure"] for each in cameras if "auto_exposure" in each.arrays]
        self._device = device
        self._stages: list[Stage] = []

    @property
    def is_empty(self) -> bool:
        """True where nothing is kept."""
        return self._known is None and not self._exposures

    def bind(self, mask: wp.array) -> None:
        """Bind the stages that forget the worlds that a mask has."""
        self._stages = [film.bind_reset(exposure, mask, self._device) for exposure in self._exposures]
        if self._known is not None:
            self._stages.append(flow.bind_reset(self._known, mask, self._device))
        prepare(self._stages)

    def forget(self, everywhere: bool) -> None:
        """Forget all worlds, or those that the mask has now."""
        if not everywhere:
            for stage in self._stages:
                stage.launch()
            return
        for exposure in self._exposures:
            exposure.fill_(math.nan)
        if self._known is not None:
            self._known.zero_()
