"""Fixtures of every test: the devices there are, and the helpers in tests/helpers."""

import contextlib
import ctypes.util
import functools
import gc
import importlib.metadata
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Workers share the cores. With as many threads in each, images would be cut into smaller regions, for which more
# kernels are compiled; Torch's, NumPy's and Mesa's would wait for each other, busily, for longer than they work.
if workers := os.environ.get("PYTEST_XDIST_WORKER_COUNT"):
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for name in ("WARPCAM_CPU_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "LP_NUM_THREADS"):
        os.environ.setdefault(name, str(max(1, cores // int(workers))))
# Before anything imports mujoco: its own renderer judges some tests, and works without a display on Mesa. Where it has
# neither it is told so: what is left of a context that could not be made would fail another test.
if ctypes.util.find_library("OSMesa"):
    os.environ.setdefault("MUJOCO_GL", "osmesa")
elif sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "disable")
# JAX in one worker would take three quarters of a GPU's memory from all others.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
sys.path.append(str(Path(__file__).parent / "helpers"))
# Triton, which libraries of learning import, crashes if Mesa has loaded its own LLVM before.
with contextlib.suppress(ImportError):
    import triton  # noqa: F401

import fast_compile
import pytest
import warp as wp

gc.disable()  # until all is imported, which stays
# MuJoCo-Warp asks for a version with each model, and reads a file of a thousand lines for it.
importlib.metadata.version = functools.cache(importlib.metadata.version)
wp.config.log_level = wp.LOG_WARNING
fast_compile.install(ours=True)
gc.set_threshold(10_000, 10, 10)  # what tests make is small, and what is in circles can wait
wp.init()
os.environ.setdefault("WARPCAM_TESTS_HEADERS", wp.config.kernel_cache_dir)


def pytest_collection_finish() -> None:
    """Have no collection of garbage go through all that was imported, which takes half a second each time."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """Let Python take all down at its end, of which modules in C++ tell otherwise."""
    gc.unfreeze()


@pytest.fixture(params=[device.alias for device in wp.get_devices()])
def device(request: pytest.FixtureRequest) -> Iterator[wp.Device]:
    """Each device of this machine in turn, as Warp's current device."""
    with wp.ScopedDevice(request.param) as current:
        yield current


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the modules that Warp compiles or loads from now on."""
    names: list[str] = []
    load = wp.Module.load

    def counted(module: wp.Module, *args: Any, **options: Any) -> Any:
        before = len(module.execs)
        result = load(module, *args, **options)
        names.extend([module.name] * (len(module.execs) - before))
        return result

    monkeypatch.setattr(wp.Module, "load", counted)
    return names


@pytest.fixture
def stage(tmp_path: Path) -> Any:
    """A stage of USD: empty, in metres, z up, in a file of its own."""
    usd = pytest.importorskip("pxr.Usd", reason="needs USD: pip install warpcam[usd]")
    from usd_stages import metric

    return metric(usd.Stage.CreateNew(str(tmp_path / "scene.usda")))


@pytest.fixture
def small_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps of light from all around no larger than small images ask for: those of users take seconds."""
    from warpcam.kernels.build import environment_maps

    monkeypatch.setattr(environment_maps, "LEAST_SIDE", 64)
