"""Work of Warp and torch on a GPU as one CUDA graph."""

from collections.abc import Callable
from typing import Generic, TypeVar

import torch
import warp as wp

from warpcam.core import torch_interop
from warpcam.kernels.runtime.streams import nonblocking_stream, recording_lock

Result = TypeVar("Result")


def can_capture(device: wp.Device) -> bool:
    """Return whether a device records a simulation as a graph, with its allocations and its loops of unknown length."""
    return bool(device.is_cuda and device.is_mempool_enabled and wp.is_conditional_graph_supported())


class CapturedWork(Generic[Result]):
    """What a function has the device do, recorded once and launched as often as wanted.

    The graph is one of Warp, whose conditional nodes solvers need; torch's current stream is that which is recorded,
    and what torch allocates meanwhile comes from a pool of the graph's own. The function must have run before, so that
    kernels are loaded. It must not wait for the device, nor use generators of torch.

    Args:
        device: A GPU for which ``can_capture`` is true.
        work: Reads and writes memory that stays where it is.

    Attributes:
        result: What the function returned: tensors in it have new values after each launch.
    """

    def __init__(self, device: wp.Device, work: Callable[[], Result]):
        self._device = device
        self._stream = stream = nonblocking_stream(device)
        with recording_lock(device), wp.ScopedDevice(device), torch.cuda.device(device.ordinal):
            self._pool = torch.cuda.MemPool()
            with (
                torch.inference_mode(False),
                torch.no_grad(),
                torch.cuda.stream(wp.stream_to_torch(stream)),
                torch.cuda.use_mem_pool(self._pool),
                wp.ScopedStream(stream, sync_enter=False),
                wp.ScopedCapture(stream=stream) as capture,
            ):
                self.result = work()
        self._graph = capture.graph

    def launch(self) -> Result:
        """Enqueue the work after what torch's current stream has; returns ``result``."""
        with torch_interop.in_order(self._device):
            wp.capture_launch(self._graph, stream=self._device.stream)
        return self.result
