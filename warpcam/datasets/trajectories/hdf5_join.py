"""Files of demonstrations that are made of their finished episodes."""

import errno
import os
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py

MARGIN = 1 << 16  # of a file beside the parts that it is made of [bytes]


def join(path: Path, parts: Sequence[Path], complete: Callable[[Any], None], before: Path | None = None) -> None:
    """Make a file with the demonstrations of all parts, and count their rows in ``total`` of ``data``.

    Args:
        path: Of the file.
        parts: Files with demonstrations in ``data``.
        complete: Takes the open file, to add what it has beside demonstrations; it leaves ``total`` as it is.
        before: File that the demonstrations are added to a copy of; None is an empty one.

    Raises:
        OSError: The disk refuses.
    """
    _require_room(path, parts if before is None else [before, *parts])
    if before is not None:
        shutil.copyfile(before, path)
    try:
        with h5py.File(path, "a") as file:
            data = file.require_group("data")
            total = int(data.attrs.get("total", 0))
            for part in parts:
                with h5py.File(part, "r") as source:
                    for name, group in source["data"].items():
                        source.copy(group, data, name=name)
                        total += int(group.attrs["num_samples"])
            data.attrs["total"] = total
            complete(file)
    except RuntimeError as error:  # HDF5's, also where the system refuses
        raise as_os_error(error) from error


def _require_room(path: Path, parts: Sequence[Path]) -> None:
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
