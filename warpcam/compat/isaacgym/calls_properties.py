"""Calls about surfaces of shapes, masses of bodies, motors and force sensors."""

from typing import Any

import numpy as np

from warpcam.compat.isaacgym.asset import Asset
from warpcam.compat.isaacgym.calls_assets import actor_of, asset_of
from warpcam.compat.isaacgym.maths import Transform
from warpcam.compat.isaacgym.properties import (
    HELD,
    ActuatorProperties,
    ForceSensorProperties,
    RigidBodyProperties,
    RigidShapeProperties,
    from_masses,
    from_surfaces,
    to_masses,
    to_surfaces,
)
from warpcam.compat.isaacgym.sim import Sim, sim_of
from warpcam.compat.isaacgym.tensors import Tensor
from warpcam.compat.isaacgym.world import Env, handle_of
from warpcam.errors import WarpcamError


class PropertyCalls:
    """See ``Gym``."""

    def get_asset_rigid_shape_properties(self, asset: Asset) -> list[RigidShapeProperties]:
        """Of all of its shapes; copies."""
        return to_surfaces(asset_of(asset, "get_asset_rigid_shape_properties").surfaces)

    def set_asset_rigid_shape_properties(self, asset: Asset, properties: list[RigidShapeProperties]) -> bool:
        """Of the actors that are made of it from now on."""
        where = "set_asset_rigid_shape_properties"
        asset = asset_of(asset, where)
        asset.surfaces = from_surfaces(properties, asset.surfaces, where)
        return True

    def get_actor_rigid_shape_properties(self, env: Env, actor: int) -> list[RigidShapeProperties]:
        """Of all of its shapes; copies."""
        return to_surfaces(actor_of(env, actor, "get_actor_rigid_shape_properties").surfaces)

    def set_actor_rigid_shape_properties(self, env: Env, actor: int, properties: list[RigidShapeProperties]) -> bool:
        """Of one actor, at any time."""
        where = "set_actor_rigid_shape_properties"
        found = actor_of(env, actor, where)
        before, found.surfaces = found.surfaces, from_surfaces(properties, found.surfaces, where)
        for name in HELD:
            if (found.surfaces[name] != before[name]).any():
                env.sim.warn_once(f"{where}: {name} is held and changes nothing")
        if env.sim.prepared:
            env.sim.physics.stale.add("surfaces")
        return True

    def get_actor_rigid_body_properties(self, env: Env, actor: int) -> list[RigidBodyProperties]:
        """Of all of its bodies; copies."""
        return to_masses(actor_of(env, actor, "get_actor_rigid_body_properties").masses)

    def set_actor_rigid_body_properties(
        self,
        env: Env,
        actor: int,
        properties: list[RigidBodyProperties],
        recomputeInertia: bool = False,  # noqa: N803, that system's name
    ) -> bool:
        """Masses, centres and inertias of one actor, at any time; inertias may follow the masses instead."""
        where = "set_actor_rigid_body_properties"
        found = actor_of(env, actor, where)
        found.masses = from_masses(properties, found.masses, bool(recomputeInertia), where)
        if env.sim.prepared:
            env.sim.physics.stale.add("masses")
        return True

    def get_asset_actuator_properties(self, asset: Asset) -> list[ActuatorProperties]:
        """Of the motors of an MJCF file, in its order; other assets have none."""
        asset = asset_of(asset, "get_asset_actuator_properties")
        if asset.path is None or asset.path.suffix.lower() not in (".xml", ".mjcf"):
            return []
        import mujoco

        try:
            model = mujoco.MjModel.from_xml_path(str(asset.path))
        except ValueError as error:
            raise WarpcamError(f"get_asset_actuator_properties: {str(asset.path)!r} cannot be read: {error}") from error
        return [_motor(mujoco, model, index) for index in range(model.nu)]

    def get_asset_actuator_count(self, asset: Asset) -> int:
        return len(self.get_asset_actuator_properties(asset))

    def create_asset_force_sensor(
        self, asset: Asset, body: int, pose: Transform, props: ForceSensorProperties | None = None
    ) -> int:
        """Have a body of the actors that are made of it from now on feel forces at a pose in its frame."""
        where = "create_asset_force_sensor"
        asset = asset_of(asset, where)
        index = handle_of(body, len(asset.bodies))
        if index is None:
            raise WarpcamError(f"{where}: body {body!r} came, the asset has 0 to {len(asset.bodies) - 1}")
        if not isinstance(pose, Transform):
            raise WarpcamError(f"{where}: pose must be a Transform, got {type(pose).__name__}")
        props = ForceSensorProperties() if props is None else props
        if not isinstance(props, ForceSensorProperties):
            raise WarpcamError(f"{where}: ForceSensorProperties are needed, got {type(props).__name__}")
        asset.sensors.append((index, Transform(pose.p, pose.r), props))
        return len(asset.sensors) - 1

    def get_asset_force_sensor_count(self, asset: Asset) -> int:
        return len(asset_of(asset, "get_asset_force_sensor_count").sensors)

    def get_actor_force_sensor_count(self, env: Env, actor: int) -> int:
        return len(actor_of(env, actor, "get_actor_force_sensor_count").sensors)

    def get_sim_force_sensor_count(self, sim: Sim) -> int:
        envs = sim_of(sim, "get_sim_force_sensor_count").envs
        return sum(len(actor.sensors) for env in envs for actor in env.actors)

    def acquire_net_contact_force_tensor(self, sim: Sim) -> Tensor:
        """(body, 3) float32: sum of what contacts do to each body, along the world's axes [N]."""
        return sim_of(sim, "acquire_net_contact_force_tensor").physics.tensor("contacts")

    def refresh_net_contact_force_tensor(self, sim: Sim) -> bool:
        sim_of(sim, "refresh_net_contact_force_tensor").physics.refresh("contacts")
        return True

    def acquire_force_sensor_tensor(self, sim: Sim) -> Tensor:
        """(sensor, 6) float32: force and torque of contacts at each sensor [N, N m]."""
        return sim_of(sim, "acquire_force_sensor_tensor").physics.tensor("sensors")

    def refresh_force_sensor_tensor(self, sim: Sim) -> bool:
        sim_of(sim, "refresh_force_sensor_tensor").physics.refresh("sensors")
        return True


def _motor(mujoco: Any, model: Any, index: int) -> ActuatorProperties:
    joint, moved = "", int(model.actuator_trnid[index, 0])
    if model.actuator_trntype[index] in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        joint = model.joint(moved).name
    control, force = model.actuator_ctrlrange[index], model.actuator_forcerange[index]
    bias = (
        model.actuator_biasprm[index] if model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE else np.zeros(3)
    )
    return ActuatorProperties(
        name=model.actuator(index).name,
        joint=joint,
        motor_effort=float(model.actuator_gear[index, 0]),
        control_limited=bool(model.actuator_ctrllimited[index]),
        lower_control_limit=float(control[0]),
        upper_control_limit=float(control[1]),
        force_limited=bool(model.actuator_forcelimited[index]),
        lower_force_limit=float(force[0]),
        upper_force_limit=float(force[1]),
        kp=float(-bias[1]),
        kv=float(-bias[2]),
    )
