"""Threads that share a launch on a CPU."""

import functools
import logging
import os
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

import warp as wp

MIN_SECONDS_PER_THREAD = 2e-4  # of work for each thread of a CPU that shares it


def cpu_chunks() -> int:
    """Return the number of parts of a CPU launch: several for each thread, to even out uneven work."""
    return 4 * cpu_threads() if cpu_threads() > 1 else 1


@functools.cache
def cpu_threads() -> int:
    """Threads a CPU launch is split over: the cores this process may use, or WARPCAM_CPU_THREADS."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wanted = os.environ.get("WARPCAM_CPU_THREADS", "")
    number = parse_positive_int(wanted)
    if wanted.strip() and number is None:
        said = "WARPCAM_CPU_THREADS=%r is no whole number above 0; a frame is split over %d threads"
        logging.getLogger("warpcam").warning(said, wanted, cores)
    return number or cores


def parse_positive_int(text: str) -> int | None:
    """The number that a text is, whatever spaces are around it; None if it is no such number."""
    digits = text.strip()
    return int(digits) or None if digits.isdecimal() else None


def drain(left: deque[wp.Launch]) -> float:
    """Launch what is left, one part after another; the seconds that it took."""
    begun = time.perf_counter()
    while True:
        try:
            part = left.popleft()
        except IndexError:
            return time.perf_counter() - begun
        part.launch()


def submit_helpers(work: Callable[[], float], threads: int) -> list[Future[float]]:
    """Have so many threads of the pool do some work."""
    woken: list[Future[float]] = []
    with suppress(RuntimeError):  # the interpreter is ending, and a thread that does not keep it from that renders on
        for _ in range(threads):
            woken.append(_pool().submit(work))
    return woken


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cpu_threads(), thread_name_prefix="warpcam")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads stay behind
