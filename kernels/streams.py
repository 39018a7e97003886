"""CUDA streams of our own."""

import ctypes
import functools
import sys
import weakref

import warp as wp

NON_BLOCKING = 1  # CU_STREAM_NON_BLOCKING


def quiet_stream(device: wp.Device) -> wp.Stream:
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


@functools.cache
def _driver() -> ctypes.CDLL:
    return ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
