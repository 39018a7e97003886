"""Calls about states: as tensors of all environments, and as arrays of one actor."""

import math
from typing import Any

import numpy as np

from warpcam.compat.common.scalars import real
from warpcam.compat.isaacgym.api.enums import BODY_STATE, DOF_STATE, STATE_ALL, STATE_POS, STATE_VEL
from warpcam.compat.isaacgym.api.math_types import Transform
from warpcam.compat.isaacgym.api.tensors import Tensor, unwrap
from warpcam.compat.isaacgym.physics.environments import Actor, Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError


class StateCalls:
    """See ``Gym``."""

    def acquire_actor_root_state_tensor(self, sim: Sim) -> Tensor:
        """(actor, 13) float32: position, quaternion x y z w, velocities, in its environment's frame."""
        return sim_of(sim, "acquire_actor_root_state_tensor").physics.tensor("roots")

    def acquire_rigid_body_state_tensor(self, sim: Sim) -> Tensor:
        """(body, 13) float32, as those of actors."""
        return sim_of(sim, "acquire_rigid_body_state_tensor").physics.tensor("bodies")

    def acquire_dof_state_tensor(self, sim: Sim) -> Tensor:
        """(dof, 2) float32: position and velocity."""
        return sim_of(sim, "acquire_dof_state_tensor").physics.tensor("dofs")

    def refresh_actor_root_state_tensor(self, sim: Sim) -> bool:
        return _refresh(sim, "refresh_actor_root_state_tensor", "roots")

    def refresh_rigid_body_state_tensor(self, sim: Sim) -> bool:
        return _refresh(sim, "refresh_rigid_body_state_tensor", "bodies")

    def refresh_dof_state_tensor(self, sim: Sim) -> bool:
        return _refresh(sim, "refresh_dof_state_tensor", "dofs")

    def set_actor_root_state_tensor(self, sim: Sim, states: Tensor) -> bool:
        """Place all actors: the next render shows it."""
        sim_of(sim, "set_actor_root_state_tensor").physics.set_roots(states, None, None, "set_actor_root_state_tensor")
        return True

    def set_actor_root_state_tensor_indexed(self, sim: Sim, states: Tensor, indices: Tensor, count: int) -> bool:
        """Place those whose indices, int32, are given."""
        where = "set_actor_root_state_tensor_indexed"
        sim_of(sim, where).physics.set_roots(states, _indices(indices, where), count, where)
        return True

    def set_dof_state_tensor(self, sim: Sim, states: Tensor) -> bool:
        """Place all joints: the next render shows it."""
        sim_of(sim, "set_dof_state_tensor").physics.set_dofs(states, None, None, "set_dof_state_tensor")
        return True

    def set_dof_state_tensor_indexed(self, sim: Sim, states: Tensor, indices: Tensor, count: int) -> bool:
        """Place the joints of those actors whose indices, int32, are given."""
        where = "set_dof_state_tensor_indexed"
        sim_of(sim, where).physics.set_dofs(states, _indices(indices, where), count, where)
        return True

    def set_dof_position_target_tensor(self, sim: Sim, values: Tensor) -> bool:
        return _targets(sim, "positions", values, None, None, "set_dof_position_target_tensor")

    def set_dof_velocity_target_tensor(self, sim: Sim, values: Tensor) -> bool:
        return _targets(sim, "velocities", values, None, None, "set_dof_velocity_target_tensor")

    def set_dof_actuation_force_tensor(self, sim: Sim, values: Tensor) -> bool:
        return _targets(sim, "forces", values, None, None, "set_dof_actuation_force_tensor")

    def set_dof_position_target_tensor_indexed(self, sim: Sim, values: Tensor, indices: Tensor, count: int) -> bool:
        return _targets(sim, "positions", values, indices, count, "set_dof_position_target_tensor_indexed")

    def set_dof_velocity_target_tensor_indexed(self, sim: Sim, values: Tensor, indices: Tensor, count: int) -> bool:
        return _targets(sim, "velocities", values, indices, count, "set_dof_velocity_target_tensor_indexed")

    def set_dof_actuation_force_tensor_indexed(self, sim: Sim, values: Tensor, indices: Tensor, count: int) -> bool:
        return _targets(sim, "forces", values, indices, count, "set_dof_actuation_force_tensor_indexed")

    def set_actor_dof_position_targets(self, env: Env, actor: int, values: np.ndarray) -> bool:
        """Set the position targets of one actor's joints, (dof,)."""
        return _told(env, actor, "positions", values, "set_actor_dof_position_targets")

    def set_actor_dof_velocity_targets(self, env: Env, actor: int, values: np.ndarray) -> bool:
        """Set the velocity targets of one actor's joints, (dof,)."""
        return _told(env, actor, "velocities", values, "set_actor_dof_velocity_targets")

    def apply_actor_dof_efforts(self, env: Env, actor: int, values: np.ndarray) -> bool:
        """Forces along the joints of one actor, (dof,), from the next step on."""
        return _told(env, actor, "forces", values, "apply_actor_dof_efforts")

    def set_dof_target_position(self, env: Env, dof: int, value: float) -> None:
        """Set the position target of one joint; its handle counts those of the environment."""
        _told_one(env, dof, "positions", value, "set_dof_target_position")

    def set_dof_target_velocity(self, env: Env, dof: int, value: float) -> None:
        _told_one(env, dof, "velocities", value, "set_dof_target_velocity")

    def apply_dof_effort(self, env: Env, dof: int, value: float) -> None:
        _told_one(env, dof, "forces", value, "apply_dof_effort")

    def get_actor_rigid_body_states(self, env: Env, actor: int, flags: int = STATE_ALL) -> np.ndarray:
        """(body,) of ``RigidBodyState.dtype``; a copy."""
        found = env_of(env, "get_actor_rigid_body_states").actor(actor, "get_actor_rigid_body_states")
        rows = np.zeros(len(found.asset.bodies), BODY_STATE)
        numbers = rows.view(np.float32).reshape(len(rows), 13)
        numbers[:] = _states(found, "bodies") if env.sim.prepared else found.bodies()
        return _kept(numbers, flags, 7, rows)

    def get_env_rigid_body_states(self, env: Env, flags: int = STATE_ALL) -> np.ndarray:
        """(body,) of ``RigidBodyState.dtype``, of all that is in an environment; a copy."""
        env = env_of(env, "get_env_rigid_body_states")
        found = [self.get_actor_rigid_body_states(env, actor.handle, flags) for actor in env.actors]
        return np.concatenate([np.zeros(0, BODY_STATE), *found])

    def get_sim_rigid_body_states(self, sim: Sim, flags: int = STATE_ALL) -> np.ndarray:
        """(body,) of ``RigidBodyState.dtype``, of all environments; a copy."""
        physics = sim_of(sim, "get_sim_rigid_body_states").physics
        rows = np.zeros(physics.total.bodies, BODY_STATE)
        numbers = rows.view(np.float32).reshape(len(rows), 13)
        tensor = physics.tensor("bodies")
        physics.refresh("bodies")
        numbers[:] = torch_interop.to_numpy(tensor.torch)
        return _kept(numbers, flags, 7, rows)

    def get_rigid_transform(self, env: Env, body: int) -> Transform:
        """Return the present pose of the body of that handle, in its environment's frame."""
        env = env_of(env, "get_rigid_transform")
        return env.place(env.body(body, "get_rigid_transform"))

    def get_actor_dof_states(self, env: Env, actor: int, flags: int = STATE_ALL) -> np.ndarray:
        """(dof,) of ``DofState.dtype``; a copy."""
        found = env_of(env, "get_actor_dof_states").actor(actor, "get_actor_dof_states")
        rows = found.states.copy()
        numbers = rows.view(np.float32).reshape(len(rows), 2)
        if env.sim.prepared:
            numbers[:] = _states(found, "dofs")
        return _kept(numbers, flags, 1, rows)

    def set_actor_dof_states(self, env: Env, actor: int, states: np.ndarray, flags: int = STATE_ALL) -> bool:
        """Place the joints of one actor: positions, velocities or both, as ``flags`` say."""
        found = env_of(env, "set_actor_dof_states").actor(actor, "set_actor_dof_states")
        count = len(found.asset.dofs)
        if getattr(states, "dtype", None) != DOF_STATE or states.shape != (count,):
            raise WarpcamError(f"set_actor_dof_states: {count} of DofState.dtype are needed, got {states!r}")
        columns = [column for column, flag in (("pos", STATE_POS), ("vel", STATE_VEL)) if flags & flag]
        if not env.sim.prepared:
            for column in columns:
                found.states[column] = states[column]
            return True
        physics = env.sim.physics
        rows = self.get_actor_dof_states(env, actor)
        for column in columns:
            rows[column] = states[column]
        first, values = physics.start_of(found).dofs, physics.tensor("dofs").torch.clone()
        values[first : first + count] = torch_interop.as_tensor(rows.view(np.float32).reshape(count, 2)).to(
            values.device
        )
        physics.set_dofs(unwrap(values), None, None, "set_actor_dof_states")
        return True


