"""Frames without end, with all that happens beside them in training."""

import gc
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import torch
import warp as wp

from tests.soak import memory
from tests.soak.worlds import Worlds

RESET_EVERY, RANDOMIZE_EVERY = 7, 5  # frames
SIZES = (24, 33, 48)  # of renderers that are made and dropped
SAMPLES = 400  # of memory, in a run at most


@dataclass
class Result:
    """What came of a run.

    Attributes:
        device: Its name.
        seconds: How long it took.
        frames: Drawn by the renderer that stays.
        resets: Times that some worlds' last frame was forgotten.
        randomizations: Times that some worlds were drawn anew.
        renderers: Made and dropped.
        thread_frames: Drawn by other threads.
        checks: Frames that were compared with those of a new scene and renderer.
        differences: Images that were not equal in all bits, and what went wrong in threads.
        growth: Bytes by which memory grew after it had settled, of the host and of the device.
        samples: Seconds, frames and bytes over time.
    """

    device: str
    seconds: float = 0.0
    frames: int = 0
    resets: int = 0
    randomizations: int = 0
    renderers: int = 0
    thread_frames: int = 0
    checks: int = 0
    differences: list[str] = field(default_factory=list)
    growth: dict[str, int] = field(default_factory=dict)
    samples: list[dict[str, float]] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


class Threads:
    """Threads that each draw worlds of their own, again and again, and compare them with what they drew first."""

    def __init__(self, device: wp.Device, count: int, result: Result):
        self._device, self._result, self._stop = device, result, threading.Event()
        self._threads = [threading.Thread(target=self._draw, args=(number,), daemon=True) for number in range(count)]
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        for thread in self._threads:
            thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _draw(self, number: int) -> None:
        try:
            with wp.ScopedDevice(self._device):
                self._draw_until_stopped(number)
        except Exception as error:
            self._result.differences.append(f"thread {number}: {type(error).__name__}: {error}")

    def _draw_until_stopped(self, number: int) -> None:
        worlds = Worlds(self._device, 3, 24)
        worlds.move(number)
        worlds.renderer.render()
        images = worlds.renderer.render()
        first = {(camera, name): image.clone() for camera, own in images.items() for name, image in own.items()}
        while not self._stop.is_set():
            worlds.renderer.render()
            for (camera, name), image in first.items():
                if not torch.equal(images[camera][name], image):
                    self._result.differences.append(f"thread {number}: {camera} {name}")
                    return
            with self._lock:
                self._result.thread_frames += 1
            time.sleep(0.001)


def run(
    device: wp.Device,
    *,
    seconds: float,
    frames: int | None = None,
    check_every: int = 10_000,
    renew_every: int = 500,
    threads: int = 2,
    worlds: int = 16,
    size: int = 64,
    checked: Callable[[Result], None] = lambda result: None,
) -> Result:
    """Draw until the time is over, or so many frames.

    Args:
        device: Where.
        seconds: At most.
        frames: Likewise, if given.
        check_every: Frames from one that is compared to the next.
        renew_every: Frames from one renderer that is made and dropped to the next.
        threads: That draw worlds of their own meanwhile.
        worlds: Of the renderer that stays.
        size: Of its images [pixels].
        checked: Called with the result so far after each frame that was compared.
    """
    result = Result(device.name)
    own = Worlds(device, worlds, size)
    began = sampled = time.monotonic()
    with Threads(device, threads, result):
        while time.monotonic() - began < seconds and (frames is None or result.frames < frames):
            _frame(own, result, check_every, renew_every)
            result.seconds = time.monotonic() - began
            if time.monotonic() - sampled >= seconds / SAMPLES or result.frames % check_every == 0:
                sampled = time.monotonic()
                _sample(device, result)
            if result.frames % check_every == 0:
                _weigh(result)
                checked(result)
    _weigh(result)
    return result


def _weigh(result: Result) -> None:
    for name in ("host", "held", "taken"):
        result.growth[name] = memory.growth(result.samples, name)


def _frame(own: Worlds, result: Result, check_every: int, renew_every: int) -> None:
    result.frames += 1
    frame = result.frames
    checked = frame % check_every == 0
    chosen = [world for world in range(own.scene.num_worlds) if (frame >> world % 8) & 1]
    own.move(frame)
    if frame % RANDOMIZE_EVERY == 0 and chosen:
        own.randomize(frame, chosen)
        result.randomizations += 1
    if frame % RESET_EVERY == 0 and chosen and not checked:
        own.renderer.reset(chosen)
        result.resets += 1
    own.renderer.render()
    if checked:
        result.differences += own.differences(frame)
        result.checks += 1
    if frame % renew_every == 0:
        own.new_renderer(own.scene, SIZES[frame // renew_every % len(SIZES)]).render()
        result.renderers += 1


def _sample(device: wp.Device, result: Result) -> None:
    gc.collect()
    sample = {"seconds": round(result.seconds, 1), "frames": result.frames, "host": memory.host_bytes()}
    result.samples.append({**sample, **memory.device_bytes(device)})
