"""Time a renderer's frames, and say how far its images are from another's."""

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import warp as wp

Images = list[tuple[np.ndarray, np.ndarray]]

# A pixel's depths differ when they are further apart than this.
DEPTH_ABSOLUTE = 1e-3  # [m]
DEPTH_RELATIVE = 1e-3

GPU_BUDGET = 1.0  # seconds of replays, at least MIN_REPLAYS of them
CPU_BUDGET = 10.0  # seconds of calls, at most MIN_REPLAYS of them
MIN_REPLAYS = 30


@contextlib.contextmanager
def on_one_stream(device: wp.Device) -> Iterator[None]:
    """Run torch and Warp on one stream of the device, so that either's work can be captured and timed there."""
    with wp.ScopedDevice(device):
        if not device.is_cuda:
            yield
            return
        import torch

        stream = torch.cuda.Stream(device=wp.device_to_torch(device))
        with torch.cuda.stream(stream), wp.ScopedStream(wp.stream_from_torch(stream)):
            yield


def time_frames(frame: Callable[[], None], device: wp.Device, replays: int | None) -> dict[str, Any]:
    """Milliseconds a frame: replays of a CUDA graph between events, or plain calls on a CPU."""
    start = time.perf_counter()
    frame()
    wp.synchronize_device(device)
    first = time.perf_counter() - start
    times = time_graph(frame, device, replays) if device.is_cuda else time_calls(frame, replays)
    low, middle, high = np.percentile(times, (10.0, 50.0, 90.0))
    return {
        "median": float(middle),
        "p10": float(low),
        "p90": float(high),
        "min": float(np.min(times)),
        "max": float(np.max(times)),
        "frames": len(times),
        "first_frame_s": first,
    }


def time_calls(frame: Callable[[], None], replays: int | None) -> list[float]:
    times: list[float] = []
    while len(times) < (replays or MIN_REPLAYS) and (replays or len(times) < 3 or sum(times) < 1e3 * CPU_BUDGET):
        start = time.perf_counter()
        frame()
        times.append(1e3 * (time.perf_counter() - start))
    return times


def time_graph(frame: Callable[[], None], device: wp.Device, replays: int | None) -> list[float]:
    with wp.ScopedCapture(device=device) as capture:
        frame()
    stream = wp.get_stream(device)
    for _ in range(3):
        wp.capture_launch(capture.graph)
    before, after = (wp.Event(device, enable_timing=True) for _ in range(2))
    stream.record_event(before)
    wp.capture_launch(capture.graph)
    stream.record_event(after)
    once = wp.get_event_elapsed_time(before, after)
    count = replays or int(np.clip(1e3 * GPU_BUDGET / max(once, 1e-3), MIN_REPLAYS, 300))
    # All replays are queued before the first is waited for: the host is not in the times.
    events = [wp.Event(device, enable_timing=True) for _ in range(count + 1)]
    stream.record_event(events[0])
    for event in events[1:]:
        wp.capture_launch(capture.graph)
        stream.record_event(event)
    wp.synchronize_device(device)
    return [wp.get_event_elapsed_time(a, b, synchronize=False) for a, b in itertools.pairwise(events)]


def memory_used(device: wp.Device) -> int:
    """Bytes that Warp holds on a GPU now; 0 on a CPU or where Warp does not count them."""
    if not (device.is_cuda and device.is_mempool_enabled):
        return 0
    return wp.get_mempool_used_mem_current(device)


def difference(images: Images, reference: Images) -> dict[str, float]:
    """How the images of all cameras differ from the reference's, over all their pixels together."""
    pixels = ids_differ = depth_differs = hits = 0
    largest = largest_same = 0.0
    for (depth, ids), (depth_ref, ids_ref) in zip(images, reference, strict=True):
        hit, hit_ref = ids >= 0, ids_ref >= 0
        both = hit & hit_ref
        gap = np.abs(np.where(both, depth, 0.0) - np.where(both, depth_ref, 0.0))
        tolerance = DEPTH_ABSOLUTE + DEPTH_RELATIVE * np.where(both, depth_ref, 0.0)
        pixels += ids.size
        hits += int(hit_ref.sum())
        ids_differ += int((ids != ids_ref).sum())
        depth_differs += int(((gap > tolerance) | (hit != hit_ref)).sum())
        largest = max(largest, float(gap.max(initial=0.0)))
        largest_same = max(largest_same, float(gap[both & (ids == ids_ref)].max(initial=0.0)))
    return {
        "pixels": pixels,
        "hit_fraction": hits / pixels,
        "ids_mismatch": ids_differ / pixels,
        "depth_mismatch": depth_differs / pixels,
        "depth_max_error_m": largest,
        "depth_max_error_same_id_m": largest_same,
    }
