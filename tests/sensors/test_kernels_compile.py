"""Compilation of all kernels of sensors for a GPU, which needs none."""

import importlib
import pkgutil
from pathlib import Path

import pytest
import warp as wp

from warpcam.sensors import kernels

ARCH = 90
NAMES = [f"{kernels.__name__}.{found.name}" for found in pkgutil.iter_modules(kernels.__path__)]
MODULES = {name: wp.get_module(name) for name in NAMES if importlib.import_module(name)}
COMPILED = [name for name, module in MODULES.items() if module.kernels]


@pytest.mark.parametrize("name", COMPILED)
def test_kernels_compile_for_a_gpu(name: str, tmp_path: Path) -> None:
    (path,) = wp.compile_aot_module(MODULES[name], arch=ARCH, module_dir=tmp_path, use_ptx=True)
    assert path.stat().st_size > 0


def test_there_are_kernels() -> None:
    assert len(COMPILED) > 4