def _refresh(sim: Any, where: str, name: str) -> bool:
    sim_of(sim, where).physics.refresh(name)
    return True


def _targets(sim: Any, kind: str, values: Any, indices: Any, count: Any, where: str) -> bool:
    chosen = None if indices is None and count is None else _indices(indices, where)
    sim_of(sim, where).physics.set_targets(kind, values, chosen, count, where)
    return True


def _indices(value: Any, where: str) -> Tensor:
    if not isinstance(value, Tensor):
        raise WarpcamError(f"{where}: indices must be gymtorch.unwrap_tensor(int32 tensor), got {type(value).__name__}")
    return value


def _told(env: Any, actor: Any, kind: str, values: Any, where: str) -> bool:
    found = env_of(env, where).actor(actor, where)
    count = len(found.asset.dofs)
    try:
        given = torch_interop.to_numpy(values)
    except (TypeError, ValueError, RuntimeError):  # rows of several lengths, tensors without memory
        given = np.zeros(())
    if given.shape != (count,) or given.dtype.kind not in "biuf":
        raise WarpcamError(f"{where}: {count} numbers are needed, got {values!r}")
    if not np.isfinite(given).all():
        raise WarpcamError(f"{where}: finite numbers are needed, got {values!r}")
    _tell(found, kind, given.astype(np.float32))
    return True


