"""How HDF5 files are stored: compression."""

from typing import Any

import numpy as np

from warpcam.core.errors import WarpcamError

WHOLE_ROWS = 4096  # rows with more bytes are compressed each by itself, so that a loader reads no others [bytes]
LEVELS = range(10)  # of gzip


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
