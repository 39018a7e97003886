"""Masks of the worlds that a frame draws."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.core import device as device_rule
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError
from warpcam.kernels.passes.views import mark_worlds
from warpcam.kernels.runtime.launch import launch_kernel


class Selection:
    """A mask on the device.

    Attributes:
        mask: uint8, (world,); worlds with 0 are left alone.
    """

    def __init__(self, num_worlds: int, device: wp.Device):
        self._num_worlds, self._device, self._call = num_worlds, device, "render"
        self.mask = wp.full(num_worlds, 1, dtype=wp.uint8, device=device)

    def select(self, worlds: Any, capturing: bool, call: str) -> None:
        """Make ``mask`` be of ``worlds``: see ``Renderer.render``; ``call`` is what the user called."""
        self._call = call
        on_device = torch_interop.as_array(worlds)
        if on_device is None or (on_device.device != self._device and on_device.device.is_cpu):
            self._select_host(torch_interop.to_numpy(worlds) if on_device is not None else worlds, capturing)
            return
        device_rule.require_same(self._device, "the scene is", on_device.device, f"{self._call}: worlds")
        if on_device.dtype in (wp.bool, wp.uint8):
            self._check_mask(on_device.shape)
            mask = on_device if on_device.dtype is wp.uint8 else on_device.view(wp.uint8)
            wp.copy(self.mask, mask)
            return
        if on_device.ndim != 1 or on_device.dtype not in (wp.int32, wp.int64):
            raise WarpcamError(
                f"{self._call}: worlds must be ids (n,) of int32 or int64, or a mask ({self._num_worlds},) of bool or "
                f"uint8, got {on_device.dtype.__name__} {tuple(on_device.shape)}"
            )
        if not capturing:
            self._check_ids(on_device.numpy())
        self.mask.zero_()
        if on_device.size:
            launch_kernel(mark_worlds, on_device.size, [on_device, self.mask], device=self._device)

    def _select_host(self, worlds: Any, capturing: bool) -> None:
        if capturing:
            raise WarpcamError(
                f"{self._call}: a capture is under way, and worlds on the host cannot become part of it; give ids or a "
                f"mask as a tensor on {self._device.alias}"
            )
        try:
            values = np.asarray(worlds)
        except (TypeError, ValueError, RuntimeError):
            values = np.zeros((), object)
        if values.ndim == 1 and values.size == 0 and not isinstance(worlds, np.ndarray):
            values = values.astype(np.int64)
        # In a list of truths and numbers numpy has numbers alone.
        mixed = values.dtype.kind in "iu" and _has_truths(worlds)
        if values.ndim != 1 or values.dtype.kind not in "iub" or mixed:
            raise WarpcamError(
                f"{self._call}: worlds must be ids (n,), or a mask ({self._num_worlds},) of bool or uint8, got "
                f"{worlds!r}"
            )
        if values.dtype in (np.bool_, np.uint8):
            self._check_mask(values.shape)
            mask = values.astype(np.uint8)
        else:
            self._check_ids(values)
            mask = np.zeros(self._num_worlds, np.uint8)
            mask[values] = 1
        self.mask.assign(mask)

    def _check_mask(self, shape: tuple[int, ...]) -> None:
        if tuple(shape) != (self._num_worlds,):
            raise WarpcamError(
                f"{self._call}: worlds as a mask must have shape ({self._num_worlds},), got {tuple(shape)}"
            )

    def _check_ids(self, ids: np.ndarray) -> None:
        outside = ids[(ids < 0) | (ids >= self._num_worlds)]
        if outside.size:
            raise WarpcamError(f"{self._call}: worlds has id {outside[0]}; allowed are 0 to {self._num_worlds - 1}")


def _has_truths(values: Any) -> bool:
    return isinstance(values, Sequence) and any(isinstance(value, bool | np.bool_) for value in values)
