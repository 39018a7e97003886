"""The one device rule.

Everything of a scene lies on one Warp device: its arrays, its trees, its images. A source that already has arrays on
a device decides it; only a source on the host lets the user choose. Devices are CPU and the CUDA ordinals that
``CUDA_VISIBLE_DEVICES`` leaves visible, as Warp and torch count them; nothing else chooses a device.
"""

import functools
import logging
import os
from pathlib import Path
from typing import Any

import warp as wp

from warpcam.errors import WarpcamError

# Variables that choose a GPU for OpenGL. Nothing here reads them.
GRAPHICS_VARIABLES = ("MUJOCO_EGL_DEVICE_ID", "EGL_DEVICE_ID", "EGL_VISIBLE_DEVICES")


def resolve(device: Any = None) -> wp.Device:
    """The device that is meant.

    Args:
        device: A Warp device, a torch device, a name ("cpu", "cuda", "cuda:1"), a CUDA ordinal, or None for Warp's
            current device.

    Raises:
        WarpcamError: There is no such device.
    """
    _tell_of_graphics_variables()
    if isinstance(device, wp.Device):
        return device
    if isinstance(device, int) and not isinstance(device, bool):
        name: str | None = f"cuda:{device}"
    elif device is None or isinstance(device, str):
        name = device
    else:
        name = str(device)  # a torch.device
    if name == "cuda" and not wp.is_cuda_available():
        name = "cuda:0"
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        visible = ", ".join(known.alias for known in wp.get_devices())
        setting = os.environ.get("CUDA_VISIBLE_DEVICES")
        because = "" if setting is None else f" (CUDA_VISIBLE_DEVICES={setting!r})"
        raise WarpcamError(f"device: {device!r} came, this process sees {visible}{because}") from None


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


@functools.cache
def _tell_of_graphics_variables() -> None:
    for name in GRAPHICS_VARIABLES:
        if name in os.environ:
            logging.getLogger("warpcam").warning(
                "%s=%s chooses a GPU for OpenGL; warpcam uses none and ignores it", name, os.environ[name]
            )
