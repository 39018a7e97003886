"""warpcam on every GPU: what each draws alone, beside the others in one process, and in processes of their own.

All work is done in spawned processes, so that what one of them has on a card is told from what others have: its CUDA
contexts, and by how much it has raised the memory in use on each card by the time it is ready.
"""

import contextlib
import functools
import multiprocessing
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import warp as wp
from rich.table import Table

from warpcam.benchmarks import measure, peers, problem
from warpcam.benchmarks.cases import CASES, COMMON, DEPTH_AND_IDS, SETTINGS, Case, Wanted
from warpcam.benchmarks.report import Report, Row, console
from warpcam.core.device import contexts
from warpcam.core.errors import WarpcamError

SETTING = SETTINGS["8192x64"]
WANTED = (DEPTH_AND_IDS, COMMON["rgb-ds-shadows"])
SECONDS = 1.0  # of frames: processes that begin a few milliseconds apart are beside each other nearly all the time
MIN_FRAMES, MAX_FRAMES = 4, 5000


def rows(cases: Iterable[Case], worlds: int | None, frames: int | None) -> Iterator[Row]:
    """Measure each case with all GPUs of this process, in all ways."""
    gpus = [device.alias for device in wp.get_cuda_devices()]
    if not gpus:
        raise WarpcamError("--gpus: this process sees no GPU")
    for case in cases:
        for wanted in WANTED:
            yield from measured(case, wanted, worlds or SETTING.worlds_of(case), frames, gpus)


def measured(case: Case, wanted: Wanted, worlds: int, frames: int | None, devices: Sequence[str]) -> Iterator[Row]:
    """A row for each device, alone and then together with all others."""
    facts: Row = {"case": case.name, "outputs": wanted.name, "renderer": "warpcam", "setting": SETTING.name}
    facts |= {"worlds": worlds, "width": SETTING.width, "height": SETTING.height}
    for way, groups in ways(devices):
        for told in side_by_side([(case.name, wanted.name, worlds, frames, group) for group in groups]):
            for device, ms in told["ms"].items():
                row = {**facts, "x": f"{device}, {way}", "device": device, "way": way, "ms": {"mean": ms}}
                yield row | {name: told[name] for name in ("frames", "contexts", "memory_mib")}


def ways(devices: Sequence[str]) -> Iterator[tuple[str, list[Sequence[str]]]]:
    """The devices of each process among those that work at the same time."""
    for device in devices:
        yield "alone", [[device]]
    if len(devices) > 1:
        yield "all in one process", [devices]
        yield "a process each", [[device] for device in devices]


def side_by_side(tasks: Sequence[tuple[Any, ...]]) -> list[dict[str, Any]]:
    """Do each in a process of its own; they get ready one after another, and then render at the same time."""
    spawn = multiprocessing.get_context("spawn")
    living: list[tuple[multiprocessing.process.BaseProcess, Connection]] = []
    memory: list[dict[str, int]] = []
    try:
        for task in tasks:
            ours, theirs = spawn.Pipe()
            before = memory_used()
            process = spawn.Process(target=work, args=(theirs, *task), daemon=True)
            process.start()
            living.append((process, ours))
            theirs.close()
            hear(ours)
            memory.append({card: used - before[card] for card, used in memory_used().items()})
        for _, connection in living:
            connection.send("go")
        return [{**hear(connection), "memory_mib": took} for (_, connection), took in zip(living, memory, strict=True)]
    finally:
        for child, connection in living:
            connection.close()
            child.join()


def hear(connection: Connection) -> Any:
    try:
        return connection.recv()
    except EOFError:
        raise RuntimeError("a process that renders has ended; what it wrote says why") from None


def memory_used() -> dict[str, int]:
    """Memory in use on each card of this machine [MiB], whoever uses it, by UUID; nothing without nvidia-smi."""
    if shutil.which("nvidia-smi") is None:
        return {}
    command = ["nvidia-smi", "--query-gpu=uuid,memory.used", "--format=csv,noheader,nounits"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    return {uuid: int(used) for uuid, used in (line.split(", ") for line in lines)}


def work(
    connection: Connection, case: str, outputs: str, worlds: int, frames: int | None, devices: Sequence[str]
) -> None:
    """Run a process: a renderer on each of its devices, and frames on all of them at once when it is told to."""
    wp.config.log_level = wp.LOG_WARNING
    wanted = next(one for one in WANTED if one.name == outputs)
    loops = [Loop(CASES[case], wanted, worlds, device) for device in devices]
    guess = max(loop.time(MIN_FRAMES) for loop in loops)
    count = frames or int(np.clip(1e3 * SECONDS / max(guess, 1e-3), MIN_FRAMES, MAX_FRAMES))
    connection.send("ready")
    connection.recv()
    for loop in loops:
        loop.begin()
    for index in range(count):
        for loop in loops:
            loop.step(index)
    ms = {loop.device.alias: loop.end() / count for loop in loops}
    connection.send({"ms": ms, "frames": count, "contexts": contexts()})
    with contextlib.suppress(EOFError):
        connection.recv()  # nothing comes: all that this process has stays until the other end is closed


class Loop:
    """Frames on one device, of worlds that move before each."""

    def __init__(self, case: Case, wanted: Wanted, worlds: int, device: str) -> None:
        self.device = wp.get_device(device)
        with wp.ScopedDevice(self.device):
            self.peer = peers.create("warpcam", problem.build(case, worlds, SETTING.width, SETTING.height))
            self.peer.prepare(wanted)
            self.peer.frame("")
            self.moves = [self._move(index) for index in range(problem.POSE_SETS)]

    def _move(self, index: int) -> Callable[[], None]:
        place = functools.partial(self.peer.place, index)
        if not self.device.is_cuda:
            return place
        return functools.partial(wp.capture_launch, measure.captured(place, self.device))

    def step(self, index: int) -> None:
        with wp.ScopedDevice(self.device):
            self.moves[index % len(self.moves)]()
            self.peer.frame("")

    def begin(self) -> None:
        self._wait()
        self.start = time.perf_counter()

    def end(self) -> float:
        """Milliseconds since `begin`, once all that was asked for since is there."""
        self._wait()
        return 1e3 * (time.perf_counter() - self.start)

    def _wait(self) -> None:
        with wp.ScopedDevice(self.device):  # where no context is current, Warp would make one on the first card
            wp.synchronize_device(self.device)

    def time(self, frames: int) -> float:
        """Milliseconds a frame."""
        self.begin()
        for index in range(frames):
            self.step(index)
        return self.end() / frames


def show(report: Report) -> None:
    table = Table("case", "outputs", "worlds", "GPU", "", "ms", "of alone", "contexts", "memory (MiB)", box=None)
    alone: dict[tuple[str, str, str], float] = {}
    for row in report["results"]:
        ms = alone.setdefault((row["case"], row["outputs"], row["device"]), row["ms"]["mean"])
        table.add_row(
            row["case"],
            row["outputs"],
            str(row["worlds"]),
            row["device"],
            row["way"],
            f"{row['ms']['mean']:.3f}",
            f"{row['ms']['mean'] / ms:.2f}",
            ", ".join(map(str, row["contexts"])),
            ", ".join(map(str, row["memory_mib"].values())),
        )
    console().print(table)
