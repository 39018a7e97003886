"""compute-sanitizer over the kernels of scenes, on a GPU."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import warp as wp

from tests.sanitizers import includes, reports

TOOLS = {
    "memcheck": ("--padding", "256"),  # bytes behind each allocation that nothing may touch
    "racecheck": (),
    "initcheck": (),
    "synccheck": (),
}
PLACES = ("/usr/local/cuda/bin/compute-sanitizer",)  # where it may be beside the PATH
LIMIT = 290.0  # seconds in all
Ran = tuple[str, int | None, str]  # tool, exit status (None where its time was over) and what it wrote


def available() -> str | None:
    """Why it cannot run here; None if it can."""
    if not wp.is_cuda_available():
        return "needs a GPU"
    return None if _program() else "needs compute-sanitizer, which comes with CUDA's toolkit"


def _program() -> str | None:
    return shutil.which("compute-sanitizer") or next((path for path in PLACES if Path(path).is_file()), None)


def run(names: Sequence[str], tools: Sequence[str], processes: int) -> dict[str, Any]:
    """Draw scenes under each tool; what was found in each, and which headers their kernels include.

    Kernels are compiled ahead, by processes that no tool watches.

    Args:
        names: Of the scenes.
        tools: Of compute-sanitizer.
        processes: At most so many at a time.
    """
    count = max(1, min(len(names), processes // len(tools)))
    groups = [names[first::count] for first in range(count)]
    until = time.monotonic() + LIMIT
    with ThreadPoolExecutor(processes) as pool:
        compiled = list(pool.map(lambda group: _drawn("compiled", group, until), groups))
        for _, status, text in compiled:
            if status != 0:
                raise RuntimeError(text[-4000:])
        jobs = [(tool, group) for tool in tools for group in groups]
        watched = list(pool.map(lambda job: _drawn(*job, until), jobs))
    scenes = [scene for tool, _, text in watched for scene in reports.drawn(text, tool)]
    begun = {(scene["tool"], scene["scene"]) for scene in scenes}
    for tool, group in jobs:
        scenes += [
            {"tool": tool, "scene": name, "seconds": None, "end": "never begun", "findings": []}
            for name in group
            if (tool, name) not in begun
        ]
    reached = includes.closure(line for _, _, text in compiled for line in reports.told(text, reports.HEADER))
    return {
        "device": wp.get_device("cuda:0").name,
        "scenes": sorted(scenes, key=lambda scene: (scene["tool"], scene["scene"])),
        "headers_included": sorted(reached),
        "headers_left": sorted(includes.all_headers() - reached),
    }


def _drawn(tool: str, names: Sequence[str], until: float) -> Ran:
    """Draw scenes in one process, which is ended with all its children when its time is over."""
    watch = () if tool == "compiled" else (str(_program()), "--tool", tool, *TOOLS[tool], "--print-limit", "100")
    command = [*watch, sys.executable, "-m", "tests.sanitizers.draw", "cuda:0", *names]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(reports.ROOT), os.environ.get("PYTHONPATH", "")])}
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen(
            command, cwd=reports.ROOT, env=env, stdout=out, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            status: int | None = process.wait(max(until - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            status = None
        out.seek(0)
        text = out.read().decode(errors="replace")
    return tool, status, text if status is not None else f"{text}\nthe {LIMIT:g} s of all were over"
