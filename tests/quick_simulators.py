"""Warp's simulators and their renderers, compiled without optimising, in a fifth of the time.

They compute little in tests, and what is tested is ours, which is compiled as it always is. Where there is a GPU they
are optimised a little, as Warp warns of CUDA's compiler otherwise. Run as a program it runs another one so, in the same
process.
"""

import runpy
import sys
from pathlib import Path
from typing import Any

import warp as wp

SIMULATORS = {"mujoco_warp", "newton"}


def install() -> None:
    resolve = wp.Module.resolve_options

    def resolve_options(module: wp.Module, *args: Any, **kwargs: Any) -> dict[str, Any]:
        options = resolve(module, *args, **kwargs)
        homes = {kernel.func.__module__.partition(".")[0] for kernel in module.kernels.values()}
        if homes and homes <= SIMULATORS and options["optimization_level"] is None:
            options["optimization_level"] = 1 if wp.is_cuda_available() else 0
        return options

    wp.Module.resolve_options = resolve_options


if __name__ == "__main__":
    del sys.argv[0]
    sys.path[0] = str(Path(sys.argv[0]).parent)
    install()
    runpy.run_path(sys.argv[0], run_name="__main__")
