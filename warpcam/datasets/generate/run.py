"""Making of a data set: a plan becomes shards, each by itself, and shards become a data set.

``run_shard`` is all that a worker does, here or on another machine: a plan can be pickled, and shards do not depend on
each other.
"""

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from warpcam.core.errors import WarpcamError
from warpcam.datasets.generate import statistics
from warpcam.datasets.generate.contact_sheet import Previews, write_contact_sheet
from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.shards import FinishedShard, ShardFolder, explained
from warpcam.datasets.generate.statistics_page import write_statistics
from warpcam.datasets.generate.worlds import Worlds
from warpcam.datasets.writers import WRITERS, find_writer
from warpcam.datasets.writers.writer import Merge, ShardLayout, Writer

ENCODERS = 16  # threads of a process that encode images, at most
QUEUED = 4  # frames of each thread that wait, at most
PACKAGES = ("warpcam", "warp-lang", "mujoco", "mujoco-warp", "usd-core", "trimesh", "numpy", "pillow", "torch")

Progress = Callable[[int], None]  # is told how many more samples are done
Part = tuple[int, int]  # (i, n): of all shards the i-th, the n-th after it, and so on


def prepare(plan: Plan) -> ShardFolder:
    """The folder of a plan, once its writer and options are known to be right."""
    writer = find_writer(plan.writer)
    writer.check_options(dict(plan.options))
    return ShardFolder(plan, writer.root)


def complete(plan: Plan, make: Callable[[list[int]], None], progress: Progress, part: Part | None = None) -> None:
    """Have ``make`` make the shards that are missing, and merge all, or with a part make its shards alone.

    Raises:
        WarpcamError: Something of the plan is not allowed, or files cannot be written.
    """
    if part is not None and not 0 <= part[0] < part[1]:
        raise WarpcamError(f"--shards: {part[0]}/{part[1]} came, I/N with I from 0 to N - 1 is needed")
    folder = prepare(plan)
    with folder.locked(shared=part is not None):
        missing = missing_shards(plan, folder)
        if part is not None:
            missing = [shard for shard in missing if shard % part[1] == part[0]]
        progress(plan.count - sum(len(plan.samples(shard)) for shard in missing))
        if missing:
            write_manifest(plan, folder, complete=False, more={})
            try:
                make(missing)
            finally:
                if part is None:
                    folder.remove_temporaries()
        if part is None:
            merge_shards(plan, folder)


def encoders(processes: int = 1) -> int:
    """Threads that encode images, of each of so many processes on this machine."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(ENCODERS, max(1, processors // processes))


def run_shard(
    plan: Plan, shard: int, worlds: Worlds, progress: Progress = lambda _: None, threads: int | None = None
) -> None:
    """Make one shard; its folder is there when it is whole.

    Args:
        plan: What is made.
        shard: Its number.
        worlds: Of the plan; they may be used for one shard after another.
        progress: Called after each batch with its number of samples.
        threads: That encode images; None is one for each processor, up to 16.

    Raises:
        WarpcamError: The shard cannot be written.
    """
    folder = prepare(plan)
    try:
        _write_shard(plan, shard, worlds, folder, progress, threads or encoders())
    except OSError as error:
        raise explained(error, folder.out) from error


def missing_shards(plan: Plan, folder: ShardFolder) -> list[int]:
    """Shards that are not finished."""
    finished = {each.index for each in folder.finished()}
    return [shard for shard in range(plan.num_shards) if shard not in finished]


def merge_shards(plan: Plan, folder: ShardFolder) -> None:
    """Write what all shards have in common, the contact sheet, the statistics and the manifest.

    Raises:
        WarpcamError: A shard is missing, or files cannot be written.
    """
    shards = folder.finished()
    if len(shards) < plan.num_shards:
        raise WarpcamError(f"dataset: {plan.num_shards - len(shards)} of {plan.num_shards} shards are missing")
    first = shards[0].record
    for each in shards:
        if each.record["classes"] != first["classes"]:
            raise WarpcamError(f"dataset: {str(each.path)!r} has other classes than {str(shards[0].path)!r}")
    merge = _merge_of(plan, folder, shards)
    total = statistics.empty(len(merge.classes))
    for each in shards:
        statistics.add(total, each.record["statistics"])
    try:
        find_writer(plan.writer).merge(merge)
        write_contact_sheet(folder.out, shards)
        write_statistics(folder.out, merge.classes, total)
        write_manifest(plan, folder, complete=True, more={"classes": first["classes"], "frames": total["frames"]})
    except OSError as error:
        raise explained(error, folder.out) from error


def write_manifest(plan: Plan, folder: ShardFolder, complete: bool, more: dict[str, Any]) -> None:
    """Write the manifest: format, versions, parameters, and whether all shards are merged."""
    versions: dict[str, str | None] = {}
    for package in (*PACKAGES, *WRITERS[plan.writer][2]):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = None
    folder.write_manifest({"manifest": 1, "complete": complete, "versions": versions, **more})


def _merge_of(plan: Plan, folder: ShardFolder, shards: Sequence[FinishedShard]) -> Merge:
    first = shards[0].record
    return Merge(
        out=folder.out,
        shards=shards,
        classes=tuple(first["classes"]),
        keypoint_names=tuple(map(tuple, first["keypoints"])),
        width=plan.width,
        height=plan.height,
        cameras=tuple(first["cameras"]),
        validation=plan.validation,
        seed=plan.seed,
        options=find_writer(plan.writer).check_options(dict(plan.options)),
    )


def _write_shard(plan: Plan, shard: int, worlds: Worlds, folder: ShardFolder, progress: Progress, threads: int) -> None:
    kind, samples = find_writer(plan.writer), plan.samples(shard)
    temporary = folder.begin(shard)
    layout = ShardLayout(
        folder=temporary,
        index=shard,
        frames=len(samples) * len(worlds.cameras),
        first=samples.start * len(worlds.cameras),
        cameras=worlds.cameras,
        classes=worlds.classes,
        keypoint_names=worlds.keypoint_names,
        models=worlds.models,
        width=plan.width,
        height=plan.height,
        image_format=plan.image_format,
        quality=plan.quality,
        options=kind.check_options(dict(plan.options)),
    )
    writer = kind(layout)
    total, previews = statistics.empty(len(worlds.classes)), Previews(temporary, layout.frames)
    with ThreadPoolExecutor(threads) as pool:
        queue: deque[Future[Any]] = deque()
        try:
            for first in range(samples.start, samples.stop, plan.worlds):
                batch = range(first, min(first + plan.worlds, samples.stop))
                for frame in worlds.draw(batch):
                    place = frame.number - samples.start * len(worlds.cameras)
                    queue.append(pool.submit(_encode, writer, previews, frame, place))
                    while len(queue) > QUEUED * threads:
                        _append(writer, total, queue.popleft())
                progress(len(batch))
            while queue:
                _append(writer, total, queue.popleft())
            writer.close()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    record = {
        "cameras": list(worlds.cameras),
        "classes": list(worlds.classes),
        "keypoints": list(map(list, worlds.keypoint_names)),
        "statistics": total,
    }
    folder.commit(shard, temporary, record)


def _encode(writer: Writer, previews: Previews, frame: Frame, place: int) -> tuple[Any, dict[str, Any]]:
    encoded = writer.encode(frame)
    previews.add(place, frame)
    return encoded, statistics.of_frame(frame)


def _append(writer: Writer, total: dict[str, Any], future: Future[Any]) -> None:
    encoded, counts = future.result()
    writer.append(encoded)
    statistics.add(total, counts)
