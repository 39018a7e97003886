"""Start of Warp for the command line: quietly, and where no folder for compiled kernels can be made."""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import warp as wp

from warpcam.core.errors import WarpcamError

# What Warp writes on every machine without an NVIDIA GPU.
NO_DRIVER = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver"
SETTINGS = "set WARP_CACHE_PATH to a folder for compiled kernels that can be written, and TMPDIR to one for other files"


def start_warp() -> None:
    """Initialise Warp, with a temporary folder for kernels if its own cannot be made.

    Raises:
        WarpcamError: there is no folder at all that can be written.
    """
    try:
        init_quietly()
    except OSError as error:
        _start_elsewhere(error)


def init_quietly() -> None:
    """Initialise Warp without its greeting, and without its word on a driver that is missing."""
    wp.config.log_level = wp.LOG_WARNING
    with _without_line(NO_DRIVER):
        wp.init()


def _start_elsewhere(error: OSError) -> None:
    try:
        folder = tempfile.mkdtemp(prefix="warpcam-kernels-")
    except OSError:
        raise WarpcamError(f"{error.filename!r} cannot be made ({error.strerror}); {SETTINGS}") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    wp.config.kernel_cache_dir = folder
    print(
        f"warpcam: {error.filename!r} cannot be made ({error.strerror}): kernels are compiled anew each time; "
        "set WARP_CACHE_PATH to a folder for them",
        file=sys.stderr,
    )
    init_quietly()


@contextmanager
def unwritable_folders_named() -> Iterator[None]:
    """Have an error name the variables to set where kernels cannot be written.

    Raises:
        WarpcamError: the folder of kernels or of temporary files cannot be written.
    """
    try:
        yield
    except OSError as error:
        if not _is_of_kernels(error):
            raise
        raise WarpcamError(f"{error.filename or 'a temporary folder'}: {error.strerror}; {SETTINGS}") from None


def _is_of_kernels(error: OSError) -> bool:
    if error.filename is None:
        return "temporary directory" in str(error.strerror)
    folder = str(wp.config.kernel_cache_dir or "")
    return bool(folder) and str(error.filename).startswith(folder)


@contextmanager
def _without_line(start: bytes) -> Iterator[None]:
    """Leave out one line of what native code writes to the standard error, which is little."""
    try:
        kept = os.dup(2)
    except OSError:  # closed
        yield
        return
    sys.stderr.flush()
    read, write = os.pipe()
    os.dup2(write, 2)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(write)
        with os.fdopen(read, "rb") as pipe:
            lines = pipe.read().splitlines(keepends=True)
        os.write(2, b"".join(line for line in lines if not line.startswith(start)))
        os.close(kept)