def _told_one(env: Any, dof: Any, kind: str, value: Any, where: str) -> None:
    env = env_of(env, where)
    place, number = handle_of(dof, env.counts.dofs), real(value)
    if place is None:
        raise WarpcamError(f"{where}: degree of freedom {dof!r} came, environment {env.index} has {env.counts.dofs}")
    if not math.isfinite(number):
        raise WarpcamError(f"{where}: a finite number is needed, got {value!r}")
    found = next(actor for actor in reversed(env.actors) if actor.before.dofs <= place)
    before = found.targets.get(kind)
    values = np.full(len(found.asset.dofs), np.nan, np.float32) if before is None else before.copy()
    values[place - found.before.dofs] = number
    _tell(found, kind, values)


def _tell(actor: Actor, kind: str, values: np.ndarray) -> None:
    if actor.env.sim.prepared:
        actor.env.sim.physics.tell(actor, kind, values)
    else:
        actor.targets[kind] = values


def _states(actor: Actor, name: str) -> np.ndarray:
    """Rows of an actor in the tensor of that name, as they are now."""
    physics = actor.env.sim.physics
    first, count = getattr(physics.start_of(actor), name), getattr(actor.counts, name)
    physics.tensor(name)
    physics.refresh(name)
    return torch_interop.to_numpy(physics.tensor(name).torch[first : first + count])


def _kept(numbers: np.ndarray, flags: int, positions: int, rows: np.ndarray) -> np.ndarray:
    """Without what is not asked for."""
    if not flags & STATE_POS:
        numbers[:, :positions] = 0.0
    if not flags & STATE_VEL:
        numbers[:, positions:] = 0.0
    return rows
