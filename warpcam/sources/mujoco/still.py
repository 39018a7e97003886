"""Worlds of one MuJoCo model that nobody simulates: posed on the host by one MjData, copied to the device once."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.scene.scene import Scene
from warpcam.sources.common.splats import Splats
from warpcam.sources.common.with_splats import with_splats
from warpcam.sources.mujoco.host import MujocoSource


class StillSource(MujocoSource):
    """Joint positions of each world.

    Attributes:
        positions: (world, nq) float32. What is written here is seen at the next ``render(forward=True)``.
    """

    def __init__(self, mjm: Any, mjd: Any, positions: np.ndarray, device: wp.Device):
        """Pose the worlds.

        Args:
            mjm: The ``mujoco.MjModel``.
            mjd: A ``mujoco.MjData`` of it; all but its joint positions is that of every world.
            positions: See above.
            device: Where they are rendered.
        """
        super().__init__(mjm, [mjd] * len(positions), (0, 1, 2), device)
        self.positions = positions
        self._mjd, self._stale = mjd, True

    def refresh(self) -> None:
        if self._stale:
            super().refresh()
            self._stale = False

    def forward(self) -> None:
        self._stale = True

    def _stage(self) -> None:
        """Pose one world after the other, and copy what was computed."""
        super()._stage()
        names = self._data_names.items()
        arrays = [(self._staged[field], getattr(self._mjd, name)) for field, name in names]
        for world, position in enumerate(self.positions):
            self._mjd.qpos = position
            self._pose(self._mjd)
            for staged, array in arrays:
                staged[world] = array.reshape(staged.shape[1:])

    def _pairs(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        yield from self._pairs_of(self._model_names, (self._mjm,))


def load(
    mjm: Any, mjd: Any, positions: np.ndarray, device: wp.Device, splats: Sequence[Splats] = ()
) -> tuple[Scene, StillSource]:
    """The scene of still worlds, with these splats, and its source."""
    source = StillSource(mjm, mjd, positions, device)
    return Scene(with_splats(source, splats)), source
