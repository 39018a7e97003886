"""CUDA streams of our own, and the context that others have made current."""

import ctypes
import functools
import sys
import threading
import weakref
from collections import defaultdict
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import warp as wp

Lock = AbstractContextManager[Any]
NON_BLOCKING = 1  # CU_STREAM_NON_BLOCKING

_recording: defaultdict[str, Lock] = defaultdict(threading.RLock)  # by device


def recording_lock(device: wp.Device) -> Lock:
    """Lock for work of a device that may record a graph: while one thread does, Warp counts the device as capturing.

    A thread that holds it may take it again.
    """
    return _recording[device.alias] if device.is_cuda else threading.RLock()


def nonblocking_stream(device: wp.Device) -> wp.Stream:
    """A new stream that has no part in the order of CUDA's legacy default stream.

    Warp's own streams do: while one is captured, whatever another thread puts on the default stream is an error.
    """
    handle = ctypes.c_void_p()
    with wp.ScopedDevice(device):
        error = _driver().cuStreamCreate(ctypes.byref(handle), NON_BLOCKING)
    if error:
        raise RuntimeError(f"cuStreamCreate on {device.alias}: CUDA error {error}")
    stream = wp.Stream(device, cuda_stream=handle.value)
    weakref.finalize(stream, _driver().cuStreamDestroy_v2, handle).atexit = False
    return stream


@contextmanager
def preserve_cuda_context() -> Iterator[None]:
    """Afterwards the same CUDA context is current as before, if one was, on a machine that has CUDA.

    What Warp does on a device leaves that device's context current, and with it torch's current device changes. A
    process that had none keeps that one: with none, torch would make another on the first card.
    """
    if not wp.is_cuda_available():
        yield
        return
    context = ctypes.c_void_p()
    _driver().cuCtxGetCurrent(ctypes.byref(context))
    try:
        yield
    finally:
        if context:
            _driver().cuCtxSetCurrent(context)


def driver_installed() -> bool:
    """Return whether there is a CUDA driver; Warp does not tell if ``CUDA_VISIBLE_DEVICES`` hides every GPU from it."""
    if wp.get_cuda_driver_version() is not None:
        return True
    try:
        _driver()
    except OSError:
        return False
    return True


def active_contexts() -> list[int]:
    """Ordinals of the visible GPUs whose primary context this process has made."""
    flags, active, found = ctypes.c_uint(), ctypes.c_int(), []
    for ordinal in range(wp.get_cuda_device_count()):
        error = _driver().cuDevicePrimaryCtxGetState(ordinal, ctypes.byref(flags), ctypes.byref(active))
        if error:
            raise RuntimeError(f"cuDevicePrimaryCtxGetState of GPU {ordinal}: CUDA error {error}")
        found += [ordinal] if active.value else []
    return found


@functools.cache
def _driver() -> ctypes.CDLL:
    return ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
