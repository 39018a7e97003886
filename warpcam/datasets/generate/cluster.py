"""Shards on a Ray cluster: each actor keeps its worlds, on a GPU of its own if there are any, for shard after shard.

Actors get one shard at a time, so what is under way is bounded by their number. A shard whose actor dies is made again
by an actor that takes its place.
"""

import dataclasses
import logging
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.run import ENCODERS, Part, Progress, complete, prepare, run_shard
from warpcam.datasets.generate.worlds import Worlds

try:
    import ray
except ImportError as error:
    raise WarpcamError(f"{error.name} is not installed, and --ray needs it: pip install 'warpcam[ray]'") from error

TRIES = 3  # of a shard whose actors die


class ShardMaker:
    """What an actor runs.

    Args:
        plan: What is made.
        threads: That encode images.
    """

    def __init__(self, plan: Plan, threads: int):
        self._plan, self._threads = plan, threads
        self._worlds: Worlds | None = None

    def ready(self) -> None:
        """Return once the actor is there."""

    def make(self, shard: int) -> str | None:
        """Make a shard; returns what went wrong, in words, or None."""
        try:
            self._worlds = self._worlds or Worlds(self._plan)
            run_shard(self._plan, shard, self._worlds, threads=self._threads)
        except WarpcamError as error:
            return str(error)
        return None


def generate_on_ray(
    plan: Plan,
    address: str | None = None,
    workers: int | None = None,
    progress: Progress = lambda _: None,
    part: Part | None = None,
) -> None:
    """Make a data set on a Ray cluster, or go on with one that was begun with the same parameters.

    All machines need this version of warpcam, and the scene's files and the folder of the data set by the same paths. A
    cluster to which this process is connected already is used; otherwise it is connected for as long as this takes.

    Args:
        plan: What is made.
        address: Of the cluster; None is that of ``RAY_ADDRESS``, one that runs on this machine, or else a new one.
        workers: Actors; None is one for each GPU of the cluster, or for each of its processors if it has no GPU or the
            plan's device is the CPU.
        progress: As ``generate`` has it; called after each shard.
        part: As ``generate`` has it.

    Raises:
        WarpcamError: Something of the plan is not allowed, files cannot be written, no cluster is found, or a shard's
            actors died again and again.
    """
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise WarpcamError(f"dataset: workers must be a whole number of at least 1, got {workers!r}")
    whole = dataclasses.replace(plan, scene=str(Path(plan.scene).resolve()), out=str(Path(plan.out).resolve()))
    connected = ray.is_initialized()
    if not connected:
        try:
            dashboard = False if address in (None, "local") else None
            ray.init(address, include_dashboard=dashboard, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise WarpcamError(f"--ray: no cluster at {address!r}: {' '.join(str(error).split())}") from None
    try:
        complete(whole, lambda missing: _Makers(whole, len(missing), workers).make(missing, progress), progress, part)
    finally:
        if not connected:
            ray.shutdown()


class _Makers:
    """Actors of a run.

    Args:
        plan: What is made.
        shards: How many there are to make.
        workers: As ``generate_on_ray`` has it.
    """

    def __init__(self, plan: Plan, shards: int, workers: int | None):
        self._plan = plan
        resources = ray.cluster_resources()
        gpus = 0 if plan.device == "cpu" else int(resources.get("GPU", 0))
        count = min(shards, workers or gpus or max(1, int(resources.get("CPU", 1))))
        self._threads = min(ENCODERS, max(1, int(resources.get("CPU", 1)) // count))
        self._options: dict[str, Any] = {"num_cpus": 1, "num_gpus": 1 if gpus else 0}
        self._actors: list[Any] = []
        self._under_way: dict[Any, tuple[Any, int | None]] = {}  # actor and shard of a call, None until it is there
        for _ in range(count):
            self._start()

    def make(self, missing: Sequence[int], progress: Progress) -> None:
        """Make shards, and end all actors."""
        todo, tries = deque(missing), dict.fromkeys(missing, 0)
        folder = prepare(self._plan)
        left = len(missing)
        try:
            while left:
                (call,), _ = ray.wait(list(self._under_way), num_returns=1)
                actor, shard = self._under_way.pop(call)
                try:
                    wrong = ray.get(call)
                except ray.exceptions.RayActorError as error:
                    self._lost(actor, shard, todo, tries, error)
                    continue
                if wrong is not None:
                    raise WarpcamError(wrong)
                if shard is not None:
                    if not folder.is_finished(shard):
                        raise WarpcamError(
                            f"dataset: shard {shard} was made, and is not in {str(folder.out)!r}: all machines of the "
                            "cluster need one folder by this path"
                        )
                    left -= 1
                    progress(len(self._plan.samples(shard)))
                if todo:
                    following = todo.popleft()
                    self._under_way[actor.make.remote(following)] = actor, following
        finally:
            for actor in self._actors:
                ray.kill(actor)

    def _start(self) -> None:
        actor = ray.remote(ShardMaker).options(**self._options).remote(self._plan, self._threads)
        self._actors.append(actor)
        self._under_way[actor.ready.remote()] = actor, None

    def _lost(self, actor: Any, shard: int | None, todo: deque[int], tries: dict[int, int], error: Exception) -> None:
        """Put another actor in the place of one that died, whose shard is due again."""
        if shard is None:
            raise WarpcamError(f"--ray: an actor could not be started: {' '.join(str(error).split())}") from None
        tries[shard] += 1
        if tries[shard] == TRIES:
            raise WarpcamError(
                f"dataset: the actors that made shard {shard} died, {TRIES} of them; finished shards are whole: "
                f"{' '.join(str(error).split())}"
            ) from None
        self._actors.remove(actor)
        todo.appendleft(shard)
        self._start()
