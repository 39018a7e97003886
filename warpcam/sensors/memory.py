"""Arrays that share their memory."""

from typing import Any

import warp as wp


def shared(array: wp.array, shape: tuple[int, ...], dtype: Any) -> wp.array:
    """The array's memory, which is contiguous, in another shape and type."""
    other = wp.array(ptr=array.ptr, shape=shape, dtype=dtype, device=array.device)
    other._ref = array  # keeps the memory
    return other
