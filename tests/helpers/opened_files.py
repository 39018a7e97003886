"""What is opened: files, by whatever library, as the system's kernel tells it, and what Python's audit events tell."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

OPENED, HEAD = 0x20, 16  # IN_OPEN; bytes of an event before its name


@contextmanager
def opened_files(folder: Path) -> Iterator[set[str]]:
    """Names of a folder's files that are opened; the set is filled when the context ends. Linux alone."""
    assert sys.platform == "linux"
    libc = ctypes.CDLL(None, use_errno=True)
    watch, found = libc.inotify_init1(os.O_NONBLOCK), set[str]()
    assert watch >= 0 and libc.inotify_add_watch(watch, os.fsencode(folder), OPENED) >= 0
    try:
        yield found
        try:
            data = os.read(watch, 1 << 16)
        except BlockingIOError:
            data = b""
        while data:
            end = HEAD + int.from_bytes(data[12:16], sys.byteorder)
            found.add(os.fsdecode(data[HEAD:end].rstrip(b"\0")))
            data = data[end:]
    finally:
        os.close(watch)
    found.discard("")  # the folder itself


_wanted: tuple[str, ...] = ()
_heard: list[str] = []


def _hear(event: str, _: object) -> None:
    if _wanted and event.startswith(_wanted):
        _heard.append(event)


@contextmanager
def events(prefixes: tuple[str, ...]) -> Iterator[list[str]]:
    """Names of Python's audit events that begin so."""
    global _wanted, _installed
    if not _installed:  # none is ever taken away
        sys.addaudithook(_hear)
        _installed = True
    _heard.clear()
    _wanted = prefixes
    try:
        yield _heard
    finally:
        _wanted = ()


_installed = False
