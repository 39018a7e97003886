"""Processes that learn together, one for each GPU, as ``torchrun`` starts them."""

import os
from dataclasses import dataclass

import torch
import warp as wp

from warpcam.core.device import resolve
from warpcam.core.errors import WarpcamError

SEEDS = 1 << 20  # between two ranks


@dataclass(frozen=True)
class Rank:
    """Place of this process among those that learn together.

    Attributes:
        number: From 0 to ``count`` - 1.
        local: Number among the processes of this host.
        count: Processes of all hosts.
    """

    number: int = 0
    local: int = 0
    count: int = 1

    @classmethod
    def here(cls) -> "Rank":
        """Read what ``torchrun`` put in the environment; one process alone without it."""
        return cls(
            *(int(os.environ.get(*entry)) for entry in (("RANK", "0"), ("LOCAL_RANK", "0"), ("WORLD_SIZE", "1")))
        )

    @property
    def writes(self) -> bool:
        """True in the one process that writes files and prints."""
        return self.number == 0

    def device(self, asked: str | None) -> str:
        """Alias of this process's device: the GPU of its local number, if there are several processes and GPUs.

        That GPU becomes the current device of torch and Warp, so that what names none has no memory on another's.
        """
        if self.count == 1 or (asked is not None and resolve(asked).is_cpu):
            return resolve(asked).alias
        if asked not in (None, "cuda"):
            raise WarpcamError(
                f"--device: {asked!r} came, but each of {self.count} processes has a GPU of its own; leave it out, or "
                "give cpu"
            )
        if resolve(None).is_cpu:
            return "cpu"
        found = torch.cuda.device_count()
        if self.local >= found:
            raise WarpcamError(
                f"{self.local + 1} processes or more came on this host, which has {found} GPUs; start one for each"
            )
        torch.cuda.set_device(self.local)
        wp.set_device(f"cuda:{self.local}")
        return f"cuda:{self.local}"

    def seed(self, seed: int) -> int:
        """Seed of this process: the seed itself in the first, others in others."""
        return (seed + SEEDS * self.number) % 2**31

    def close(self) -> None:
        """Leave the group of processes, if there is one."""
        if torch.distributed.is_available() and torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()
