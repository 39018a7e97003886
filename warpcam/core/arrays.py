"""Checks of numbers that a user gives for each world."""

from typing import Any

import numpy as np

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

MAX_EXPOSURE = 127  # beyond, 2 to it is no float32


def as_numbers(value: Any, where: str, allowed: str = "numbers") -> np.ndarray:
    """A user's numbers as an array on the host, of whatever shape and real dtype.

    Raises:
        WarpcamError: ``value`` is no array of numbers; the text says that ``where`` must be ``allowed``.
    """
    try:
        raw = np.asarray(torch_interop.to_numpy(value))
    except (TypeError, ValueError, RuntimeError):
        raise WarpcamError(f"{where} must be {allowed}, got {value!r}") from None
    if raw.dtype.kind not in "iuf":
        raise WarpcamError(f"{where} must be {allowed}, got {value!r}")
    return raw


def per_world(
    value: Any, where: str, num_worlds: int, width: tuple[int, ...], *, may_be_infinite: bool = False
) -> np.ndarray:
    """``value`` for every world: (world, *width) float32.

    Raises:
        WarpcamError: It is neither (*width) nor (world, *width), or holds something else than finite numbers.
    """
    allowed = f"{width or 'a number'} or {(num_worlds, *width)}"
    torch_interop.require_wxyz(value, where)
    raw = as_numbers(value, where, f"numbers, {allowed}")
    with np.errstate(over="ignore"):  # what float32 cannot hold is not finite
        numbers = raw.astype(np.float32)
    if numbers.shape not in (width, (num_worlds, *width)):
        raise WarpcamError(f"{where} must have shape {allowed}, got {numbers.shape}")
    unusable = np.isnan(numbers) | (np.isinf(numbers) & (numbers < 0.0 if may_be_infinite else True))
    if unusable.any():
        raise WarpcamError(f"{where} must be finite, got {numbers[unusable].flat[0]}")
    return np.ascontiguousarray(np.broadcast_to(numbers, (num_worlds, *width)))
