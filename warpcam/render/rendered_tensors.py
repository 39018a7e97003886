"""Images and numbers of a renderer's last frame as tensors."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import warp as wp

from warpcam.core import torch_interop
from warpcam.core.torch_interop import torch
from warpcam.kernels.passes.views import FrameCounters

# `torch_interop` is a name in every module that annotates with it: hints are evaluated there.
Images = dict[str | int, dict[str, "torch_interop.Tensor"]]


class RenderedTensors:
    """Tensors in the memory of arrays, made when they are first asked for; on CUDA with the object.

    Args:
        images: By camera and output.
        faults: See ``Renderer.faulty``.
        counters: Of frames, with their times.
        device: Where all of them lie.
    """

    def __init__(
        self,
        images: Mapping[str | int, Mapping[str, wp.array]],
        faults: wp.array,
        counters: FrameCounters,
        device: wp.Device,
    ):
        self._rendered, self._numbers = images, (faults, counters.frames, counters.times)
        if device.is_cuda:  # a capture, within which a process's first tensors may not be made, may begin at once
            _ = self.images, self.faulty, self.frames, self.times

    @cached_property
    def images(self) -> Images:
        return {
            key: {name: torch_interop.to_torch(array) for name, array in arrays.items()}
            for key, arrays in self._rendered.items()
        }

    @cached_property
    def faulty(self) -> torch.Tensor:
        return torch_interop.to_torch(self._numbers[0])

    @cached_property
    def frames(self) -> torch.Tensor:
        return torch_interop.to_torch(self._numbers[1])

    @cached_property
    def times(self) -> torch.Tensor:
        return torch_interop.to_torch(self._numbers[2])
