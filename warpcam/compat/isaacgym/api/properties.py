"""Calls about surfaces of shapes, masses of bodies, motors and force sensors."""

from dataclasses import replace

import numpy as np

from warpcam.compat.isaacgym.api.assets import actor_of, asset_of, one_at
from warpcam.compat.isaacgym.api.enums import INVALID_HANDLE
from warpcam.compat.isaacgym.api.math_types import Transform
from warpcam.compat.isaacgym.api.property_types import (
    ActuatorProperties,
    ForceSensorProperties,
    IndexRange,
    RigidBodyProperties,
    RigidShapeProperties,
    TendonProperties,
    from_masses,
    from_surfaces,
    idle_changes,
    listed,
    to_masses,
    to_surfaces,
)
from warpcam.compat.isaacgym.api.tensors import Tensor
from warpcam.compat.isaacgym.assets.asset import Asset
from warpcam.compat.isaacgym.physics.environments import Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, sim_of
from warpcam.core.errors import WarpcamError


class PropertyCalls:
    """See ``Gym``."""

    def get_asset_rigid_shape_properties(self, asset: Asset) -> list[RigidShapeProperties]:
        """Return the properties of all shapes that collide; copies."""
        asset = asset_of(asset, "get_asset_rigid_shape_properties")
        return to_surfaces(asset.surfaces[asset.solid])

    def set_asset_rigid_shape_properties(self, asset: Asset, properties: list[RigidShapeProperties]) -> bool:
        """Set the properties for actors that are made of the asset from now on."""
        where = "set_asset_rigid_shape_properties"
        asset = asset_of(asset, where)
        asset.surfaces = from_surfaces(properties, asset.surfaces, asset.solid, where)
        return True

    def get_actor_rigid_shape_properties(self, env: Env, actor: int) -> list[RigidShapeProperties]:
        """Return the properties of all shapes that collide; copies."""
        found = actor_of(env, actor, "get_actor_rigid_shape_properties")
        return to_surfaces(found.surfaces[found.asset.solid])

    def set_actor_rigid_shape_properties(self, env: Env, actor: int, properties: list[RigidShapeProperties]) -> bool:
        """Set the properties of one actor's shapes, at any time."""
        where = "set_actor_rigid_shape_properties"
        found = actor_of(env, actor, where)
        before = found.surfaces
        found.surfaces = from_surfaces(properties, before, found.asset.solid, where)
        for change in idle_changes(found.surfaces, before):
            env.sim.warn_once(f"{where}: {change}")
        if env.sim.prepared:
            env.sim.physics.stale.add("surfaces")
        return True

    def get_actor_rigid_body_properties(self, env: Env, actor: int) -> list[RigidBodyProperties]:
        """Return the properties of all bodies; copies."""
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
        """Return the properties of an MJCF file's motors, in its order; other assets have none."""
        motors = asset_of(asset, "get_asset_actuator_properties").extras.motors
        return [replace(one) for one in motors]

    def get_asset_actuator_count(self, asset: Asset) -> int:
        return len(asset_of(asset, "get_asset_actuator_count").extras.motors)

    def get_asset_actuator_name(self, asset: Asset, index: int) -> str:
        where = "get_asset_actuator_name"
        return one_at(asset_of(asset, where).extras.motors, index, where).name

    def get_asset_actuator_joint_name(self, asset: Asset, index: int) -> str:
        """Return the name of the joint that an actuator moves."""
        where = "get_asset_actuator_joint_name"
        return one_at(asset_of(asset, where).extras.motors, index, where).joint

    def find_asset_actuator_index(self, asset: Asset, name: str) -> int:
        names = [motor.name for motor in asset_of(asset, "find_asset_actuator_index").extras.motors]
        return names.index(name) if name in names else INVALID_HANDLE

    def get_actor_actuator_properties(self, env: Env, actor: int) -> list[ActuatorProperties]:
        """Return the properties of the motors of the actor's asset, as the methods below do."""
        return self.get_asset_actuator_properties(actor_of(env, actor, "get_actor_actuator_properties").asset)

    def get_actor_actuator_count(self, env: Env, actor: int) -> int:
        return self.get_asset_actuator_count(actor_of(env, actor, "get_actor_actuator_count").asset)

    def get_actor_actuator_name(self, env: Env, actor: int, index: int) -> str:
        return self.get_asset_actuator_name(actor_of(env, actor, "get_actor_actuator_name").asset, index)

    def get_actor_actuator_joint_name(self, env: Env, actor: int, index: int) -> str:
        return self.get_asset_actuator_joint_name(actor_of(env, actor, "get_actor_actuator_joint_name").asset, index)

    def find_actor_actuator_index(self, env: Env, actor: int, name: str) -> int:
        return self.find_asset_actuator_index(actor_of(env, actor, "find_actor_actuator_index").asset, name)

    def get_asset_tendon_count(self, asset: Asset) -> int:
        """Return the number of tendons of an MJCF file; other assets have none."""
        return len(asset_of(asset, "get_asset_tendon_count").extras.tendons)

    def get_asset_tendon_name(self, asset: Asset, index: int) -> str:
        where = "get_asset_tendon_name"
        return one_at(asset_of(asset, where).extras.tendons, index, where)[0]

    def find_asset_tendon_index(self, asset: Asset, name: str) -> int:
        names = [known for known, _ in asset_of(asset, "find_asset_tendon_index").extras.tendons]
        return names.index(name) if name in names else INVALID_HANDLE

    def get_asset_tendon_properties(self, asset: Asset) -> list[TendonProperties]:
        """Return the properties of all tendons; copies."""
        asset = asset_of(asset, "get_asset_tendon_properties")
        rows = [one for _, one in asset.extras.tendons] if asset.tendons is None else asset.tendons
        return [replace(one) for one in rows]

    def set_asset_tendon_properties(self, asset: Asset, properties: list[TendonProperties]) -> bool:
        """Held: tendons pull nothing."""
        where = "set_asset_tendon_properties"
        asset = asset_of(asset, where)
        given = listed(properties, TendonProperties, len(asset.extras.tendons), where)
        asset.tendons = [replace(one) for one in given]
        return True

    def get_asset_rigid_body_shape_indices(self, asset: Asset) -> list[IndexRange]:
        """Return the range of colliding shapes of each body."""
        return _ranges(asset_of(asset, "get_asset_rigid_body_shape_indices"))

    def get_actor_rigid_body_shape_indices(self, env: Env, actor: int) -> list[IndexRange]:
        """Return the range of colliding shapes of each body."""
        return _ranges(actor_of(env, actor, "get_actor_rigid_body_shape_indices").asset)

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
        asset.sensors.append((index, Transform(pose.p, pose.r), replace(props)))
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


def _ranges(asset: Asset) -> list[IndexRange]:
    bodies = asset.shapes[asset.solid]
    starts, ends = (np.searchsorted(bodies, range(len(asset.bodies)), side) for side in ("left", "right"))
    return [IndexRange(int(start), int(end - start)) for start, end in zip(starts, ends, strict=True)]
