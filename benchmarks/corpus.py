"""Every file of a collection: rendered, or refused with a WarpcamError, each in a process of its own.

    python -m warpcam.benchmarks.corpus FOLDER... [--seconds 20] [--memory 2] [--out FILE.csv]

Prints a line for each file and a table at the end; the CSV has the lines. Exit code 1: some file crashed, hung, took
too much memory, or raised something else than a WarpcamError.
"""

import argparse
import csv
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

import warpcam as wc
from warpcam.sources.common import formats
from warpcam.sources.mujoco import batch_file

SUFFIXES = (*formats.USD, *formats.MESHES, ".urdf")
FINE = ("rendered", "refused")
SIZE = 64  # of the image [pixels]


@dataclass(frozen=True)
class Outcome:
    """Outcome of one file."""

    path: Path
    what: str  # "rendered", "refused", or what went wrong
    detail: str
    seconds: float
    peak: float  # resident memory [GiB]


def find(folders: Sequence[Path]) -> Iterator[Path]:
    for folder in folders:
        if folder.is_file():
            yield folder
        else:
            yield from sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())


def render(path: Path) -> str:
    """Render one picture; returns what there is to say of it."""
    scene = wc.load(path, 2, device="cpu")
    low, high = scene.bounds()
    camera = wc.Camera(
        "free", width=SIZE, height=SIZE, outputs=("rgb", "depth"), **batch_file.free_camera(None, low, high, 1.0)
    )
    depth = wc.Renderer(scene, [camera]).render()["free"]["depth"].numpy()
    return f"{np.isfinite(depth).mean():5.1%} of the pixels, {np.linalg.norm(high - low):.3g} m"


def attempt(path: Path, seconds: float, memory: float) -> Outcome:
    """Render one file in a child of this process, which has everything imported."""
    start = time.perf_counter()
    receive, send = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(receive)
        code = 3
        try:
            os.setsid()
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            text = render(path)
            code = 0
        except wc.WarpcamError as error:
            text, code = str(error), 1
        except BaseException as error:  # all of it is to be told
            text = f"{type(error).__name__}: {error}"
        finally:
            os.write(send, " ".join(text.split()).encode()[:4000])
            os._exit(code)
    os.close(send)
    what, peak = "", 0.0
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        peak = max(peak, resident(child))
        if time.perf_counter() - start > seconds or peak > memory:
            what = "hung" if peak <= memory else "took too much memory"
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            break
        time.sleep(0.02)
    with os.fdopen(receive, "rb") as pipe:
        detail = pipe.read().decode(errors="replace")
    if not what:
        code = os.waitstatus_to_exitcode(status)
        what = {0: "rendered", 1: "refused", 3: "raised something else"}.get(code, f"crashed ({code})")
    return Outcome(path, what, detail, time.perf_counter() - start, peak)


def resident(process: int) -> float:
    """Resident memory of a process [GiB]."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**30


def warm_up() -> None:
    """Compile in a child what nearly all files need: a parent with threads must not fork."""
    child = os.fork()
    if child == 0:
        try:
            render(batch_file.DEMO.parent / "vase.obj")
        finally:
            os._exit(0)
    os.waitpid(child, 0)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--seconds", type=float, default=20.0, help="for each file (default: %(default)s)")
    parser.add_argument("--memory", type=float, default=2.0, help="for each file [GiB] (default: %(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write what became of each file, too")
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_WARNING
    warm_up()
    counts: Counter[tuple[str, str]] = Counter()
    rows = []
    for path in find(options.folders):
        outcome = attempt(path, options.seconds, options.memory)
        name = next(str(path.relative_to(folder)) for folder in options.folders if path.is_relative_to(folder))
        rows.append((name, outcome.what, outcome.detail.replace(str(path), name)[:160]))
        counts[path.suffix.lower(), outcome.what] += 1
        print(f"{outcome.what:22} {outcome.seconds:5.1f} s {outcome.peak:4.1f} GiB  {path}: {outcome.detail[:160]}")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([("file", "outcome", "detail"), *rows])
    kinds = sorted({kind for kind, _ in counts})
    outcomes = sorted({what for _, what in counts}, key=lambda what: (what not in FINE, what))
    print("\n| files | " + " | ".join(outcomes) + " |\n|---|" + "---:|" * len(outcomes))
    for kind in kinds:
        print(f"| {kind} | " + " | ".join(str(counts[kind, what]) for what in outcomes) + " |")
    return int(any(what not in FINE for _, what in counts))


if __name__ == "__main__":
    sys.exit(main())
