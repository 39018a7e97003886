"""Time a renderer's frames while the worlds move, and weigh the memory it takes."""

import contextlib
import ctypes
import functools
import gc
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import torch
import warp as wp

GPU_BUDGET = 0.25  # seconds of replays, at least MIN_FRAMES of them
LONG = 2.0  # seconds that MIN_FRAMES may take; of longer frames there are fewer, but one in each set of poses
CPU_BUDGET = 10.0  # seconds of calls, at least MIN_CALLS and at most MAX_CALLS of them
MIN_FRAMES, MAX_FRAMES = 12, 200
MIN_CALLS, MAX_CALLS = 3, 30
# So many replays are queued behind one busy kernel, which gives the host time to queue them all.
QUEUED = 24
USED_MEM_HIGH = 8  # CU_MEMPOOL_ATTR_USED_MEM_HIGH of the CUDA driver


@contextlib.contextmanager
def on_one_stream(device: wp.Device) -> Iterator[None]:
    """Run torch and Warp on one stream of the device, so that either's work can be captured and timed there."""
    with wp.ScopedDevice(device):
        if not device.is_cuda:
            yield
            return
        stream = torch.cuda.Stream(device=wp.device_to_torch(device))  # type: ignore[no-untyped-call]
        with torch.cuda.stream(stream), wp.ScopedStream(wp.stream_from_torch(stream)):
            yield


def time_first(frame: Callable[[], None], device: wp.Device) -> float:
    """Seconds that the first frame takes, with all that is compiled or allocated in it."""
    start = time.perf_counter()
    frame()
    wp.synchronize_device(device)
    return time.perf_counter() - start


@contextlib.contextmanager
def kernel_loads() -> Iterator[list[tuple[float, float]]]:
    """Note from when to when kernels are compiled or read from caches; threads may do so at the same time."""
    spans: list[tuple[float, float]] = []
    load = wp.Module.load

    def noted(module: wp.Module, *args: Any, **options: Any) -> Any:
        known, start = len(module.execs), time.perf_counter()
        found = load(module, *args, **options)
        if len(module.execs) > known:
            spans.append((start, time.perf_counter()))
        return found

    wp.Module.load = noted
    try:
        yield spans
    finally:
        wp.Module.load = load


def covered(spans: Iterable[tuple[float, float]]) -> float:
    """Seconds that lie in at least one of the spans."""
    total, reached = 0.0, -np.inf
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return float(total)


def time_frames(
    frame: Callable[[], None],
    place: Callable[[int], None],
    sets: int,
    device: wp.Device,
    frames: int | None,
    on_host: bool = False,
) -> dict[str, Any]:
    """Milliseconds a frame takes after `place` has moved all worlds to the next of `sets` poses.

    On a GPU both are CUDA graphs, replayed in turn; only the frame lies between the two events. On a CPU, and where
    frames are work `on_host`, they are plain calls; there ``cpu`` is the median of what processors spend on one, all
    threads together, which other work on the machine hardly changes.
    """
    spent: dict[str, float] = {}
    if device.is_cuda and not on_host:
        times = time_graphs(frame, place, sets, device, frames)
    else:
        times, processors = time_calls(frame, place, sets, frames)
        spent["cpu"] = float(np.median(processors))
    low, middle, high = np.percentile(times, (10.0, 50.0, 90.0))
    return {
        "median": float(middle),
        "p10": float(low),
        "p90": float(high),
        "min": float(np.min(times)),
        "max": float(np.max(times)),
        "frames": len(times),
        **spent,
    }


def median_of(frame: Callable[[], None], place: Callable[[int], None], sets: int, device: wp.Device) -> float:
    """Median of a frame's times, of frames after the first [ms]; arguments as of ``time_frames``."""
    gc.collect()
    with on_one_stream(device):
        place(0)
        frame()
        return float(time_frames(frame, place, sets, device, None)["median"])


