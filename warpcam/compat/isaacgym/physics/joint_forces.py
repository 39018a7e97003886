"""Forces along joints, as the solver has found them last."""

from typing import Any

import numpy as np
import warp as wp

from warpcam.compat.isaacgym.kernels import forces as kernels
from warpcam.compat.isaacgym.kernels.state import launch
from warpcam.core.errors import WarpcamError


class JointForces:
    """What drives and programs do to the degrees of freedom of a model.

    Args:
        model: What is simulated.
        speeds: (dof,) places among the model's joint velocities.
    """

    def __init__(self, model: Any, speeds: np.ndarray):
        self._model, self._speeds = model, speeds
        self._solver: Any = None

    def bind(self, solver: Any) -> None:
        """Take those of this solver of Newton's from now on."""
        self._solver = solver
        if not hasattr(solver, "mj_qd_start"):
            return
        # Worlds are alike: places of the first one's joints are those of all.
        columns, starts = solver.mj_qd_start.numpy(), self._model.joint_qd_start.numpy()
        sizes = np.diff(starts[: len(columns) + 1])
        places = np.concatenate(
            [np.zeros(0, np.int64), *(at + np.arange(n) for at, n in zip(columns, sizes, strict=True))]
        )
        each = max(len(places), 1)
        self._worlds, self._places = self._speeds // each, places[self._speeds % each].astype(np.int64)
        device = self._model.device
        self._indices = [wp.array(rows.astype(np.int32), device=device) for rows in (self._worlds, self._places)]

    def read(self, out: wp.array) -> None:
        """Write them, (dof,); before the first step there are none."""
        solver = self._solver
        if solver is None:
            out.zero_()
        elif not hasattr(solver, "mj_qd_start"):
            raise WarpcamError("forces of joints: MuJoCo cannot simulate this, and XPBD does not tell them")
        elif solver.use_mujoco_cpu:
            data = solver.mj_data
            out.assign((data.qfrc_actuator + data.qfrc_applied)[self._places].astype(np.float32))
        else:
            data = solver.mjw_data
            inputs = [data.qfrc_actuator, data.qfrc_applied, *self._indices, out]
            launch(kernels.read_efforts, len(self._speeds), inputs, self._model.device)
