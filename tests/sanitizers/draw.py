"""``python -m tests.sanitizers.draw cpu box sphere``: draw scenes in a process that a sanitizer watches."""

import faulthandler
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest
import warp as wp

from tests.sanitizers import clang, includes
from tests.sanitizers.reports import BEGINS, ENDS, HEADER


def apart(scratch: Any) -> None:
    """Have each buffer of a frame be an allocation of its own, whose ends a sanitizer knows."""
    kept: list[wp.array] = []

    def buffers(self: Any, key: str | int, worlds: range, _places: Any) -> dict[str, wp.array]:
        camera, found = self._cameras[key], {}
        for name, dtype, (height, width) in self._plans[key].scratch(camera.width, camera.height):
            own = wp.empty((len(worlds), height, width, 1), dtype=dtype, device=self._device)
            kept.append(own)
            start = own.ptr - worlds.start * own.strides[0]
            shape = (self._num_worlds, height, width, 1)
            found[name] = wp.array(ptr=start, shape=shape, dtype=dtype, device=self._device)
        return found

    scratch.Scratch._buffers = buffers


def tell_headers() -> None:
    """Write a line for each of our headers that a kernel includes which is loaded from now on."""
    load, told = wp.Module.load, set()

    def loading(module: wp.Module, *args: Any, **options: Any) -> Any:
        build = module.options.get("extra_build_options")
        for header in includes.named(build.extra_cuda_preamble if build else ""):
            if header not in told:
                told.add(header)
                print(f"{HEADER}{header}", flush=True)
        return load(module, *args, **options)

    wp.Module.load = loading


def main(device: str, names: Sequence[str], own: Mapping[str, Callable[[wp.Device], object]] | None = None) -> None:
    """Draw scenes of those names, or of one's own, one after another."""
    faulthandler.enable()
    if device == "cpu":
        clang.install()
    tell_headers()
    if own is None:
        from tests.sanitizers.scenes import SCENES as own  # noqa: N811
    from warpcam.render import scratch_memory

    apart(scratch_memory)
    where = wp.get_device(device)
    if where.is_cuda:
        wp.set_mempool_enabled(where, False)  # else many arrays lie in one allocation
        wp.config.lineinfo = True
    for name in names:
        began = time.monotonic()
        print(f"{BEGINS}{name}", flush=True)
        try:
            with wp.ScopedDevice(where):
                own[name](where)
            wp.synchronize()
        except (Exception, pytest.skip.Exception):  # what a scene needs may not be installed
            print(traceback.format_exc(), flush=True)
            continue
        seconds = time.monotonic() - began
        if where.is_cuda:
            time.sleep(0.2)  # a tool's process writes what it found
        print(f"{ENDS}{seconds:.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
