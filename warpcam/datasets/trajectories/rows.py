"""One step of a batch of worlds: arrays by name, copied to the host without waiting for the device."""

import queue
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
import warp as wp

from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

Columns = dict[str, torch.Tensor]
WAIT = 0.1  # between two looks at whether the thread that frees memory has failed [s]


def flattened(name: str, value: Any) -> Iterator[tuple[str, torch.Tensor]]:
    """Yield the tensors of a nested mapping, each with the keys that lead to it, joined by ``/``."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            if not isinstance(key, str) or not key or key.startswith("/") or key.endswith("/"):
                raise WarpcamError(f"Writer: {name} has the key {key!r}, keys must be names")
            yield from flattened(f"{name}/{key}", part)
        return
    if isinstance(value, wp.array):
        with torch_interop.in_order(value.device):  # torch's copies come after what Warp's stream writes
            value = torch_interop.to_torch(value)
    try:
        tensor = value.detach() if isinstance(value, torch.Tensor) else torch.as_tensor(np.asarray(value))
    except (TypeError, ValueError) as error:
        raise WarpcamError(f"Writer: {name} must be an array (world, ...), got {type(value).__name__}") from error
    if tensor.dtype is torch.bfloat16 or tensor.is_complex():
        raise WarpcamError(f"Writer: {name} has dtype {tensor.dtype}, which NumPy or the formats lack; convert it")
    if tensor.ndim == 0:
        raise WarpcamError(f"Writer: {name} must have a first dimension of worlds, got a single number")
    yield name, tensor


@dataclass(eq=False)
class Rows:
    """Memory on the host for one step of all worlds, pinned where the arrays come from a GPU.

    Attributes:
        columns: (world, ...) by name.
        events: Recorded after copies from GPUs that may still go on.
    """

    columns: Columns = field(default_factory=dict)
    events: list[Any] = field(default_factory=list)

    def fill(self, columns: Columns) -> None:
        """Enqueue copies of the columns."""
        gpus = set()
        for name, tensor in columns.items():
            if name not in self.columns:
                with torch.inference_mode(False):
                    self.columns[name] = torch.empty(tensor.shape, dtype=tensor.dtype, pin_memory=tensor.is_cuda)
            self.columns[name].copy_(tensor, non_blocking=tensor.is_cuda)
            if tensor.is_cuda:
                gpus.add(tensor.device)
        for gpu in gpus:
            event = torch.cuda.Event()  # type: ignore[no-untyped-call]
            event.record(torch.cuda.current_stream(gpu))
            self.events.append(event)

    def arrays(self) -> dict[str, np.ndarray]:
        """Wait for the copies; returns views that last until the rows are filled again."""
        for event in self.events:
            event.synchronize()
        self.events.clear()
        return {name: tensor.numpy() for name, tensor in self.columns.items()}


class RowsPool:
    """Rows that go from the loop to the thread that writes, and back.

    Args:
        count: Rows that there are at most.
        check: Called while all rows are with the thread; raises if the thread failed.
    """

    def __init__(self, count: int, check: Callable[[], None]):
        self._count, self._made, self._check = count, 0, check
        self._free: queue.SimpleQueue[Rows] = queue.SimpleQueue()

    def take(self) -> Rows:
        """Wait until rows are free."""
        while True:
            try:
                return self._free.get_nowait()
            except queue.Empty:
                if self._made < self._count:
                    self._made += 1
                    return Rows()
            try:
                return self._free.get(timeout=WAIT)
            except queue.Empty:
                self._check()

    def give(self, rows: Rows) -> None:
        self._free.put(rows)
