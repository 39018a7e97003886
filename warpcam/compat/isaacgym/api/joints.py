"""Calls about joints and single degrees of freedom, by name and by handle."""

from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.assets import AssetCalls, actor_of, asset_of, one_at, place_of
from warpcam.compat.isaacgym.api.enums import INVALID_HANDLE, STATE_ALL, DofType, IndexDomain, JointType, one_of
from warpcam.compat.isaacgym.api.math_types import TRANSFORM, VEC3, DofFrame, Transform, Vec3
from warpcam.compat.isaacgym.api.states import StateCalls
from warpcam.compat.isaacgym.assets.asset import JOINT, Asset
from warpcam.compat.isaacgym.physics.environments import Actor, Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

KINDS = {JOINT.FIXED: JointType.JOINT_FIXED, JOINT.REVOLUTE: JointType.JOINT_REVOLUTE,
         JOINT.PRISMATIC: JointType.JOINT_PRISMATIC}  # fmt: skip


class JointCalls(AssetCalls, StateCalls):
    """See ``Gym``. Handles of joints and of degrees of freedom count those of their environment."""

    def get_asset_joint_name(self, asset: Asset, index: int) -> str:
        where = "get_asset_joint_name"
        return str(one_at(asset_of(asset, where).joints, index, where))

    def get_asset_joint_type(self, asset: Asset, index: int) -> JointType:
        where = "get_asset_joint_type"
        asset = asset_of(asset, where)
        one_at(asset.joints, index, where)
        return KINDS.get(asset.builder.joint_type[_in_builder(asset, index)], JointType.JOINT_INVALID)

    def find_asset_joint_index(self, asset: Asset, name: str) -> int:
        return self.get_asset_joint_dict(asset).get(name, INVALID_HANDLE)

    def get_joint_type_string(self, joint_type: JointType) -> str:
        """Return the joint's type, for example "Revolute"."""
        return _word(one_of(JointType, joint_type, "get_joint_type_string: type"))

    def get_dof_type_string(self, dof_type: DofType) -> str:
        """Return "Rotation" for a hinge, "Translation" for a slide."""
        return _word(one_of(DofType, dof_type, "get_dof_type_string: type"))

    def get_actor_joint_names(self, env: Env, actor: int) -> list[str]:
        return list(actor_of(env, actor, "get_actor_joint_names").asset.joints)

    def find_actor_joint_index(self, env: Env, actor: int, name: str, domain: IndexDomain) -> int:
        found = actor_of(env, actor, "find_actor_joint_index")
        index = self.find_asset_joint_index(found.asset, name)
        return index if index == INVALID_HANDLE else _joint_place(found, domain, index)

    def find_actor_joint_handle(self, env: Env, actor: int, name: str) -> int:
        return self.find_actor_joint_index(env, actor, name, IndexDomain.DOMAIN_ENV)

    def get_actor_joint_index(self, env: Env, actor: int, index: int, domain: IndexDomain) -> int:
        where = "get_actor_joint_index"
        found = actor_of(env, actor, where)
        one_at(found.asset.joints, index, where)
        return _joint_place(found, domain, int(index))

    def get_actor_joint_handle(self, env: Env, actor: int, index: int) -> int:
        return self.get_actor_joint_index(env, actor, index, IndexDomain.DOMAIN_ENV)

    def get_joint_handle(self, env: Env, actor: str, name: str) -> int:
        """Return the handle of the joint of that name of the actor of that name."""
        handle = self.find_actor_handle(env, actor)
        return handle if handle == INVALID_HANDLE else self.find_actor_joint_handle(env, handle, name)

    def get_joint_name(self, env: Env, joint: int) -> str:
        found, index = _joint(env, joint, "get_joint_name")
        return found.asset.joints[index]

    def get_joint_position(self, env: Env, joint: int) -> float:
        """Return the position of a joint of one degree of freedom, as the methods below do [m or rad]."""
        return self.get_dof_position(env, _dof_of(env, joint, "get_joint_position"))

    def get_joint_velocity(self, env: Env, joint: int) -> float:
        return self.get_dof_velocity(env, _dof_of(env, joint, "get_joint_velocity"))

    def get_joint_target_position(self, env: Env, joint: int) -> float:
        return self.get_dof_target_position(env, _dof_of(env, joint, "get_joint_target_position"))

    def get_joint_target_velocity(self, env: Env, joint: int) -> float:
        return self.get_dof_target_velocity(env, _dof_of(env, joint, "get_joint_target_velocity"))

    def set_joint_target_position(self, env: Env, joint: int, value: float) -> None:
        self.set_dof_target_position(env, _dof_of(env, joint, "set_joint_target_position"), value)

    def set_joint_target_velocity(self, env: Env, joint: int, value: float) -> None:
        self.set_dof_target_velocity(env, _dof_of(env, joint, "set_joint_target_velocity"), value)

    def get_joint_transform(self, env: Env, joint: int) -> Transform:
        """Return the present pose of a joint in its environment's frame, rotated as its child."""
        found, index = _joint(env, joint, "get_joint_transform")
        return _joint_pose(found, _in_builder(found.asset, index))

    def get_actor_joint_transforms(self, env: Env, actor: int) -> np.ndarray:
        """(joint,) of ``Transform.dtype``, as ``get_joint_transform`` has them."""
        found = actor_of(env, actor, "get_actor_joint_transforms")
        places = [_in_builder(found.asset, index) for index in range(len(found.asset.joints))]
        poses = [_joint_pose(found, place) for place in places]
        return np.array([(tuple(pose.p), tuple(pose.r)) for pose in poses], TRANSFORM)

    def get_actor_dof_index(self, env: Env, actor: int, index: int, domain: IndexDomain) -> int:
        where = "get_actor_dof_index"
        found = actor_of(env, actor, where)
        one_at(found.asset.dofs, index, where)
        return place_of(found, domain, "dofs", int(index))

    def get_actor_dof_handle(self, env: Env, actor: int, index: int) -> int:
        return self.get_actor_dof_index(env, actor, index, IndexDomain.DOMAIN_ENV)

    def get_dof_position(self, env: Env, dof: int) -> float:
        """[m or rad]."""
        found, index = _dof(env, dof, "get_dof_position")
        return float(self.get_actor_dof_states(env, found.handle, STATE_ALL)["pos"][index])

    def get_dof_velocity(self, env: Env, dof: int) -> float:
        found, index = _dof(env, dof, "get_dof_velocity")
        return float(self.get_actor_dof_states(env, found.handle, STATE_ALL)["vel"][index])

    def get_dof_target_position(self, env: Env, dof: int) -> float:
        found, index = _dof(env, dof, "get_dof_target_position")
        return float(_targets(found, "positions")[index])

    def get_dof_target_velocity(self, env: Env, dof: int) -> float:
        found, index = _dof(env, dof, "get_dof_target_velocity")
        return float(_targets(found, "velocities")[index])

    def get_actor_dof_position_targets(self, env: Env, actor: int) -> np.ndarray:
        """(dof,) float32, where the joints of one actor are driven to; a copy."""
        return _targets(actor_of(env, actor, "get_actor_dof_position_targets"), "positions")

    def get_actor_dof_velocity_targets(self, env: Env, actor: int) -> np.ndarray:
        """(dof,) float32, how fast the joints of one actor are driven; a copy."""
        return _targets(actor_of(env, actor, "get_actor_dof_velocity_targets"), "velocities")

    def get_dof_frame(self, env: Env, dof: int) -> DofFrame:
        """Return the present frame of a degree of freedom in its environment's frame."""
        return _frame(*_dof(env, dof, "get_dof_frame"))

    def get_actor_dof_frames(self, env: Env, actor: int) -> np.ndarray:
        """(dof,) of ``DofFrame.dtype``, likewise."""
        found = actor_of(env, actor, "get_actor_dof_frames")
        frames = [_frame(found, index) for index in range(len(found.asset.dofs))]
        return np.array([(tuple(frame.origin), tuple(frame.axis)) for frame in frames], DofFrame.dtype)

    def get_rigid_name(self, env: Env, body: int) -> str:
        found, index = _body(env, body, "get_rigid_name")
        return found.asset.bodies[index]

    def get_rigid_linear_velocity(self, env: Env, body: int) -> Vec3:
        found, index = _body(env, body, "get_rigid_linear_velocity")
        return Vec3.from_buffer(self.get_actor_rigid_body_states(env, found.handle)["vel"]["linear"][index])

    def get_rigid_angular_velocity(self, env: Env, body: int) -> Vec3:
        found, index = _body(env, body, "get_rigid_angular_velocity")
        return Vec3.from_buffer(self.get_actor_rigid_body_states(env, found.handle)["vel"]["angular"][index])

    def get_rigid_contact_forces(self, sim: Sim) -> np.ndarray:
        """(body,) of ``Vec3.dtype``, what contacts do to each body of all environments [N]; a copy."""
        physics = sim_of(sim, "get_rigid_contact_forces").physics
        forces = physics.tensor("contacts").torch
        physics.refresh("contacts")
        return np.ascontiguousarray(torch_interop.to_numpy(forces)).copy().view(VEC3)[:, 0]

    def get_env_rigid_contact_forces(self, env: Env) -> np.ndarray:
        """(body,) of ``Vec3.dtype``, of one environment."""
        env = env_of(env, "get_env_rigid_contact_forces")
        forces = self.get_rigid_contact_forces(env.sim)
        return forces[env.start.bodies : env.start.bodies + env.counts.bodies]


