"""Kernels that are quick to compile, which is what most of the tests' time goes into.

Warp's simulators and their renderers are compiled without optimising, in a fifth of the time: they compute little in
tests. Where there is a GPU they are optimised a little, as Warp warns of CUDA's compiler otherwise. Run as a program
this runs another one so, in the same process.

Our own are the same code on a CPU, optimised less, in two thirds of the time; WARPCAM_TESTS=optimized has them compiled
as they are for users. Tests that start programs of their own (examples, the command line, the doctor, benchmarks), and
those of single native functions, always have them so.
"""

import os
import runpy
import sys
from pathlib import Path
from typing import Any

import warp as wp

SIMULATORS = {"mujoco_warp", "newton"}


def install(ours: bool = False) -> None:
    """Have simulators compiled so from now on, and warpcam too if ``ours``."""
    ours = ours and os.environ.get("WARPCAM_TESTS") != "optimized"
    resolve = wp.Module.resolve_options

    def resolve_options(module: wp.Module, *args: Any, **kwargs: Any) -> dict[str, Any]:
        options = resolve(module, *args, **kwargs)
        homes = {kernel.func.__module__.partition(".")[0] for kernel in module.kernels.values()}
        if homes and homes <= SIMULATORS and options["optimization_level"] is None:
            options["optimization_level"] = 1 if wp.is_cuda_available() else 0
        elif homes == {"warpcam"} and ours and options.get("cpu_compiler_flags"):
            options["cpu_compiler_flags"] += " -O1 -fno-vectorize -fno-slp-vectorize -DWARPCAM_QUICK"
        return options

    wp.Module.resolve_options = resolve_options


if __name__ == "__main__":
    del sys.argv[0]
    sys.path[0] = str(Path(sys.argv[0]).parent)
    install()
    runpy.run_path(sys.argv[0], run_name="__main__")
