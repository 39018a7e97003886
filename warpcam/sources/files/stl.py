"""STL files whose length is not the one that their header says."""

import re
from pathlib import Path

from warpcam.core.errors import WarpcamError
from warpcam.sources.common.warnings import WarningCollector

HEADER, TRIANGLE = 84, 50  # bytes
TEXT = re.compile(rb"\s*solid\b[^\0]{0,4096}?\b(facet|endsolid)\b", re.DOTALL)


def triangles_of(path: Path, collector: WarningCollector) -> bytes:
    """Return a file's bytes, without those that follow on its last triangle."""
    data = path.read_bytes()
    if TEXT.match(data):
        return data
    if len(data) < HEADER:
        raise WarpcamError(f"{path}: is no STL file: it has {len(data)} bytes, and a header alone has {HEADER}")
    count = int.from_bytes(data[80:84], "little")
    end = HEADER + TRIANGLE * count
    if end > len(data):
        raise WarpcamError(
            f"{path}: is cut off: its header says {count} triangles, and there are bytes for "
            f"{(len(data) - HEADER) // TRIANGLE}"
        )
    if end < len(data):
        collector.warn(f"has {len(data) - end} bytes behind its last triangle, which are not read")
    return data[:end]
