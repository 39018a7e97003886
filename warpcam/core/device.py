"""The one device rule.

Everything of a scene lies on one Warp device: its arrays, its trees, its images. A source that already has arrays on
a device decides it; only a source on the host lets the user choose. Devices are CPU and the CUDA ordinals that
``CUDA_VISIBLE_DEVICES`` leaves visible, as Warp and torch count them; nothing else chooses a device.
"""

import logging
import os
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpcam.core.errors import WarpcamError
from warpcam.kernels.runtime.compile import building
from warpcam.kernels.runtime.streams import active_contexts, driver_installed

VISIBLE = "CUDA_VISIBLE_DEVICES"

# Variables that choose a GPU for OpenGL. Nothing here reads them.
GRAPHICS_VARIABLES = ("MUJOCO_EGL_DEVICE_ID", "EGL_DEVICE_ID", "EGL_VISIBLE_DEVICES")

_told: set[str] = set()  # those that have been said to be ignored


def resolve(device: Any = None) -> wp.Device:
    """The device that is meant.

    Args:
        device: A Warp device, a torch device, a name ("cpu", "cuda", "cuda:1"), a CUDA ordinal, or None for Warp's
            current device. "cuda" is the current one of the GPUs. Ordinals count the GPUs that this process sees:
            with ``CUDA_VISIBLE_DEVICES=2,3`` the third GPU of the machine is 0.

    Raises:
        WarpcamError: There is no such device. The message tells which there are, what ``CUDA_VISIBLE_DEVICES`` is, and
            which GPU of the machine each ordinal is.
    """
    _tell_of_graphics_variables()
    if isinstance(device, wp.Device):
        return device
    with building:  # Warp's start marks modules that others load
        wp.init()
    ordinal = _ordinal(device)
    if device is None or isinstance(device, str):
        name = device
    else:
        name = str(device) if ordinal is None else f"cuda:{ordinal}"  # a torch.device; an int
    try:
        if name == "cuda" and not wp.get_cuda_device_count():  # Warp writes of errors before it raises
            raise ValueError(name)
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        visible = ", ".join(known.alias for known in wp.get_devices())
        raise WarpcamError(f"device: {device!r} came, this process sees {visible}; {ordinals()}") from None


def ordinals() -> str:
    """``CUDA_VISIBLE_DEVICES``, and which GPU of the machine each visible ordinal is as far as it tells, in words."""
    setting = os.environ.get(VISIBLE)
    if not driver_installed():
        return meaning() + ("" if setting is None else f" ({VISIBLE}={setting!r})")
    if setting is None:
        return f"{VISIBLE} is not set: {meaning()}"
    return f"{VISIBLE}={setting!r}: {meaning()}"


def meaning() -> str:
    """Explain the present value of ``CUDA_VISIBLE_DEVICES``."""
    setting, count = os.environ.get(VISIBLE), wp.get_cuda_device_count()
    if not driver_installed():
        return "there is no CUDA driver"
    if setting is None:
        return "all GPUs that CUDA finds are visible"
    entries = [entry.strip() for entry in setting.split(",")] if setting.strip() else []
    if len(entries) == count:
        return ", ".join(f"cuda:{i} is {_gpu(entry)}" for i, entry in enumerate(entries)) or "every GPU is hidden"
    return (
        f"it names {len(entries)}, and CUDA shows {count}: it stops at the first that it does not find, shows none if "
        "one comes twice, and does not read what is set after it has started"
    )


def contexts() -> list[int]:
    """Ordinals of the visible GPUs on which this process has a CUDA context, and so some of their memory.

    Rendering makes one on the scene's device and on no other. Asking makes none.
    """
    return active_contexts()


def require_same(expected: wp.Device, whose: str, found: wp.Device, what: str) -> None:
    """Raise if ``what`` does not lie where ``whose`` arrays lie."""
    if found != expected:
        raise WarpcamError(f"device: {what} is on {found.alias}, but {whose} on {expected.alias}; both must be on one")


def free_bytes(device: wp.Device) -> int | None:
    """Memory that can still be allocated there, None if nobody knows."""
    if device.is_cuda:
        kept = 0  # memory that was freed but is kept by Warp's pool, at most
        if device.is_mempool_enabled:
            threshold = wp.get_mempool_release_threshold(device)
            kept = max(threshold - wp.get_mempool_used_mem_current(device), 0)
        taken = device.total_memory - device.free_memory
        return int(device.free_memory + min(kept, taken))
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")), None)


def _ordinal(device: Any) -> int | None:
    """The integer it is, of Python's or NumPy's; None for all else. True is no GPU."""
    return int(device) if isinstance(device, int | np.integer) and not isinstance(device, bool) else None


def _gpu(entry: str) -> str:
    """Explain an entry of the variable: a number in CUDA's own order, or a UUID of a GPU or of a part of one."""
    return f"GPU {entry}" if entry.isdecimal() else entry


def _tell_of_graphics_variables() -> None:
    for name in GRAPHICS_VARIABLES:
        if name in os.environ and name not in _told:
            _told.add(name)
            logging.getLogger("warpcam").warning(
                "%s=%s chooses a GPU for OpenGL; warpcam uses none and ignores it", name, os.environ[name]
            )
