"""Calls about forces along joints, and about jacobians and mass matrices."""

import numpy as np

from warpcam import interop
from warpcam.compat.isaacgym.calls_assets import actor_of
from warpcam.compat.isaacgym.sim import Sim, sim_of
from warpcam.compat.isaacgym.tensors import Tensor
from warpcam.compat.isaacgym.world import Env


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
        return np.array(interop.to_numpy(values[first : first + len(found.asset.dofs)]))
