"""Descriptions of tensors, as Isaac Gym's calls hand them out and take them."""

import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.compat.isaacgym.api.enums import TensorDataType
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

DTYPES = {
    "torch.float32": TensorDataType.DTYPE_FLOAT32,
    "torch.uint8": TensorDataType.DTYPE_UINT8,
    "torch.int16": TensorDataType.DTYPE_INT16,
    "torch.int32": TensorDataType.DTYPE_INT32,
}


_memory: weakref.WeakValueDictionary[int, torch_interop.Tensor] = weakref.WeakValueDictionary()  # by address


class Tensor:
    """Description of a tensor, with its memory, which it keeps alive.

    Attributes:
        data_ptr: Where it is.
        device: CUDA ordinal, or -1 for the CPU.
        dtype: Of ``TensorDataType``.
        shape: Of as many numbers as it has dimensions; of flow (height, width), as Isaac Gym describes it.
    """

    def __init__(self, tensor: torch_interop.Tensor, shape: Sequence[int] | None = None):
        self.torch = tensor
        self.data_ptr = tensor.data_ptr()
        self.device = tensor.device.index or 0 if tensor.device.type == "cuda" else -1
        self.dtype = DTYPES[str(tensor.dtype)]
        self.shape = list(tensor.shape if shape is None else shape)
        _memory[self.data_ptr] = tensor

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __repr__(self) -> str:
        where = "cpu" if self.device < 0 else f"cuda:{self.device}"
        return f"Tensor({self.dtype.name}, shape {self.shape}, {where})"


def wrap(tensor: Any, offsets: Sequence[int] | None, counts: Sequence[int] | None) -> torch_interop.Tensor | None:
    """The memory as a torch tensor: the same at every call. None if there are no numbers in it."""
    if not isinstance(tensor, Tensor):
        raise WarpcamError(f"wrap_tensor: a tensor of gymapi is needed, got {type(tensor).__name__}")
    if tensor.torch.numel() == 0:
        return None
    return _part(tensor.torch, offsets, counts, "wrap_tensor")


def wrap_at(
    data_ptr: Any, device: Any, dtype: Any, shape: Sequence[int], offsets: Sequence[int] | None, counts: Any
) -> torch_interop.Tensor:
    """The memory at an address that a tensor has named, in any shape of as many numbers."""
    where = "wrap_tensor_impl"
    tensor = _memory.get(int(data_ptr))
    if tensor is None:
        raise WarpcamError(f"{where}: no tensor of gymapi that is still there begins at {data_ptr!r}")
    known = Tensor(tensor)
    if int(device) != known.device or int(dtype) != int(known.dtype):
        raise WarpcamError(f"{where}: device {device!r} and dtype {dtype!r} came, but there is {known}")
    if int(np.prod(tuple(shape))) != tensor.numel():
        raise WarpcamError(f"{where}: shape {tuple(shape)} came, but there are {tensor.numel()} numbers")
    return _part(tensor.view(tuple(shape)), offsets, counts, where)


def _part(view: torch_interop.Tensor, offsets: Any, counts: Any, where: str) -> torch_interop.Tensor:
    dims = view.dim()
    for name, numbers in (("offsets", offsets), ("counts", counts)):
        if numbers is not None and len(numbers) != dims:
            raise WarpcamError(f"{where}: {name} must be {dims} numbers, one a dimension, got {numbers!r}")
    for dim in range(dims) if offsets is not None or counts is not None else ():
        first = 0 if offsets is None else int(offsets[dim])
        count = view.shape[dim] - first if counts is None else int(counts[dim])
        if first < 0 or count < 0 or first + count > view.shape[dim]:
            raise WarpcamError(
                f"{where}: {count} from {first} on are asked for in dimension {dim}, which has {view.shape[dim]}"
            )
        view = view.narrow(dim, first, count)
    return view


def unwrap(tensor: Any) -> Tensor:
    """Return the description of a torch tensor that calls which set states take; its memory is read, never kept."""
    if not isinstance(tensor, torch_interop.Tensor):
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
    tensor = value.torch.detach().contiguous().to(torch_interop.device_of(device)).reshape(shape)
    return torch_interop.as_array(tensor)
