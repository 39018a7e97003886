"""Calls that read states of several environments at once, one row for each environment."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.enums import STATE_ALL
from warpcam.compat.isaacgym.api.joints import JointCalls
from warpcam.compat.isaacgym.api.math_types import TRANSFORM, VEC3, Vec3
from warpcam.compat.isaacgym.physics.environments import Env
from warpcam.compat.isaacgym.physics.simulation import env_of
from warpcam.core.errors import WarpcamError

Handles = int | Sequence[int]


class EnvListCalls(JointCalls):
    """See ``Gym``. A handle is one for all environments, or a list with one for each."""

    def get_vec_actor_dof_states(self, envs: Sequence[Env], actors: Handles, flags: int = STATE_ALL) -> np.ndarray:
        """(environment, dof) of ``DofState.dtype``; a copy. The actors must have equally many dofs."""
        where = "get_vec_actor_dof_states"
        return _stacked([self.get_actor_dof_states(*pair, flags) for pair in _pairs(envs, actors, where)], where)

    def get_vec_env_rigid_contact_forces(self, envs: Sequence[Env]) -> np.ndarray:
        """(environment, body) of ``Vec3.dtype`` [N]; a copy. The environments must have equally many bodies."""
        where = "get_vec_env_rigid_contact_forces"
        return _stacked([self.get_env_rigid_contact_forces(env) for env, _ in _pairs(envs, 0, where)], where)

    def get_vec_rigid_transform(self, envs: Sequence[Env], bodies: Handles) -> np.ndarray:
        """(environment,) of ``Transform.dtype``, each in its environment's frame; a copy."""
        found = [self.get_rigid_transform(*pair) for pair in _pairs(envs, bodies, "get_vec_rigid_transform")]
        return np.array([(tuple(one.p), tuple(one.r)) for one in found], TRANSFORM)

    def get_vec_rigid_linear_velocity(self, envs: Sequence[Env], bodies: Handles) -> np.ndarray:
        """(environment,) of ``Vec3.dtype`` [m/s]; a copy."""
        return _vectors(self.get_rigid_linear_velocity, envs, bodies, "get_vec_rigid_linear_velocity")

    def get_vec_rigid_angular_velocity(self, envs: Sequence[Env], bodies: Handles) -> np.ndarray:
        """(environment,) of ``Vec3.dtype`` [rad/s]; a copy."""
        return _vectors(self.get_rigid_angular_velocity, envs, bodies, "get_vec_rigid_angular_velocity")


def _pairs(envs: Any, handles: Any, where: str) -> list[tuple[Env, Any]]:
    """Each environment with its handle."""
    if not isinstance(envs, Sequence) or not envs:
        raise WarpcamError(f"{where}: a list of environments is needed, got {envs!r}")
    found = [env_of(env, where) for env in envs]
    if not isinstance(handles, Sequence | np.ndarray):
        return [(env, handles) for env in found]
    if len(handles) != len(found):
        raise WarpcamError(
            f"{where}: a handle, or one for each of {len(found)} environments is needed, got {handles!r}"
        )
    return list(zip(found, handles, strict=True))


def _stacked(rows: Sequence[np.ndarray], where: str) -> np.ndarray:
    counts = [len(row) for row in rows]
    if len(set(counts)) > 1:
        raise WarpcamError(f"{where}: environments must have equally many, got {counts}; read them one by one")
    return np.stack(rows)


def _vectors(read: Callable[[Env, int], Vec3], envs: Any, bodies: Any, where: str) -> np.ndarray:
    return np.array([tuple(read(*pair)) for pair in _pairs(envs, bodies, where)], VEC3)