def time_calls(
    frame: Callable[[], None], place: Callable[[int], None], sets: int, frames: int | None
) -> tuple[list[float], list[float]]:
    """Milliseconds of each frame by the clock, and by the processors."""
    times: list[float] = []
    spent: list[float] = []
    while len(times) < (frames or MIN_CALLS) or (
        frames is None and len(times) < MAX_CALLS and sum(times) < 1e3 * CPU_BUDGET
    ):
        place(len(times) % sets)
        start, before = time.perf_counter(), time.process_time()
        frame()
        spent.append(1e3 * (time.process_time() - before))
        times.append(1e3 * (time.perf_counter() - start))
    return times, spent


def time_graphs(
    frame: Callable[[], None], place: Callable[[int], None], sets: int, device: wp.Device, frames: int | None
) -> list[float]:
    graph = captured(frame, device)
    moves = [captured(functools.partial(place, index), device) for index in range(sets)]
    stream = wp.get_stream(device)
    busy = wp.zeros(1, dtype=wp.float32, device=device)

    def replay(count: int) -> list[float]:
        events = [(wp.Event(device, enable_timing=True), wp.Event(device, enable_timing=True)) for _ in range(count)]
        wp.launch(keep_busy, 1, inputs=[busy], device=device, stream=stream)
        for index, (before, after) in enumerate(events):
            wp.capture_launch(moves[index % sets], stream=stream)
            stream.record_event(before)
            wp.capture_launch(graph, stream=stream)
            stream.record_event(after)
        wp.synchronize_device(device)
        return [wp.get_event_elapsed_time(before, after, synchronize=False) for before, after in events]

    guess = replay(2)[-1]  # the first replay of a graph is slower
    count = frames or frame_count(guess, sets)
    times: list[float] = []
    while len(times) < count:
        times += replay(min(QUEUED, count - len(times)))
    return times


def frame_count(guess: float, sets: int) -> int:
    """Number of frames of so many milliseconds that are timed on a GPU."""
    fits = 1e3 * GPU_BUDGET / max(guess, 1e-3)
    return int(np.clip(fits, np.clip(1e3 * LONG / max(guess, 1e-3), sets, MIN_FRAMES), MAX_FRAMES))


def captured(work: Callable[[], None], device: wp.Device) -> wp.Graph:
    with wp.ScopedCapture(device=device) as capture:
        work()
    return capture.graph


@wp.kernel(enable_backward=False)  # type: ignore[untyped-decorator]
def keep_busy(result: wp.array[wp.float32]) -> None:
    x = result[0]
    for _ in range(1000000):  # about 2 ms of one thread
        x = x * 0.999 + 0.5
    result[0] = x


class Memory:
    """Device memory that is taken on top of what was taken at the start, in Warp's pool and in torch's."""

    def __init__(self, device: wp.Device) -> None:
        self.device = device
        self.counted = bool(device.is_cuda and device.is_mempool_enabled)
        if self.counted:
            self.start = self._now()

    def reset_peak(self) -> None:
        if not self.counted:
            return
        torch.cuda.reset_peak_memory_stats(wp.device_to_torch(self.device))
        # Warp tells the peak of its pool but cannot set it back; CUDA's driver can.
        driver = ctypes.CDLL("libcuda.so.1")
        handle, pool, zero = ctypes.c_int(), ctypes.c_void_p(), ctypes.c_uint64(0)
        for failed in (
            driver.cuDeviceGet(ctypes.byref(handle), self.device.ordinal),
            driver.cuDeviceGetDefaultMemPool(ctypes.byref(pool), handle),
            driver.cuMemPoolSetAttribute(pool, USED_MEM_HIGH, ctypes.byref(zero)),
        ):
            if failed:
                raise RuntimeError(f"CUDA driver error {failed}: the peak of the memory pool cannot be set back")

    def figures(self) -> dict[str, float]:
        """Megabytes held now, and the most since the peak was set back; nothing on a CPU."""
        if not self.counted:
            return {}
        peak = wp.get_mempool_used_mem_high(self.device)
        peak += torch.cuda.max_memory_allocated(wp.device_to_torch(self.device))
        return {"memory_mb": 1e-6 * (self._now() - self.start), "peak_memory_mb": 1e-6 * (peak - self.start)}

    def _now(self) -> int:
        held = torch.cuda.memory_allocated(wp.device_to_torch(self.device))
        return int(wp.get_mempool_used_mem_current(self.device)) + held
