"""Kernels that are quick to compile, which is what most of the tests' time goes into.

Warp's simulators and their renderers are compiled without optimising, in a fifth of the time: they compute little in
tests. Where there is a GPU they are optimised a little, as Warp warns of CUDA's compiler otherwise.

Our own that call kernels/native are the same code on a CPU, not optimised, in a fifth of the time; with
WARPCAM_TESTS=optimized they are compiled as for users. So are those that call none of it: they have few variants, and
would lose more time in running slowly than in compiling. So all are in tests of single native functions, and in
programs that a test starts as a user would: Python's own arguments behind this file's name run another one quickly,
with the kernels of other tests.

Garbage is looked for rarely: doing so takes a third of the time in which a program imports Torch and MuJoCo-Warp.

Headers are precompiled once for all processes, not in each of them, and ours (precompiled.h) with Warp's; a program
that a test starts with another folder for its kernels takes them from the tests' own (WARPCAM_TESTS_HEADERS).
"""

import fcntl
import gc
import hashlib
import os
import runpy
import sys
from pathlib import Path
from typing import Any

import warp as wp

SIMULATORS = {"mujoco", "mujoco_warp", "newton"}  # MJX has a MuJoCo-Warp of its own within mujoco
PRECOMPILED = Path(__file__).with_name("precompiled.h")
# What templates Warp's headers need themselves is instantiated with them, not in each module.
INSTANTIATED = "-fpch-instantiate-templates"
QUICK = f"-O0 -DWARPCAM_QUICK {INSTANTIATED}"


def install(ours: bool = False) -> None:
    """Have simulators compiled so from now on, and warpcam too if ``ours``."""
    gc.set_threshold(100_000, 100, 100)
    ours = ours and os.environ.get("WARPCAM_TESTS") != "optimized"
    resolve = wp.Module.resolve_options

    def resolve_options(module: wp.Module, *args: Any, **kwargs: Any) -> dict[str, Any]:
        options = resolve(module, *args, **kwargs)
        homes = {kernel.func.__module__.partition(".")[0] for kernel in module.kernels.values()}
        if homes and homes <= SIMULATORS and options["optimization_level"] is None:
            options["optimization_level"] = 1 if wp.is_cuda_available() else 0
            options["cpu_compiler_flags"] = f"-march=native {INSTANTIATED}"
        elif homes == {"warpcam"} and ours and options.get("cpu_compiler_flags"):
            native = bool(options["extra_cpu_preamble"])
            options["cpu_compiler_flags"] += f" {QUICK}{_together()}" if native else f" {INSTANTIATED}"
            if native:
                options["extra_cpu_preamble"] += "#pragma clang fp contract(on)\n"  # as core/platform.h has it
        return options

    wp.Module.resolve_options = resolve_options
    share_headers()


def _together() -> str:
    """Flags that have our headers precompiled, wherever warpcam is installed; Warp takes none with a space in it."""
    native = sys.modules["warpcam.kernels.runtime.compile"].NATIVE
    return "" if " " in f"{native}{PRECOMPILED}" else f" -I{native} -include {PRECOMPILED}"


def share_headers() -> None:
    """Have all processes with the same sources share their precompiled headers, and QUICK be quick to the end."""
    build = wp._src.build.build_cpu
    sources = [*sorted((PRECOMPILED.parents[2] / "kernels" / "native").rglob("*.h")), PRECOMPILED, Path(wp.__file__)]
    stamps = [(str(path), path.stat().st_mtime_ns) for path in sources]
    name = f"wp_headers_{hashlib.sha256(repr(stamps).encode()).hexdigest()[:16]}"
    made: set[tuple[Any, ...]] = set()

    def build_cpu(*args: Any, **options: Any) -> None:
        if QUICK in options["extra_flags"]:
            options["optimization_level"] = 0  # of what turns the optimised code into the machine's
        folder = Path(os.environ.get("WARPCAM_TESTS_HEADERS", wp.config.kernel_cache_dir), name)
        folder.mkdir(parents=True, exist_ok=True)
        if options["pch_dir"]:
            options["pch_dir"] = str(folder)
        kind = (options["extra_flags"], options["optimization_level"], options["block_dim"])
        if kind in made:
            return build(*args, **options)
        with open(folder / "lock", "w") as lock:  # the first of all processes precompiles them; others wait for it
            fcntl.flock(lock, fcntl.LOCK_EX)
            build(*args, **options)
        made.add(kind)
        return None

    wp._src.build.build_cpu = build_cpu


if __name__ == "__main__":
    install(ours=True)
    kind, sys.argv = sys.argv[1], sys.argv[1:]
    if kind in ("-c", "-m"):
        what = sys.argv.pop(1)
        sys.path[0] = ""
    if kind == "-c":
        exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})
    elif kind == "-m":
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        sys.path[0] = str(Path(kind).parent)
        runpy.run_path(kind, run_name="__main__")
