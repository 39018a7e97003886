"""Random numbers with which episodes begin, drawn on the device for the worlds of a mask."""

import torch
import warp as wp

from warpcam.core import torch_interop
from warpcam.kernels.runtime.launch import bind_launch
from warpcam.kernels.update.starts import draw_starts


class Starts:
    """Numbers from 0 to 1 that follow from the seed, the world and the number of its episode alone.

    Nothing is allocated, waited for, or taken from torch's generators: drawing may be part of a CUDA graph.

    Args:
        num_worlds: Worlds.
        count: Numbers of an episode.
        seed: Whole number of 32 bits.
        device: Where they are drawn.

    Attributes:
        numbers: float32, (world, count), those of the worlds' episodes.
        episodes: int32, (world,), how many episodes have begun.
    """

    def __init__(self, num_worlds: int, count: int, seed: int, device: wp.Device):
        self._device = device
        arrays = (
            wp.zeros(num_worlds, dtype=wp.uint8, device=device),
            wp.zeros(1, dtype=wp.int32, device=device),
            wp.zeros(num_worlds, dtype=wp.int32, device=device),
            wp.zeros((num_worlds, count), dtype=wp.float32, device=device),
        )
        self._mask, self._seed, self.episodes, self.numbers = map(torch_interop.to_torch, arrays)
        self._stage = bind_launch(draw_starts, num_worlds * count, list(arrays), device)
        self._stage.prepare()
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Begin with the first episode of another seed."""
        self._seed.fill_(seed)
        self.episodes.zero_()

    def draw(self, mask: torch.Tensor) -> torch.Tensor:
        """Count another episode in the worlds of the mask, bool (world,), and draw its numbers; returns ``numbers``."""
        self._mask.copy_(mask)
        self.episodes.add_(self._mask)
        with torch_interop.in_order(self._device):
            self._stage.launch()
        return self.numbers
