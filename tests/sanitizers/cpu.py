"""AddressSanitizer and UndefinedBehaviorSanitizer over the kernels of scenes, on a CPU."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.sanitizers import clang, coverage, reports

CACHE = reports.ROOT / "build" / "sanitizers"  # compiled once for all runs


def available() -> str | None:
    """Why it cannot run here; None if it can."""
    if sys.platform != "linux":
        return "needs Linux"
    missing = [name for name in ("clang", "llvm-profdata", "llvm-cov", "llvm-symbolizer") if clang.tool(name) is None]
    if missing:
        return f"needs {', '.join(missing)}: apt-get install clang-19 libclang-rt-19-dev llvm-19"
    return None if clang.runtime().is_file() else "needs clang's sanitizers: apt-get install libclang-rt-19-dev"


def environment(folder: Path) -> dict[str, str]:
    """Variables of a process that is watched, which writes its counts to a folder."""
    symbols = str(clang.tool("llvm-symbolizer"))
    return {
        **os.environ,
        "LD_PRELOAD": str(clang.runtime()),
        # Of Python and what it loads much is never freed. Where memory is asked for in vain, callers are told.
        "ASAN_OPTIONS": "detect_leaks=0:halt_on_error=0:handle_segv=0:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "ASAN_SYMBOLIZER_PATH": symbols,
        "UBSAN_SYMBOLIZER_PATH": symbols,
        "LLVM_PROFILE_FILE": str(folder / "%m.profraw"),
        "MUJOCO_GL": "disable",
        "PYTHONPATH": os.pathsep.join([str(reports.ROOT), os.environ.get("PYTHONPATH", "")]),
        "WARPCAM_CPU_THREADS": "1",
        "WARP_CACHE_PATH": str(CACHE),
    }


def run(names: Sequence[str], tests: Sequence[str] = ()) -> dict[str, Any]:
    """Draw scenes in a process that is watched; what was found in each, and which functions were reached.

    Args:
        names: Of the scenes.
        tests: Arguments of pytest: tests that run in place of scenes.
    """
    command = ["-m", "tests.sanitizers.draw", "cpu", *names]
    if tests:
        command = ["-m", "pytest", "-p", "tests.sanitizers.plugin", "-n", "0", "-s", *tests]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        text = watched(command, folder)
        found = reports.drawn(text)
        if not found:
            raise RuntimeError(text[-4000:])
        reached = coverage.measure(sorted(folder.glob("*.profraw")), reports.told(text, clang.LOADS), folder)
    return {"scenes": found, "headers": reached}


def watched(command: Sequence[str], folder: Path) -> str:
    """Run Python with arguments in a process that is watched; what it wrote, which is kept in a file, too."""
    CACHE.mkdir(parents=True, exist_ok=True)
    log = CACHE / "log"
    with log.open("wb") as out:
        subprocess.run(
            [sys.executable, *command],
            cwd=reports.ROOT,
            env=environment(folder),
            stdout=out,
            stderr=subprocess.STDOUT,
            check=False,
        )
    return log.read_text(errors="replace")
