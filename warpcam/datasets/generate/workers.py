"""Processes that make shards side by side, each with worlds of its own."""

import contextlib
import dataclasses
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.run import Part, Progress, complete, encoders, run_shard
from warpcam.datasets.generate.worlds import Worlds

DONE, MADE, FAILED = "done", "made", "failed"  # samples of a batch, a shard, an error's text


@dataclass(eq=False)
class Worker:
    """A process, its end of a pipe, and the shard that it makes."""

    process: Any
    pipe: Connection
    shard: int | None = None


def generate(plan: Plan, workers: int = 1, progress: Progress = lambda _: None, part: Part | None = None) -> None:
    """Make a data set, or go on with one that was begun with the same parameters.

    With several workers, programs need the usual ``if __name__ == "__main__":`` of multiprocessing.

    Args:
        plan: What is made.
        workers: Processes that draw; with 1 it is this process. With several GPUs and no device named, they take turns.
        progress: Called with the number of samples that are done beside those that it was told before, first with those
            of earlier runs.
        part: (i, n): of all shards make the i-th, from 0, the n-th after it, and so on, beside other runs with other i.
            Afterwards a run without a part completes the data set.

    Raises:
        WarpcamError: Something of the plan is not allowed, files cannot be written, or a worker ended.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise WarpcamError(f"dataset: workers must be a whole number of at least 1, got {workers!r}")

    def make(missing: list[int]) -> None:
        if min(workers, len(missing)) > 1:
            _run_side_by_side(plan, missing, min(workers, len(missing)), progress)
            return
        worlds = Worlds(plan)
        for shard in missing:
            run_shard(plan, shard, worlds, progress)

    complete(plan, make, progress, part)


def _run_side_by_side(plan: Plan, missing: Sequence[int], count: int, progress: Progress) -> None:
    with _processes(plan, count) as workers:
        todo = list(reversed(missing))
        for worker in workers:
            _give(worker, todo)
        while any(worker.shard is not None for worker in workers):
            busy = [worker for worker in workers if worker.shard is not None]
            ready = wait([*(worker.pipe for worker in busy), *(worker.process.sentinel for worker in busy)])
            for worker in busy:
                if worker.pipe in ready:
                    _hear(worker, todo, progress)
                elif worker.process.sentinel in ready:
                    raise _ended(worker)


def _give(worker: Worker, todo: list[int]) -> None:
    worker.shard = todo.pop() if todo else None
    with contextlib.suppress(OSError):  # a worker that has ended is found by its sentinel
        worker.pipe.send(worker.shard)


def _hear(worker: Worker, todo: list[int], progress: Progress) -> None:
    try:
        kind, value = worker.pipe.recv()
    except (EOFError, OSError):
        raise _ended(worker) from None
    if kind == FAILED:
        raise WarpcamError(value)
    if kind == DONE:
        progress(value)
    else:
        _give(worker, todo)


def _ended(worker: Worker) -> WarpcamError:
    worker.process.join()
    code = worker.process.exitcode
    how = f"was ended by {signal.Signals(-code).name}" if code is not None and code < 0 else f"ended with code {code}"
    return WarpcamError(
        f"dataset: worker process {worker.process.pid} {how} while it made shard {worker.shard}; finished shards are "
        "whole: run the same command again to go on"
    )


@contextlib.contextmanager
def _processes(plan: Plan, count: int) -> Iterator[list[Worker]]:
    """Processes that wait for shards, ended with the block."""
    context = multiprocessing.get_context("spawn")
    devices = wp.get_cuda_devices() if plan.device is None else []
    workers: list[Worker] = []
    try:
        for number in range(count):
            device = devices[number % len(devices)].alias if devices else plan.device
            here, there = context.Pipe()
            arguments = (dataclasses.replace(plan, device=device), there, encoders(count))
            process = context.Process(target=_work, args=arguments, daemon=True)
            process.start()
            there.close()
            workers.append(Worker(process, here))
        yield workers
    finally:
        for worker in workers:
            worker.pipe.close()
            worker.process.terminate()
        for worker in workers:
            worker.process.join()


def _work(plan: Plan, pipe: Connection, threads: int) -> None:
    """A worker's life: shards that the parent names, until it names none or is gone."""
    parent = os.getppid()
    wp.config.log_level = wp.LOG_WARNING
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers

    def told(samples: int) -> None:
        if os.getppid() != parent:
            raise SystemExit(1)
        pipe.send((DONE, samples))

    try:
        worlds = None
        while (shard := pipe.recv()) is not None:
            worlds = worlds or Worlds(plan)
            run_shard(plan, shard, worlds, told, threads)
            pipe.send((MADE, shard))
    except WarpcamError as error:
        pipe.send((FAILED, str(error)))
    except (EOFError, BrokenPipeError):
        pass
