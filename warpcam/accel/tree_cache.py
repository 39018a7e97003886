"""The folder of cached trees: where it is, how large it may be, and what goes first.

``WARPCAM_CACHE_DIR`` names the folder, else it is ``$XDG_CACHE_HOME/warpcam`` or ``~/.cache/warpcam``.
``WARPCAM_CACHE_SIZE`` limits it. Files that were not used for longest go first. Several processes may share the folder:
a file that another one has removed is built again.
"""

import os
import re
from pathlib import Path

from warpcam.core.errors import WarpcamError

TREES = "bvh4"  # the folder's own folder of trees
USUAL = 2 * 2**30  # bytes
UNITS = {"": 1, "B": 1} | {
    f"{letter}{kind}": base ** (power + 1)
    for power, letter in enumerate("KMGT")
    for kind, base in (("B", 1000), ("IB", 1024))
}


def folder() -> Path | None:
    """Return the folder, or None for no cache."""
    own = os.environ.get("WARPCAM_CACHE_DIR")
    if own:
        return Path(own)
    shared = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(shared):  # the XDG specification has relative ones ignored
        return Path(shared) / "warpcam"
    try:
        return Path.home() / ".cache" / "warpcam"
    except RuntimeError:
        return None


def limit() -> int:
    """Return how large the folder may be [bytes]; 0: nothing is kept.

    Raises:
        WarpcamError: ``WARPCAM_CACHE_SIZE`` is no size.
    """
    text = os.environ.get("WARPCAM_CACHE_SIZE", "").strip()
    if not text:
        return USUAL
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([A-Za-z]*)", text)
    if found is None or found[2].upper() not in UNITS:
        raise WarpcamError(
            f"WARPCAM_CACHE_SIZE: {text!r} came; allowed are sizes like 500MB, 2GiB or 1000000, and 0 for none"
        )
    return int(float(found[1]) * UNITS[found[2].upper()])


def touch(path: Path) -> None:
    """Note that a file was used."""
    try:
        os.utime(path)
    except OSError:  # of another user, or gone
        pass


def size(where: Path) -> int:
    """Return the size of all trees in the folder [bytes]."""
    return sum(count for _, count, _ in _files(where))


def trim(where: Path, most: int | None = None) -> int:
    """Remove the files that were not used for longest until the rest fits the limit; return the bytes removed."""
    most = limit() if most is None else most
    files = sorted(_files(where))
    kept, removed = sum(count for _, count, _ in files), 0
    for _, count, path in files:
        if kept <= most:
            break
        try:
            os.unlink(path)
        except FileNotFoundError:  # another process was faster
            pass
        except OSError:
            continue
        kept, removed = kept - count, removed + count
    return removed


def _files(where: Path) -> list[tuple[int, int, str]]:
    """Time of the last use [ns], size [bytes] and path of each tree."""
    found = []
    try:
        with os.scandir(where / TREES) as entries:
            for entry in entries:
                try:
                    if entry.is_file(follow_symlinks=False):
                        status = entry.stat(follow_symlinks=False)
                        found.append((status.st_mtime_ns, status.st_size, entry.path))
                except OSError:
                    continue
    except OSError:
        return []
    return found
