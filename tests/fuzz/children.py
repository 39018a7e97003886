"""Cases in forked children with limits of memory and time; a child that dies or hangs costs one case."""

import faulthandler
import json
import os
import resource
import select
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from warpcam.core.errors import WarpcamError

MEMORY, SECONDS = 2 << 30, 20.0  # bytes beyond what the child has at its start; of one case
ROOT = str(Path(__file__).resolve().parents[2])


@dataclass
class Outcome:
    """What came of one case.

    Attributes:
        case: Its number.
        kind: "ok", "refused" (a ``WarpcamError``), "other" exception, "signal" or "hang".
        what: The error's words.
        place: Where an other exception was raised.
        seconds: How long it took.
    """

    case: int
    kind: str
    what: str = ""
    place: str = ""
    seconds: float = 0.0


def run(open_case: Callable[[int], None], cases: range, folder: Path, until: float) -> list[Outcome]:
    """Open cases one after the other, until ``time.monotonic()`` is ``until``.

    The first is opened once before without limits: it may compile kernels, which are kept on the disk.
    """
    _warm(open_case, cases[0])
    outcomes: list[Outcome] = []
    while len(outcomes) < len(cases) and time.monotonic() < until:
        outcomes += _child(open_case, cases[len(outcomes) :], folder, until)
    return outcomes


def _warm(open_case: Callable[[int], None], case: int) -> None:
    child = os.fork()
    if child == 0:
        _silence()
        _outcome(open_case, case)
        os._exit(0)
    os.waitpid(child, 0)


def _child(open_case: Callable[[int], None], cases: range, folder: Path, until: float) -> list[Outcome]:
    """Cases of one child, as far as it comes."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _serve(open_case, cases, writing, folder)
    os.close(writing)
    outcomes: list[Outcome] = []
    rest, began = b"", time.monotonic()
    while time.monotonic() < until or not outcomes:
        ready, _, _ = select.select([reading], [], [], max(began + SECONDS - time.monotonic(), 0.0))
        data = os.read(reading, 1 << 16) if ready else None
        if data:
            *lines, rest = (rest + data).split(b"\n")
            outcomes += [Outcome(**json.loads(line)) for line in lines]
            began = time.monotonic()
            continue
        if data is None:
            outcomes.append(Outcome(cases[len(outcomes)], "hang", f"over {SECONDS:g} s", seconds=SECONDS))
        break
    os.close(reading)
    if len(outcomes) < len(cases):
        try:
            os.kill(child, signal.SIGKILL) if data is None or data else None
        except ProcessLookupError:
            pass
    status = os.waitpid(child, 0)[1]
    if data == b"" and len(outcomes) < len(cases):
        name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {status >> 8}"
        outcomes.append(Outcome(cases[len(outcomes)], "signal", name, _crash(folder)))
    return outcomes


def _crash(folder: Path) -> str:
    """Where a child died, of Python's own calls."""
    lines = (folder / "crash").read_text(errors="replace").splitlines()
    return " < ".join(line.strip() for line in lines if line.startswith("  File"))[:400]


def _serve(open_case: Callable[[int], None], cases: range, writing: int, folder: Path) -> None:
    _silence()
    with (folder / "crash").open("w") as crash:
        faulthandler.enable(crash)
        _limit()
        for case in cases:
            began = time.monotonic()
            outcome = _outcome(open_case, case)
            outcome.seconds = round(time.monotonic() - began, 3)
            os.write(writing, json.dumps(asdict(outcome)).encode() + b"\n")
        os._exit(0)


def _silence() -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    warnings.simplefilter("ignore")


def _limit() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _outcome(open_case: Callable[[int], None], case: int) -> Outcome:
    try:
        open_case(case)
    except WarpcamError as error:
        return Outcome(case, "refused", str(error)[:200])
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename.startswith(f"{ROOT}/warpcam")]
        places = [*(own[-1:]), *frames[-1:]]
        place = " < ".join(f"{_shown(frame.filename)}:{frame.lineno}" for frame in places)
        return Outcome(case, "other", f"{type(error).__name__}: {str(error)[:200]}", place)
    return Outcome(case, "ok")


def _shown(file: str) -> str:
    """A file's path without what differs between machines."""
    return file.removeprefix(ROOT).rpartition("/site-packages/")[2]
