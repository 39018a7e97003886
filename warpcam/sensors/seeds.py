"""Seeds of sensors."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError


def seeds_of(seed: Any, where: str, num_worlds: int, device: wp.Device) -> wp.array:
    """A seed for each world, (world,) int32, of a whole number or of one for each.

    Raises:
        WarpcamError: It is neither; the text begins with ``where``.
    """
    numbers = np.asarray(torch_interop.to_numpy(seed))
    whole = numbers.dtype.kind in "iu" and numbers.shape in ((), (num_worlds,))
    if not whole or (numbers < -(2**31)).any() or (numbers >= 2**31).any():
        raise WarpcamError(
            f"{where}: seed must be a whole number of 32 bits, or one for each world, ({num_worlds},), got {seed!r}"
        )
    return wp.array(np.broadcast_to(numbers, num_worlds).astype(np.int32), dtype=wp.int32, device=device)
