"""Calls about forces, on bodies and along joints, and about jacobians and mass matrices."""

from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.assets import actor_of
from warpcam.compat.isaacgym.api.enums import CoordinateSpace, one_of
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.physics.environments import Env
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError


class ForceCalls:
    """See ``Gym``."""

    def enable_actor_dof_force_sensors(self, env: Env, actor: int) -> bool:
        """Nothing is to be done: forces are those of all actors."""
        actor_of(env, actor, "enable_actor_dof_force_sensors")
        return True

    def acquire_dof_force_tensor(self, sim: Sim) -> Tensor:
        """(dof,) float32: what drives and the program did along each in the last substep [N or N m]."""
        return sim_of(sim, "acquire_dof_force_tensor").physics.tensor("efforts")

    def refresh_dof_force_tensor(self, sim: Sim) -> bool:
        sim_of(sim, "refresh_dof_force_tensor").physics.refresh("efforts")
        return True

    def acquire_jacobian_tensor(self, sim: Sim, name: str) -> Tensor:
        """(actor, link, 6, dof) float32 of all actors of that name: velocities of links by those of joints.

        Linear ones, of centres of mass, above angular ones, along the world's axes. A base that is fixed is no link; of
        one that floats, its own linear and angular velocity are the first 6 of 6 + dof columns.
        """
        return sim_of(sim, "acquire_jacobian_tensor").physics.tensor("jacobians", name)

    def refresh_jacobian_tensors(self, sim: Sim) -> bool:
        """With bodies as they are now."""
        sim_of(sim, "refresh_jacobian_tensors").physics.refresh("jacobians")
        return True

    def acquire_mass_matrix_tensor(self, sim: Sim, name: str) -> Tensor:
        """(actor, dof, dof) float32 of all actors of that name, rows and columns as a jacobian's columns."""
        return sim_of(sim, "acquire_mass_matrix_tensor").physics.tensor("masses", name)

    def refresh_mass_matrix_tensors(self, sim: Sim) -> bool:
        """With bodies as they are now."""
        sim_of(sim, "refresh_mass_matrix_tensors").physics.refresh("masses")
        return True

    def get_actor_dof_forces(self, env: Env, actor: int) -> np.ndarray:
        """(dof,) float32 of one actor; a copy."""
        found = actor_of(env, actor, "get_actor_dof_forces")
        if not env.sim.prepared:
            return np.zeros(len(found.asset.dofs), np.float32)
        physics = env.sim.physics
        first, values = physics.start_of(found).dofs, physics.tensor("efforts").torch
        physics.refresh("efforts")
        return np.array(torch_interop.to_numpy(values[first : first + len(found.asset.dofs)]))

    def get_rigid_contacts(self, sim: Sim) -> np.ndarray:
        """(contact,) of ``RigidContact.dtype``, of all environments, in the last substep; a copy."""
        return sim_of(sim, "get_rigid_contacts").physics.contacts("get_rigid_contacts").copy()

    def get_env_rigid_contacts(self, env: Env) -> np.ndarray:
        """(contact,) of ``RigidContact.dtype``, of one environment, in the last substep; a copy."""
        env = env_of(env, "get_env_rigid_contacts")
        rows = env.sim.physics.contacts("get_env_rigid_contacts")
        return rows[(rows["env0"] == env.index) | (rows["env1"] == env.index)]

    def apply_rigid_body_force_tensors(
        self,
        sim: Sim,
        forceTensor: Tensor | None = None,  # noqa: N803, that system's names
        torqueTensor: Tensor | None = None,  # noqa: N803
        space: CoordinateSpace = CoordinateSpace.ENV_SPACE,
    ) -> bool:
        """Forces at the centres of mass of all bodies, and torques, (body, 3) float32, in the next step [N, N m]."""
        _push(sim, space, "apply_rigid_body_force_tensors", forces=forceTensor, torques=torqueTensor)
        return True

    def apply_rigid_body_force_at_pos_tensors(
        self,
        sim: Sim,
        forceTensor: Tensor,  # noqa: N803
        posTensor: Tensor | None = None,  # noqa: N803
        space: CoordinateSpace = CoordinateSpace.ENV_SPACE,
    ) -> bool:
        """Forces on all bodies at these places, (body, 3) float32, or at their centres of mass [N, m]."""
        _push(sim, space, "apply_rigid_body_force_at_pos_tensors", forces=forceTensor, places=posTensor)
        return True

    def apply_body_forces(
        self,
        env: Env,
        rigidHandle: int,  # noqa: N803
        force: Vec3 | None = None,
        torque: Vec3 | None = None,
        space: CoordinateSpace = CoordinateSpace.ENV_SPACE,
    ) -> None:
        """Apply the forces to one body."""
        _push_one(env, rigidHandle, space, "apply_body_forces", forces=force, torques=torque)

    def apply_body_force_at_pos(
        self,
        env: Env,
        rigidHandle: int,  # noqa: N803
        force: Vec3,
        pos: Vec3 | None = None,
        space: CoordinateSpace = CoordinateSpace.ENV_SPACE,
    ) -> None:
        """Apply the force to one body."""
        _push_one(env, rigidHandle, space, "apply_body_force_at_pos", forces=force, places=pos)


def _push(sim: Any, space: Any, where: str, **given: Any) -> None:
    kind = one_of(CoordinateSpace, space, f"{where}: space")
    sim_of(sim, where).physics.push(kind, where, **given)


def _push_one(env: Any, body: Any, space: Any, where: str, **given: Any) -> None:
    env, kind = env_of(env, where), one_of(CoordinateSpace, space, f"{where}: space")
    place = env.body(body, where)
    for value in given.values():
        if value is not None and not isinstance(value, Vec3):
            raise WarpcamError(f"{where}: vectors must be Vec3, got {value!r}")
    physics = env.sim.physics  # from here on it is known what is before the environment
    physics.push_one(kind, env.start.bodies + place, **given)
