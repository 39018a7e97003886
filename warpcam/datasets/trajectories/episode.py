"""Episodes: what the rows of one world between two ends of episodes are, and buffers in which they grow."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

FIRST_CAPACITY = 64  # rows of a buffer at its beginning
GROWTH = 1.5


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode of one world.

    Attributes:
        columns: By name, each (step, ...): ``observations/{key}``, ``actions``, and so on.
        success: Of its last step; None if nobody told.
        task: What the world's robot was told to do.
    """

    columns: dict[str, np.ndarray]
    success: bool | None = None
    task: str = ""

    def __len__(self) -> int:
        return len(self.columns["actions"])

    def part(self, name: str) -> dict[str, np.ndarray]:
        """Columns below ``name``, by the rest of their names; of a column itself by the empty name."""
        found = {key[len(name) + 1 :]: array for key, array in self.columns.items() if key.startswith(f"{name}/")}
        return {"": self.columns[name]} if name in self.columns else found


class Buffers:
    """Rows of the episodes that run, (world, step, ...) for each column."""

    def __init__(self) -> None:
        self._buffers: dict[str, np.ndarray] = {}
        self._lengths = np.zeros(0, np.int64)

    def append(self, rows: Mapping[str, np.ndarray], worlds: np.ndarray) -> None:
        """Append a row to the episodes of these worlds.

        Args:
            rows: (world, ...) by name, of all worlds.
            worlds: (n,) ids.
        """
        if not self._buffers:
            self._lengths = np.zeros(len(next(iter(rows.values()))), np.int64)
            for name, row in rows.items():
                self._buffers[name] = np.empty((len(row), FIRST_CAPACITY, *row.shape[1:]), row.dtype)
        places = self._lengths[worlds]
        for name, row in rows.items():
            buffer = self._buffers[name]
            if places.size and places.max() >= buffer.shape[1]:
                larger = np.empty((len(buffer), int(buffer.shape[1] * GROWTH), *buffer.shape[2:]), buffer.dtype)
                larger[:, : buffer.shape[1]] = buffer
                buffer = self._buffers[name] = larger
            buffer[worlds, places] = row[worlds]
        self._lengths[worlds] += 1

    def running(self) -> np.ndarray:
        """Ids of worlds whose episodes have rows."""
        return np.flatnonzero(self._lengths)

    def taken(self, worlds: np.ndarray) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """Yield each world with the columns of its episode, and begin another. The columns are views."""
        for world in worlds.tolist():
            length, self._lengths[world] = int(self._lengths[world]), 0
            yield world, {name: buffer[world, :length] for name, buffer in self._buffers.items()}
