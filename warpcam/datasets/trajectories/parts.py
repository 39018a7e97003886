"""Finished episodes beside a dataset, each a file or folder of its own until the dataset is made of them.

A part gets its name only when all of it is on the disk, so that a crash, a full disk or a lost machine leaves the
episodes that were finished before.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from warpcam.core.errors import WarpcamError

SUFFIX = ".parts"
UNFINISHED = ".unfinished"


class Parts:
    """A folder ``{path}.parts`` with parts ``{number}``.

    Args:
        path: Of the dataset.
        suffix: Of each part's name.
    """

    def __init__(self, path: Path, suffix: str = ""):
        self.folder, self._path, self._suffix = path.with_name(path.name + SUFFIX), path, suffix
        with on_disk(f"{str(path)!r} cannot be made"):
            self.folder.mkdir(parents=True, exist_ok=True)
            probe = self.folder / UNFINISHED
            probe.write_bytes(b"")
            probe.unlink()
            for left in self.folder.glob(f"*{UNFINISHED}"):
                _remove(left)

    def all(self) -> list[tuple[int, Path]]:
        """Parts that are whole, by number."""
        pattern = re.compile(rf"(\d+){re.escape(self._suffix)}")
        found = ((pattern.fullmatch(path.name), path) for path in self.folder.iterdir())
        return sorted((int(match[1]), path) for match, path in found if match)

    def add(self, number: int, write: Callable[[Path], None]) -> Path:
        """Have ``write`` make a file or a folder, and give it the part's name when it is on the disk."""
        path = self.folder / f"{number:08d}{self._suffix}"
        replace(path, write, f"episode {number} could not be written to {str(self.folder)!r}")
        return path

    def remove(self) -> None:
        """Remove the folder, of which the dataset has been made."""
        shutil.rmtree(self.folder, ignore_errors=True)


def replace(path: Path, write: Callable[[Path], None], failure: str) -> None:
    """Have ``write`` make a file or folder beside ``path``, which takes its place when all of it is on the disk."""
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        with on_disk(failure):
            write(unfinished)
            for file in [unfinished, *unfinished.rglob("*")] if unfinished.is_dir() else [unfinished]:
                _sync(file)
            os.replace(unfinished, path)
            _sync(path.parent)
    finally:
        _remove(unfinished)


@contextmanager
def on_disk(failure: str) -> Iterator[None]:
    """Have what the system refuses within this context be raised as a ``WarpcamError`` that begins with ``failure``."""
    try:
        yield
    except OSError as error:
        raise WarpcamError(f"{failure}: {error.strerror or error}") from error


def write_bytes(content: bytes, path: Path) -> None:
    path.write_bytes(content)


def _sync(path: Path) -> None:
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
