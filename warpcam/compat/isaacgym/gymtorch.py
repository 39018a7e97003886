"""Tensors of ``gymapi`` as torch tensors, and back: always the same memory."""

from collections.abc import Sequence

from warpcam.compat.isaacgym.api.tensors import Tensor, unwrap, wrap, wrap_at
from warpcam.core import torch_interop

__all__ = ["unwrap_tensor", "wrap_tensor", "wrap_tensor_impl"]


def wrap_tensor(
    gym_tensor: Tensor, offsets: Sequence[int] | None = None, counts: Sequence[int] | None = None
) -> torch_interop.Tensor | None:
    """The memory of a tensor as a torch tensor. It costs nothing, and the address never changes.

    None, as there, of what a simulation has none of, such as states of degrees of freedom: never of an image.

    Args:
        gym_tensor: As calls of ``gymapi`` hand it out.
        offsets: First index of each dimension; None is 0.
        counts: How many of each dimension; None is all that follow.
    """
    return wrap(gym_tensor, offsets, counts)


def wrap_tensor_impl(
    data_ptr: int,
    device: int,
    dtype: int,
    shape: Sequence[int],
    offsets: Sequence[int] | None = None,
    counts: Sequence[int] | None = None,
) -> torch_interop.Tensor:
    """The memory of a tensor in another shape, as programs ask for it that read optical flow as (height, width, 2).

    Args:
        data_ptr: Of a tensor that calls of ``gymapi`` have handed out.
        device: Of that tensor.
        dtype: Of that tensor.
        shape: Of as many numbers as there are.
        offsets: As ``wrap_tensor`` has them.
        counts: As ``wrap_tensor`` has them.
    """
    return wrap_at(data_ptr, device, dtype, shape, offsets, counts)


def unwrap_tensor(torch_tensor: torch_interop.Tensor) -> Tensor:
    """Return the description of a torch tensor that calls of ``gymapi`` which set states take."""
    return unwrap(torch_tensor)
