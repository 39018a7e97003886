"""Time of the parts of a program, on the device and on the host."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

OUTSIDE = "host gaps"  # time in which no part is under way


class Sections:
    """A stopwatch of parts, which may lie in each other: the time of an inner one is none of the outer one's.

    On a GPU time is that between events in torch's current stream, so nothing is waited for: what lies between two
    parts is time in which the GPU has nothing of either to do. On a CPU both times are those of the clock.

    Args:
        device: Of the work.
    """

    def __init__(self, device: torch.device):
        self._device = device
        self._watched: list[tuple[Any, str]] = []
        self._open: list[str] = []
        self._marks: list[tuple[str, float, Any]] = []

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Time what is inside as a part of that name."""
        self._open.append(name)
        self._mark()
        try:
            yield
        finally:
            self._open.pop()
            self._mark()

    def watch(self, owner: Any, method: str, name: str) -> None:
        """Have each call of an object's method be a part of that name from now on."""
        plain = getattr(owner, method)

        def timed(*arguments: Any, **options: Any) -> Any:
            with self.section(name):
                return plain(*arguments, **options)

        setattr(owner, method, timed)
        self._watched.append((owner, method))

    def release(self) -> None:
        """Watch no method any longer."""
        while self._watched:
            delattr(*self._watched.pop())

    def begin(self) -> None:
        """Forget what was timed, and begin anew."""
        self._marks.clear()
        self._mark()

    def end(self) -> dict[str, tuple[float, float]]:
        """Return seconds of each part since ``begin``, on the device and on the host."""
        self._mark()
        if self._device.type == "cuda":
            torch.cuda.synchronize(self._device)
        spent: defaultdict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
        for (name, begun, event), (_, ended, following) in zip(self._marks, self._marks[1:], strict=False):
            host = ended - begun
            spent[name][0] += host if event is None else 1e-3 * event.elapsed_time(following)
            spent[name][1] += host
        return {name: (device, host) for name, (device, host) in spent.items()}

    def _mark(self) -> None:
        event: Any = None
        if self._device.type == "cuda":
            event = torch.cuda.Event(enable_timing=True)  # type: ignore[no-untyped-call]
            event.record(torch.cuda.current_stream(self._device))
        self._marks.append((self._open[-1] if self._open else OUTSIDE, time.perf_counter(), event))
