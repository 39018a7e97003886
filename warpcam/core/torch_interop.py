"""Exchange of arrays between Warp and torch.

Importing torch takes seconds: ``torch`` here is imported when something of it is first asked for. Modules that are
imported with the package take it from here, with annotations that are not evaluated; front ends whose data are
torch's, training, datasets and the command line import torch themselves.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError

if TYPE_CHECKING:
    import torch as torch  # to be taken from here

    Tensor = torch.Tensor
else:

    class _LateModule(ModuleType):
        """A module that is imported when something of it is first asked for."""

        def __getattr__(self, name: str) -> Any:
            if name.startswith("__"):  # what tools look for, none of it torch's
                raise AttributeError(name)
            module = import_module(self.__name__)
            self.__dict__.update(vars(module))  # from now on found as fast as in the module itself
            return getattr(module, name)

    torch = _LateModule("torch")

    def __getattr__(name: str) -> Any:
        if name == "Tensor":
            return torch.Tensor
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


# CUDA's legacy default stream, which torch begins with: it and streams that are blocking wait for each other by
# themselves.
LEGACY = 0


def to_torch(array: wp.array) -> torch.Tensor:
    """Return a tensor that shares the array's memory and keeps it alive.

    Whatever torch's default device is, and also within its inference mode, whose tensors cannot be written later.
    """
    with torch.inference_mode(False):
        if array.device.is_cpu:
            return torch.from_numpy(np.asarray(array))
        return wp.to_torch(array, requires_grad=False)


def as_array(value: Any) -> wp.array | None:
    """Return a Warp array that shares the memory of a tensor or a Warp array.

    None for anything else, and for dtypes that Warp lacks.

    Such as dtypes, devices, and tensors without a dimension.
    """
    if isinstance(value, wp.array):
        return value
    if is_tensor(value) and value.ndim:
        try:
            return wp.from_torch(value.detach())
        except (TypeError, RuntimeError):  # a dtype, or a device
            return None
    return None


def is_tensor(value: Any) -> bool:
    """Return whether it is one; imports nothing, as there are tensors only where torch has been imported."""
    return "torch" in sys.modules and isinstance(value, torch.Tensor)


def to_tensor(value: Any, device: torch.device) -> torch.Tensor:
    """Numbers in any form as a tensor there, in the same memory if they lie there already."""
    if isinstance(value, wp.array):
        value = to_torch(value)
    return torch.as_tensor(value, device=device)


def copied(tensor: torch.Tensor) -> torch.Tensor:
    """Return a contiguous copy."""
    return tensor.clone(memory_format=torch.contiguous_format)


def concatenate(tensors: Sequence[torch.Tensor], axis: int) -> torch.Tensor:
    return torch.cat(list(tensors), dim=axis)


def to_numpy(value: Any) -> np.ndarray:
    """A copy on the host of numbers in any form: torch, Warp, numpy or plain."""
    if is_tensor(value):
        host = value.detach().cpu()
        return host.float().numpy() if host.dtype is torch.bfloat16 else host.numpy()
    if isinstance(value, wp.array):
        return value.numpy()
    return np.asarray(value)


def require_wxyz(value: Any, where: str) -> None:
    """Raise for Warp's own quaternions and transforms, whose w is last: their numbers would be read as w x y z."""
    first = value
    while isinstance(first, list | tuple) and first:
        first = first[0]
    is_array = isinstance(first, wp.array)
    kind = first.dtype if is_array else type(first)
    is_quaternion = wp.types.type_is_quaternion(kind)
    if is_quaternion or wp.types.type_is_transformation(kind):
        came, give = f"a Warp array of {kind.__name__}", "an array of float32"
        if not is_array:
            came, give = f"Warp's own {'wp.quat' if is_quaternion else 'wp.transform'}", "plain numbers"
        raise WarpcamError(
            f"{where} must be numbers with quaternions w x y z, got {came}, which has x y z w; give {give}"
        )


def as_tensor(array: np.ndarray) -> torch.Tensor:
    """Return a tensor on the host that shares the array's memory."""
    return torch.from_numpy(array)


def is_capturing(device: wp.Device) -> bool:
    """Return whether work that is put on the device now becomes part of a graph that is being captured."""
    if device.is_capturing:
        return True
    if not device.is_cuda:
        return False
    with torch.cuda.device(device.ordinal):
        return torch.cuda.is_current_stream_capturing()


def require_no_capture(device: wp.Device, what: str) -> None:
    """Raise if what is to be made now would become part of a capture of the user's own.

    A renderer that records a graph in another thread does so on a stream of its own, and is none of that.
    """
    if device.is_cuda:
        with torch.cuda.device(device.ordinal):
            capturing = device.stream.is_capturing or torch.cuda.is_current_stream_capturing()
    else:
        capturing = device.is_capturing
    if capturing:
        raise WarpcamError(f"{what}: a capture is under way; do this before it")


@contextmanager
def in_order(device: wp.Device) -> Iterator[bool]:
    """Inside, work on Warp's current stream is ordered with torch's current stream of the device, before and after.

    Under a capture the work goes to the stream that is captured, and waits for no other. Afterwards the same device is
    current as before. Gives what ``is_capturing`` does.
    """
    if not device.is_cuda:
        yield device.is_capturing
        return
    with wp.ScopedDevice(device):
        if device.is_capturing:
            yield True
            return
        ours, theirs = device.stream, torch.cuda.current_stream(device.ordinal).cuda_stream
        if theirs == LEGACY and ours.is_blocking:
            yield False
            return
        with _between(ours, _stream(device.ordinal, theirs)) as capturing:
            yield capturing


@contextmanager
def _between(ours: wp.Stream, theirs: wp.Stream) -> Iterator[bool]:
    if theirs.is_capturing:
        with wp.ScopedStream(theirs, sync_enter=False):
            yield True
        return
    apart = theirs.cuda_stream != ours.cuda_stream
    if apart:
        ours.wait_stream(theirs)
    try:
        yield False
    finally:  # what was queued before an error, too
        if apart:
            theirs.wait_stream(ours)


@lru_cache(maxsize=64)
def _stream(ordinal: int, handle: int) -> wp.Stream:
    return wp.Stream(wp.get_cuda_device(ordinal), cuda_stream=handle)


def is_out_of_memory(error: Exception) -> bool:
    """Return whether torch raised it for a device that has no memory left."""
    return "torch" in sys.modules and isinstance(error, torch.OutOfMemoryError)


def device_of(device: wp.Device) -> torch.device:
    """Convert a Warp device to a torch device."""
    return torch.device(wp.device_to_torch(device))
