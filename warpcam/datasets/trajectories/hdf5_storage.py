"""How HDF5 files are stored: compression, and errors of the disk."""

import errno
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError

WHOLE_ROWS = 4096  # rows with more bytes are compressed each by itself, so that a loader reads no others [bytes]
LEVELS = range(10)  # of gzip
MARGIN = 1 << 16  # of a file beside the parts that it is made of [bytes]


def check_compression(whose: str, level: int | None) -> None:
    if level is not None and (isinstance(level, bool) or level not in LEVELS):
        raise WarpcamError(f"{whose}: compression {level!r} came, 0 to 9 is allowed, or None")


def compressed(array: np.ndarray, level: int | None) -> dict[str, Any]:
    """Return the options of a dataset of rows."""
    if level is None:
        return {}
    options: dict[str, Any] = {"compression": "gzip", "compression_opts": level}
    if array[:1].nbytes > WHOLE_ROWS:
        options["chunks"] = (1, *array.shape[1:])
    return options


def require_room(path: Path, parts: Sequence[Path]) -> None:
    """Raise if the disk has no room for a file made of these parts.

    A file that HDF5 cannot write to its end stays open in the library, which may then crash; so it is told before.
    """
    size = MARGIN + sum(part.stat().st_size for part in parts)
    with path.open("wb") as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
        elif shutil.disk_usage(path.parent).free < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    path.unlink()


def as_os_error(error: RuntimeError) -> OSError:
    """Return what the system told HDF5, which raises errors of its own."""
    number = re.search(r"errno = (\d+)", str(error))
    return OSError(int(number[1]), os.strerror(int(number[1]))) if number else OSError(str(error))
