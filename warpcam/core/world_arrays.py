"""Arrays with a number or a row for each world, by name, that are written in place."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError


class NoArrayError(WarpcamError, AttributeError):
    """An array that is not there, or that is not to be replaced."""


class WorldArrays:
    """Tensors (world, ...) on the scene's device, as attributes; what is written to them counts from the next frame.

    Args:
        where: Prefix of error messages.
        arrays: By name.
        num_worlds: How many worlds there are.
        device: Where the arrays lie.
        ranges: Lowest and highest value of some of them, by name.
    """

    def __init__(
        self,
        where: str,
        arrays: Mapping[str, wp.array],
        num_worlds: int,
        device: wp.Device,
        ranges: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    ):
        self._where, self._num_worlds, self._device, self._ranges = where, num_worlds, device, ranges
        self._arrays = dict(arrays)
        if device.is_cuda:  # a capture, within which a process's first tensors may not be made, may begin at once
            for name in arrays:
                getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._arrays]

    def __setattr__(self, name: str, value: Any) -> None:
        if name.startswith("_"):
            super().__setattr__(name, value)
        elif value is not getattr(self, name):  # front.fovy += 1.0 puts back what it has written to
            raise NoArrayError(f"{self._where}: {name} cannot be replaced; write to it in place: {name}[:] = ...")

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._arrays:  # not in __dict__ yet
            return self.__dict__.setdefault(name, torch_interop.to_torch(self._arrays[name]))
        raise NoArrayError(
            f"{self._where} has no array {name!r} of its own, it has {', '.join(self._arrays)}{self._instead(name)}"
        )

    def __reduce__(self) -> Any:
        raise WarpcamError(f"{self._where}: its arrays cannot be copied or pickled: no frame would read the copy")

    def _instead(self, name: str) -> str:
        """End of the error about an array that is not there."""
        return ""


def world_count(arrays: WorldArrays) -> tuple[int, wp.Device]:
    """Number of worlds, and the device of the arrays."""
    return arrays._num_worlds, arrays._device


def ranges_of(arrays: WorldArrays) -> Mapping[str, tuple[float, float]]:
    """Lowest and highest value of arrays that have limits, by name."""
    return arrays._ranges