def _word(kind: Any) -> str:
    return str(kind.name.partition("_")[2].capitalize())


def _in_builder(asset: Asset, index: int) -> int:
    """Return the joint's index in the builder, where joints that hold or free a base come first."""
    return int(asset.builder.joint_count - len(asset.joints) + index)


def _joint_place(actor: Actor, domain: IndexDomain, index: int) -> int:
    """Return the index of an actor's joint in the actor, its environment or the simulation."""
    domain = one_of(IndexDomain, domain, "index domain")
    if domain == IndexDomain.DOMAIN_ACTOR:
        return index
    index += sum(len(other.asset.joints) for other in actor.env.actors[: actor.handle])
    if domain == IndexDomain.DOMAIN_SIM:
        before = actor.env.sim.envs[: actor.env.index]
        index += sum(len(other.asset.joints) for env in before for other in env.actors)
    return index


def _joint(env: Any, joint: Any, where: str) -> tuple[Actor, int]:
    """Actor and place in it of the joint of that handle."""
    env = env_of(env, where)
    owners = [(actor, index) for actor in env.actors for index in range(len(actor.asset.joints))]
    place = handle_of(joint, len(owners))
    if place is None:
        raise WarpcamError(f"{where}: joint {joint!r} came, environment {env.index} has {len(owners)}")
    return owners[place]


