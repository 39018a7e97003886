"""Arrays that share their memory."""

from typing import Any

import warp as wp


def shared(array: wp.array, shape: tuple[int, ...], dtype: Any, start: int = 0) -> wp.array:
    """Return an array over the memory of another, which is contiguous, in another shape and type.

    Args:
        array: Lives as long as what is returned.
        shape: Of what is returned.
        dtype: Likewise.
        start: Bytes of ``array`` before it.
    """

    def keep(_start: int, _size: int, _array: wp.array = array) -> None: ...

    return wp.array(ptr=array.ptr + start, shape=shape, dtype=dtype, device=array.device, deleter=keep)
