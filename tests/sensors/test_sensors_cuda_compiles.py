"""Compilation of all kernels of sensors for a GPU, by NVRTC, which needs none."""

import importlib
import pkgutil
from pathlib import Path

import pytest
import warp as wp

from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.sensors import kernels

ARCH = 90
MODULES = sorted(each.name for each in pkgutil.iter_modules(kernels.__path__, f"{kernels.__name__}."))
MODULES += ["warpcam.compat.isaaclab.kernels", "warpcam.compat.mujoco_warp.kernels"]


@pytest.mark.parametrize("name", MODULES)
def test_kernels_compile_for_cuda(name: str, tmp_path: Path) -> None:
    values = vars(importlib.import_module(name)).values()
    modules = {value.module.name: value.module for value in values if isinstance(value, wp.Kernel)}
    for module in modules.values():
        assert module.options["cpu_compiler_flags"] == compiler_flags()["cpu_compiler_flags"]
        (path,) = wp.compile_aot_module(module, arch=ARCH, module_dir=tmp_path / module.name, use_ptx=True)
        assert path.stat().st_size > 0


def test_there_are_kernels() -> None:
    kernels_of = [vars(importlib.import_module(name)).values() for name in MODULES]
    assert sum(any(isinstance(value, wp.Kernel) for value in values) for values in kernels_of) > 4