def _dof(env: Any, dof: Any, where: str) -> tuple[Actor, int]:
    """Actor and place in it of the degree of freedom of that handle."""
    env = env_of(env, where)
    place = handle_of(dof, env.counts.dofs)
    if place is None:
        raise WarpcamError(f"{where}: degree of freedom {dof!r} came, environment {env.index} has {env.counts.dofs}")
    found = next(actor for actor in reversed(env.actors) if actor.before.dofs <= place)
    return found, place - found.before.dofs


def _body(env: Any, body: Any, where: str) -> tuple[Actor, int]:
    """Actor and place in it of the body of that handle."""
    place = env_of(env, where).body(body, where)
    found = next(actor for actor in reversed(env.actors) if actor.before.bodies <= place)
    return found, place - found.before.bodies


def _dof_of(env: Any, joint: Any, where: str) -> int:
    """Handle of the one degree of freedom of a joint."""
    found, index = _joint(env, joint, where)
    starts = [*found.asset.builder.joint_qd_start, found.asset.builder.joint_dof_count]
    place = _in_builder(found.asset, index)
    own = [i for i, dof in enumerate(found.asset.dofs) if starts[place] <= dof.speed < starts[place + 1]]
    if len(own) != 1:
        raise WarpcamError(
            f"{where}: joint {found.asset.joints[index]!r} has {len(own)} degrees of freedom; one is needed"
        )
    return found.before.dofs + own[0]


def _targets(actor: Actor, kind: str) -> np.ndarray:
    if actor.env.sim.prepared:
        return actor.env.sim.physics.targets(actor, kind)
    return np.nan_to_num(actor.targets.get(kind, np.zeros(len(actor.asset.dofs)))).astype(np.float32)


def _joint_pose(actor: Actor, place: int) -> Transform:
    """Return the pose at which a joint holds its child, by the joint's index in the asset's builder."""
    builder = actor.asset.builder
    body = actor.env.place(actor.before.bodies + int(builder.joint_child[place]))
    local = [float(value) for value in builder.joint_X_c[place]]
    return body * Transform(local[:3], local[3:])


def _frame(actor: Actor, index: int) -> DofFrame:
    builder, speed = actor.asset.builder, actor.asset.dofs[index].speed
    place = int(np.searchsorted(builder.joint_qd_start, speed, side="right")) - 1
    pose = _joint_pose(actor, place)
    return DofFrame(pose.p, pose.transform_vector(Vec3(*(float(value) for value in builder.joint_axis[speed]))))
