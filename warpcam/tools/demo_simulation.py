"""A few worlds of one MJCF file that classic MuJoCo simulates, for the viewer: nothing to compile, on any machine."""

from pathlib import Path
from typing import Any

from warpcam.core.file_access import FileAccess
from warpcam.sources.mujoco import batch_file


class Simulation:
    """Worlds of a file, the first as the file has it, the others with their joints at random.

    Attributes:
        host: The ``mujoco.MjModel``.
        states: A ``mujoco.MjData`` for each world.
    """

    def __init__(self, path: Path, num_worlds: int, seed: int, access: FileAccess | None = None):
        """Read the file.

        Args:
            path: An .xml, .mjb or .urdf file.
            num_worlds: How many worlds.
            seed: Of the random joint positions.
            access: What the file may open; None is as ``warpcam.load`` has it.
        """
        import mujoco

        self.host, first = batch_file.read(path, access=access)
        self.states = [first, *(mujoco.MjData(self.host) for _ in range(num_worlds - 1))]
        self._starts = batch_file.joint_positions(self.host, first.qpos, num_worlds=num_worlds, seed=seed)
        self._left = 0.0  # of the time to be simulated, less than a step [s]
        self._restart()
        self._asked, self._runs = False, True

    def add_controls(self, gui: Any) -> None:
        """Add what stops it, and what has it begin anew, to a page of viser."""

        def ask(_: Any) -> None:
            self._asked = True

        def switch(event: Any) -> None:
            self._runs = bool(event.target.value)

        gui.add_checkbox("Simulate", initial_value=True).on_update(switch)
        gui.add_button("Restart").on_click(ask)

    def advance(self, seconds: float) -> bool:
        """Simulate so much time, as near as whole steps come to it, as the controls say; whether anything has moved."""
        import mujoco

        moved = self._asked
        if self._asked:
            self._asked = False
            self._restart()
        if not self._runs:
            return moved
        steps, self._left = divmod(self._left + seconds, float(self.host.opt.timestep))
        for state in self.states:
            mujoco.mj_step(self.host, state, nstep=int(steps))
        return moved or steps > 0

    def _restart(self) -> None:
        import mujoco

        for state, start in zip(self.states, self._starts, strict=True):
            batch_file.restart(self.host, state)
            state.qpos[:] = start
            mujoco.mj_forward(self.host, state)
