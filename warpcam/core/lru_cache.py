"""Bounded cache of built structures, by content."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

Built = TypeVar("Built")


class LruCache(Generic[Built]):
    """The results used last, up to so many bytes of host memory. Several threads may share it.

    Args:
        max_bytes: Of all that is kept.
        size: Bytes of one result.
    """

    def __init__(self, max_bytes: int, size: Callable[[Built], int]):
        self._max_bytes, self._size = max_bytes, size
        self._results: OrderedDict[bytes, Built] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    def get(self, key: bytes, build: Callable[[], Built]) -> Built:
        """Return the value of that key, and build it if it is absent. Nobody may write to it."""
        result = self.find(key)
        if result is None:
            self.keep(key, result := build())
        return result

    def find(self, key: bytes) -> Built | None:
        """Return the value of that key, or None. Nobody may write to it."""
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
            return self._results.get(key)

    def keep(self, key: bytes, result: Built) -> None:
        """Have it found by that key, in place of what was, while there is room."""
        with self._lock:
            if key in self._results:  # another thread has built it meanwhile
                self._bytes -= self._size(self._results.pop(key))
            if self._size(result) <= self._max_bytes:
                self._results[key] = result
                self._bytes += self._size(result)
            while self._bytes > self._max_bytes:
                _, oldest = self._results.popitem(last=False)
                self._bytes -= self._size(oldest)


def key_of(*parts: np.ndarray | str | bool | int) -> bytes:
    """Hash content: equal content has equal keys."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).data)
        else:
            digest.update(f"{part!r};".encode())
    return digest.digest()
