"""STL files: those whose length is not the one that their header says, and colours of faces."""

import re
from pathlib import Path

import numpy as np

from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.warnings import WarningCollector

HEADER, TRIANGLE = 84, 50  # bytes
COLOR = b"COLOR="
TEXT = re.compile(rb"\s*solid\b[^\0]{0,4096}?\b(facet|endsolid)\b", re.DOTALL)


def triangles_of(path: Path, access: FileAccess, collector: WarningCollector) -> bytes:
    """Return a file's bytes, without those that follow on its last triangle."""
    data = access.read(path)
    if TEXT.match(data):
        return data
    if len(data) < HEADER:
        raise WarpcamError(f"{path}: is no STL file: it has {len(data)} bytes, and a header alone has {HEADER}")
    count = int.from_bytes(data[80:84], "little")
    access.check("elements", count, f"{path}: its header says of triangles that it")
    end = HEADER + TRIANGLE * count
    if end > len(data):
        raise WarpcamError(
            f"{path}: is cut off: its header says {count} triangles, and there are bytes for "
            f"{(len(data) - HEADER) // TRIANGLE}"
        )
    if end < len(data):
        collector.warn(f"has {len(data) - end} bytes behind its last triangle, which are not read")
    return data[:end]


def colors_of(data: bytes) -> np.ndarray | None:
    """Colours of faces, (face, 3) uint8, as programs write them into the two spare bytes of each; None if none do.

    Materialise's Magics has red in the lowest bits, a bit that says that the whole's colour counts, and that in the
    header. VisCAM and others have blue in the lowest bits, and the bit says that the colour is one.
    """
    if TEXT.match(data) or len(data) <= HEADER:
        return None
    rows = np.frombuffer(data, np.dtype([("corners", "<f4", 12), ("spare", "<u2")]), offset=HEADER)
    spare = rows["spare"][:, None]
    marked = spare >> 15 == 1
    levels = np.rint(((spare >> np.array((0, 5, 10), np.uint16)) & 31) * (255.0 / 31.0)).astype(np.uint8)
    at = data[:80].find(COLOR)
    if 0 <= at <= 80 - len(COLOR) - 4:
        whole = np.frombuffer(data, np.uint8, 3, at + len(COLOR))
        return np.where(marked, whole, levels)
    return levels[:, ::-1] if marked.all() else None
