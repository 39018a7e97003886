"""Seeds of random numbers, one for each world."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.core.arrays import as_numbers
from warpcam.core.errors import WarpcamError


def seeds_of(seed: Any, where: str, num_worlds: int, device: wp.Device) -> wp.array:
    """A seed for each world, (world,) int32, of a whole number or of one for each.

    Raises:
        WarpcamError: It is neither; the text begins with ``where``.
    """
    name = f"{where}: seed"
    allowed = f"a whole number of 32 bits, -2^31 to 2^31 - 1, or one for each world, ({num_worlds},)"
    numbers = as_numbers(seed, name, allowed)
    whole = numbers.dtype.kind in "iu" and numbers.shape in ((), (num_worlds,))
    if not whole or (numbers < -(2**31)).any() or (numbers >= 2**31).any():
        raise WarpcamError(f"{name} must be {allowed}, got {seed!r}")
    return wp.array(np.broadcast_to(numbers, num_worlds).astype(np.int32), dtype=wp.int32, device=device)
