"""Forces of contacts, of bodies and at force sensors, as the solver has found them last."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpcam.compat.isaacgym.api.math_types import Transform
from warpcam.compat.isaacgym.kernels import forces as kernels
from warpcam.compat.isaacgym.kernels.state import launch
from warpcam.core.errors import WarpcamError


class ContactForces:
    """What contacts do to the bodies of a model.

    Attributes:
        felt: (body, 6) float32, force [N] and its moment about the origin [N m] in the frame of each body's world.
    """

    def __init__(self, model: Any):
        self.device, self._shape_bodies = model.device, model.shape_body
        self.felt = wp.zeros((model.body_count, 6), dtype=wp.float32, device=self.device)
        self._solver: Any = None

    def read(self, solver: Any, where: str) -> None:
        """Have those of the last step; before the first there are none.

        Args:
            solver: Newton's, or None before the first step.
            where: The call.
        """
        self.felt.zero_()
        if solver is None:
            return
        if not hasattr(solver, "mjc_geom_to_newton_shape"):
            raise WarpcamError(f"{where}: MuJoCo cannot simulate this, and XPBD does not tell forces of contacts")
        if solver.use_mujoco_cpu:
            self._read_on_host(solver)
        else:
            self._read(solver)

    def write(self, bodies: wp.array, forces: wp.array) -> None:
        """Write what each of these bodies feels, (body, 3)."""
        launch(kernels.read_forces, forces.shape, [self.felt, bodies, forces], self.device)

    def _read(self, solver: Any) -> None:
        import mujoco_warp

        model, data = solver.mjw_model, solver.mjw_data
        if solver is not self._solver:
            self._solver = solver
            self._ids = wp.array(np.arange(data.naconmax, dtype=np.int32), dtype=wp.int32, device=self.device)
            self._forces = wp.zeros(data.naconmax, dtype=wp.spatial_vector, device=self.device)
        with wp.ScopedDevice(self.device):  # it launches on the current one
            mujoco_warp.contact_force(model, data, self._ids, True, self._forces)
        contact = data.contact
        shapes = [solver.mjc_geom_to_newton_shape, self._shape_bodies]
        inputs = [data.nacon, contact.geom, contact.worldid, contact.pos, self._forces, *shapes, self.felt]
        launch(kernels.add_contacts, data.naconmax, inputs, self.device)

    def _read_on_host(self, solver: Any) -> None:
        import mujoco

        model, data = solver.mj_model, solver.mj_data
        shapes, bodies = solver.mjc_geom_to_newton_shape.numpy()[0], self._shape_bodies.numpy()
        felt, force = self.felt.numpy(), np.zeros(6)
        for index in range(data.ncon):
            contact = data.contact[index]
            mujoco.mj_contactForce(model, data, index, force)
            given = contact.frame.reshape(3, 3).T @ force[:3]
            row = np.concatenate((given, np.cross(contact.pos, given)))
            for geom, sign in zip(contact.geom, (-1.0, 1.0), strict=True):
                body = bodies[shapes[geom]] if geom >= 0 else -1
                if body >= 0:
                    felt[body] += (sign * row).astype(np.float32)


class Sensors:
    """Force sensors of all actors.

    Args:
        rows: For each the body, its pose in the body's frame, whether contacts are felt, and along the world's axes.
        device: Of the simulation.
    """

    def __init__(self, rows: Sequence[tuple[int, Transform, bool, bool]], device: wp.Device):
        bodies = [body if feels else -1 for body, _, feels, _ in rows]
        places = [pose.numbers() for _, pose, *_ in rows]
        self._bodies = wp.array(np.array(bodies, np.int32), dtype=wp.int32, device=device)
        self._places = wp.array(np.array(places, np.float32).reshape(-1, 7), dtype=wp.transform, device=device)
        self._level = wp.array(np.array([level for *_, level in rows], np.int32), dtype=wp.int32, device=device)
        self._count, self._device = len(rows), device

    def read(self, felt: wp.array, poses: wp.array, out: wp.array) -> None:
        """Write what they feel, (sensor, 6): force and torque about the sensor."""
        inputs = [felt, poses, self._bodies, self._places, self._level, out]
        launch(kernels.read_sensors, self._count, inputs, self._device)
