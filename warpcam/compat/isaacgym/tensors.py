"""Descriptions of tensors, as Isaac Gym's calls hand them out and take them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam import interop
from warpcam.compat.isaacgym.kinds import TensorDataType
from warpcam.errors import WarpcamError

DTYPES = {
    "torch.float32": TensorDataType.DTYPE_FLOAT32,
    "torch.uint8": TensorDataType.DTYPE_UINT8,
    "torch.int16": TensorDataType.DTYPE_INT16,
    "torch.int32": TensorDataType.DTYPE_INT32,
}


class Tensor:
    """What is known of a tensor, and the memory itself, which it keeps alive.

    Attributes:
        data_ptr: Where it is.
        device: CUDA ordinal, or -1 for the CPU.
        dtype: Of ``TensorDataType``.
        shape: Of as many numbers as it has dimensions.
    """

    def __init__(self, tensor: interop.Tensor):
        self.torch = tensor
        self.data_ptr = tensor.data_ptr()
        self.device = tensor.device.index or 0 if tensor.device.type == "cuda" else -1
        self.dtype = DTYPES[str(tensor.dtype)]
        self.shape = list(tensor.shape)

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __repr__(self) -> str:
        where = "cpu" if self.device < 0 else f"cuda:{self.device}"
        return f"Tensor({self.dtype.name}, shape {self.shape}, {where})"


def wrap(tensor: Any, offsets: Sequence[int] | None, counts: Sequence[int] | None) -> interop.Tensor:
    """The memory as a torch tensor: the same at every call."""
    if not isinstance(tensor, Tensor):
        raise WarpcamError(f"wrap_tensor: a tensor of gymapi is needed, got {type(tensor).__name__}")
    view = tensor.torch
    for name, numbers in (("offsets", offsets), ("counts", counts)):
        if numbers is not None and len(numbers) != tensor.ndim:
            raise WarpcamError(f"wrap_tensor: {name} must be {tensor.ndim} numbers, one a dimension, got {numbers!r}")
    for dim in range(tensor.ndim) if offsets is not None or counts is not None else ():
        first = 0 if offsets is None else int(offsets[dim])
        count = view.shape[dim] - first if counts is None else int(counts[dim])
        if first < 0 or count < 0 or first + count > view.shape[dim]:
            raise WarpcamError(
                f"wrap_tensor: {count} from {first} on are asked for in dimension {dim}, which has {view.shape[dim]}"
            )
        view = view.narrow(dim, first, count)
    return view


def unwrap(tensor: Any) -> Tensor:
    """What calls that set states take, of a torch tensor; its memory is read, never kept."""
    if not isinstance(tensor, interop.Tensor):
        raise WarpcamError(f"unwrap_tensor: a torch tensor is needed, got {type(tensor).__name__}")
    if str(tensor.dtype) not in DTYPES:
        allowed = ", ".join(DTYPES)
        raise WarpcamError(f"unwrap_tensor: dtype {tensor.dtype} came; allowed are {allowed}")
    if not tensor.is_contiguous():
        raise WarpcamError("unwrap_tensor: the tensor is not contiguous in memory; call contiguous() first")
    return Tensor(tensor)


def take(value: Any, where: str, dtype: Any, shape: tuple[int, ...], device: wp.Device) -> wp.array:
    """The numbers of a described tensor on the device, in that shape; those that lie elsewhere are copied."""
    if not isinstance(value, Tensor):
        raise WarpcamError(f"{where}: gymtorch.unwrap_tensor(tensor) is needed, got {type(value).__name__}")
    name = {wp.float32: "torch.float32", wp.int32: "torch.int32"}[dtype]
    size = int(np.prod(shape))
    if str(value.torch.dtype) != name or value.torch.numel() != size:
        raise WarpcamError(
            f"{where}: {name} of shape {shape} is needed, got {value.torch.dtype} of {tuple(value.torch.shape)}"
        )
    tensor = value.torch.detach().contiguous().to(interop.device_of(device)).reshape(shape)
    return interop.as_array(tensor)
