"""A Warp allocator that counts."""

from typing import Any


class Ledger:
    """Stands in for a Warp allocator and counts the bytes that are held."""

    def __init__(self, allocator: Any):
        self._allocator = allocator
        self.held = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._allocator, name)

    def allocate(self, size: int) -> int:
        self.held += size
        return int(self._allocator.allocate(size))

    def deallocate(self, pointer: int, size: int) -> None:
        self.held -= size
        self._allocator.deallocate(pointer, size)
