"""Steps of a batch of worlds whose numbers tell the world, the episode and the row, for tests of writers."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
import warp as wp

from warpcam.core import torch_interop

HEIGHT, WIDTH = 16, 24


def image(world: int, episode: int, row: int) -> np.ndarray:
    """A flat colour of its own, (height, width, 3) uint8."""
    color = np.array((40 + 30 * world, 60 + 40 * (episode % 4), 20 + 16 * (row % 12)), np.uint8)
    return np.broadcast_to(color, (HEIGHT, WIDTH, 3)).copy()


def depth(world: int, episode: int, row: int) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 1), world + 0.1 * episode + 0.01 * row, np.float32)


def state(world: int, episode: int, row: int) -> np.ndarray:
    return np.array((world, episode, row), np.float32)


def action(world: int, episode: int, row: int) -> np.ndarray:
    return np.array((10 * world + row, -episode), np.float32)


class Worlds:
    """World ``w`` has episodes of ``lengths[w]`` rows, one after the other; each is successful if its number is even.

    Observations are memory that is written over at each step, as a renderer's is.
    """

    def __init__(self, lengths: tuple[int, ...], device: wp.Device):
        self._lengths = np.array(lengths)
        self.device = torch_interop.device_of(device)
        self.episode, self.row = np.zeros(len(lengths), int), np.zeros(len(lengths), int)
        self.images = torch.zeros((len(lengths), HEIGHT, WIDTH, 3), dtype=torch.uint8, device=self.device)

    def _batch(self, of_one: Any) -> torch.Tensor:
        rows = zip(range(len(self.row)), self.episode.tolist(), self.row.tolist(), strict=True)
        return torch.as_tensor(np.stack([of_one(*row) for row in rows]), device=self.device)

    def observations(self) -> dict[str, torch.Tensor]:
        self.images.copy_(self._batch(image))
        return {"front_rgb": self.images, "front_depth": self._batch(depth), "state": self._batch(state)}

    def ends(self) -> dict[str, torch.Tensor]:
        """Actions, rewards and ends of the step; the next row follows."""
        actions, rewards = self._batch(action), self._batch(lambda world, episode, row: np.float32(row))
        ended = self.row + 1 == self._lengths
        odd = np.arange(len(ended)) % 2 == 1
        flags = {"terminated": ended & ~odd, "truncated": ended & odd, "success": ended & (self.episode % 2 == 0)}
        self.episode, self.row = self.episode + ended, np.where(ended, 0, self.row + 1)
        told = {name: torch.as_tensor(flag, device=self.device) for name, flag in flags.items()}
        return {"actions": actions, "rewards": rewards, **told}


def finished(lengths: tuple[int, ...], steps: int) -> Iterator[tuple[int, int]]:
    """World and episode of what has finished, in the order in which it did."""
    for step in range(1, steps + 1):
        for world, length in enumerate(lengths):
            if step % length == 0:
                yield world, step // length - 1
