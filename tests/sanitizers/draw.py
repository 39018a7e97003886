"""``python -m tests.sanitizers.draw cpu box sphere``: draw scenes in a process that a sanitizer watches."""

import faulthandler
import os
import sys
import time
from typing import Any

import warp as wp


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


def main(device: str, names: list[str]) -> None:
    faulthandler.enable()
    if device == "cpu":
        from tests.sanitizers import clang

        clang.install()
    from tests.sanitizers import scenes
    from warpcam.render import scratch_memory

    apart(scratch_memory)
    where = wp.get_device(device)
    if where.is_cuda:
        wp.set_mempool_enabled(where, False)  # else many arrays lie in one allocation
    for name in names or list(scenes.SCENES):
        began = time.monotonic()
        print(name, end=" ", flush=True)
        print(f"begins {name}", file=sys.stderr, flush=True)
        with wp.ScopedDevice(where):
            scenes.SCENES[name](where)
        wp.synchronize()
        print(f"{time.monotonic() - began:.1f}", flush=True)


if __name__ == "__main__":
    os.environ.setdefault("WARPCAM_CPU_THREADS", "1")
    main(sys.argv[1], sys.argv[2:])
