"""Calls about assets, and about actors as they are made of them."""

from collections.abc import Sequence
from typing import Any

import newton
import numpy as np

from warpcam.compat.common.scalars import real, whole
from warpcam.compat.isaacgym.api.enums import (
    DOF_PROPERTIES,
    INVALID_HANDLE,
    DofDriveMode,
    DofType,
    IndexDomain,
    check_segment,
    one_of,
)
from warpcam.compat.isaacgym.api.math_types import Transform
from warpcam.compat.isaacgym.api.params import AssetOptions
from warpcam.compat.isaacgym.api.property_types import idle_changes
from warpcam.compat.isaacgym.assets import asset as assets
from warpcam.compat.isaacgym.assets.asset import Asset
from warpcam.compat.isaacgym.physics.environments import Actor, Counts, Env, handle_of
from warpcam.compat.isaacgym.physics.simulation import Sim, env_of, sim_of
from warpcam.core.errors import WarpcamError


class AssetCalls:
    """See ``Gym``."""

    def load_asset(self, sim: Sim, rootpath: str, filename: str, options: AssetOptions | None = None) -> Asset:
        """Read an MJCF, URDF or USD file."""
        sim = sim_of(sim, "load_asset")
        return assets.load(rootpath, filename, _options(options, "load_asset"), sim.up)

    def load_urdf(self, sim: Sim, rootpath: str, filename: str, options: AssetOptions | None = None) -> Asset:
        return self.load_asset(sim, rootpath, filename, options)

    def load_mjcf(self, sim: Sim, rootpath: str, filename: str, options: AssetOptions | None = None) -> Asset:
        return self.load_asset(sim, rootpath, filename, options)

    def load_usd(self, sim: Sim, rootpath: str, filename: str, options: AssetOptions | None = None) -> Asset:
        return self.load_asset(sim, rootpath, filename, options)

    def create_box(
        self, sim: Sim, width: float, height: float, depth: float, options: AssetOptions | None = None
    ) -> Asset:
        """Create a box of these lengths along x, y and z [m]."""
        lengths = {"width": width, "height": height, "depth": depth}
        sides = [0.5 * _positive("create_box", name, value) for name, value in lengths.items()]

        def add(builder: newton.ModelBuilder, body: int, cfg: Any) -> None:
            builder.add_shape_box(body, hx=sides[0], hy=sides[1], hz=sides[2], cfg=cfg, label="box")

        return assets.made("box", _options(options, "create_box"), sim_of(sim, "create_box").up, add)

    def create_sphere(self, sim: Sim, radius: float, options: AssetOptions | None = None) -> Asset:
        radius = _positive("create_sphere", "radius", radius)

        def add(builder: newton.ModelBuilder, body: int, cfg: Any) -> None:
            builder.add_shape_sphere(body, radius=radius, cfg=cfg, label="sphere")

        return assets.made("sphere", _options(options, "create_sphere"), sim_of(sim, "create_sphere").up, add)

    def create_capsule(self, sim: Sim, radius: float, length: float, options: AssetOptions | None = None) -> Asset:
        """Along x; ``length`` is that of its cylinder [m]."""
        radius, length = _positive("create_capsule", "radius", radius), _positive("create_capsule", "length", length)
        along_x = Transform(r=(0.0, 0.5**0.5, 0.0, 0.5**0.5)).numbers()

        def add(builder: newton.ModelBuilder, body: int, cfg: Any) -> None:
            builder.add_shape_capsule(
                body, xform=along_x, radius=radius, half_height=0.5 * length, cfg=cfg, label="capsule"
            )

        return assets.made("capsule", _options(options, "create_capsule"), sim_of(sim, "create_capsule").up, add)

    def create_actor(
        self,
        env: Env,
        asset: Asset,
        pose: Transform,
        name: str | None = None,
        group: int = -1,
        filter: int = -1,
        segmentationId: int = 0,  # noqa: N803, that system's name
    ) -> int:
        """Put an asset into an environment. Its handle counts the environment's actors.

        Args:
            env: The environment.
            asset: What it is made of.
            pose: Where, in the environment's frame.
            name: None is the asset's.
            group: Actors of different groups do not collide, but those of -1 do with all.
            filter: Bits: actors that share one do not collide, nor do the bodies of one with one another. 0 and -1 are
                none; then bodies that are joined do not.
            segmentationId: Of its bodies, in images.
        """
        env = env_of(env, "create_actor")
        asset = asset_of(asset, "create_actor")
        if not isinstance(pose, Transform):
            raise WarpcamError(f"create_actor: pose must be a Transform, got {type(pose).__name__}")
        check_segment(segmentationId, "create_actor: segmentationId")
        env.sim.require_open("create_actor")
        for change in idle_changes(asset.surfaces, asset.first_surfaces):
            env.sim.warn_once(f"set_asset_rigid_shape_properties: {change}")
        if asset.tendons is not None and asset.tendons != [one for _, one in asset.extras.tendons]:
            env.sim.warn_once("set_asset_tendon_properties: tendons are held, and pull nothing")
        masks = {"group": whole(group), "filter": whole(filter)}
        for argument, mask in masks.items():
            if mask is None or not -1 <= mask < 2**31:
                came = {"group": group, "filter": filter}[argument]
                raise WarpcamError(f"create_actor: {argument} must be a whole number, at least -1, got {came!r}")
        called = asset.name if name is None else name
        actor = Actor(env, asset, pose, name=called, group=int(group), filter=int(filter), segment=int(segmentationId))
        env.add(actor)
        return actor.handle

    def get_asset_rigid_body_count(self, asset: Asset) -> int:
        return len(asset_of(asset, "get_asset_rigid_body_count").bodies)

    def get_asset_rigid_body_names(self, asset: Asset) -> list[str]:
        return list(asset_of(asset, "get_asset_rigid_body_names").bodies)

    def get_asset_rigid_body_name(self, asset: Asset, index: int) -> str:
        where = "get_asset_rigid_body_name"
        return one_at(asset_of(asset, where).bodies, index, where)

    def get_asset_rigid_body_dict(self, asset: Asset) -> dict[str, int]:
        bodies = asset_of(asset, "get_asset_rigid_body_dict").bodies
        return {name: bodies.index(name) for name in bodies}

    def find_asset_rigid_body_index(self, asset: Asset, name: str) -> int:
        return self.get_asset_rigid_body_dict(asset).get(name, INVALID_HANDLE)

    def get_asset_rigid_shape_count(self, asset: Asset) -> int:
        """Return the number of shapes that collide."""
        return len(asset_of(asset, "get_asset_rigid_shape_count").solid)

    def get_asset_joint_count(self, asset: Asset) -> int:
        return len(asset_of(asset, "get_asset_joint_count").joints)

    def get_asset_joint_names(self, asset: Asset) -> list[str]:
        return list(asset_of(asset, "get_asset_joint_names").joints)

    def get_asset_joint_dict(self, asset: Asset) -> dict[str, int]:
        """Places among ``get_asset_joint_names``: of a fixed base, rows of jacobians."""
        return {name: index for index, name in enumerate(asset_of(asset, "get_asset_joint_dict").joints)}

    def get_asset_dof_count(self, asset: Asset) -> int:
        return len(asset_of(asset, "get_asset_dof_count").dofs)

    def get_asset_dof_names(self, asset: Asset) -> list[str]:
        return [dof.name for dof in asset_of(asset, "get_asset_dof_names").dofs]

    def get_asset_dof_name(self, asset: Asset, index: int) -> str:
        where = "get_asset_dof_name"
        return one_at(asset_of(asset, where).dofs, index, where).name

    def get_asset_dof_type(self, asset: Asset, index: int) -> DofType:
        where = "get_asset_dof_type"
        return one_at(asset_of(asset, where).dofs, index, where).kind

    def get_asset_dof_dict(self, asset: Asset) -> dict[str, int]:
        return {dof.name: index for index, dof in enumerate(asset_of(asset, "get_asset_dof_dict").dofs)}

    def find_asset_dof_index(self, asset: Asset, name: str) -> int:
        return self.get_asset_dof_dict(asset).get(name, INVALID_HANDLE)

    def get_asset_dof_properties(self, asset: Asset) -> np.ndarray:
        """(dof,) of ``DofProperties.dtype``; a copy."""
        return asset_of(asset, "get_asset_dof_properties").properties.copy()

    def get_actor_count(self, env: Env) -> int:
        return len(env_of(env, "get_actor_count").actors)

    def get_actor_handle(self, env: Env, index: int) -> int:
        return env_of(env, "get_actor_handle").actor(index, "get_actor_handle").handle

    def find_actor_handle(self, env: Env, name: str) -> int:
        names = [actor.name for actor in env_of(env, "find_actor_handle").actors]
        return names.index(name) if name in names else INVALID_HANDLE

    def get_actor_name(self, env: Env, actor: int) -> str:
        return actor_of(env, actor, "get_actor_name").name

    def get_actor_asset(self, env: Env, actor: int) -> Asset:
        return actor_of(env, actor, "get_actor_asset").asset

    def get_actor_index(self, env: Env, actor: int, domain: IndexDomain) -> int:
        return place_of(actor_of(env, actor, "get_actor_index"), domain, "actors", 0)

    def find_actor_index(self, env: Env, name: str, domain: IndexDomain) -> int:
        handle = self.find_actor_handle(env, name)
        return handle if handle == INVALID_HANDLE else self.get_actor_index(env, handle, domain)

    def get_actor_rigid_body_count(self, env: Env, actor: int) -> int:
        return len(actor_of(env, actor, "get_actor_rigid_body_count").asset.bodies)

    def get_actor_rigid_body_names(self, env: Env, actor: int) -> list[str]:
        return list(actor_of(env, actor, "get_actor_rigid_body_names").asset.bodies)

    def get_actor_rigid_body_dict(self, env: Env, actor: int) -> dict[str, int]:
        return self.get_asset_rigid_body_dict(actor_of(env, actor, "get_actor_rigid_body_dict").asset)

    def get_actor_rigid_body_handle(self, env: Env, actor: int, index: int) -> int:
        """Return the handle of a body in its environment, as cameras are attached to."""
        found = actor_of(env, actor, "get_actor_rigid_body_handle")
        return found.before.bodies + found.body(index, "get_actor_rigid_body_handle")

    def get_actor_root_rigid_body_handle(self, env: Env, actor: int) -> int:
        return actor_of(env, actor, "get_actor_root_rigid_body_handle").before.bodies

    def get_actor_rigid_body_index(self, env: Env, actor: int, index: int, domain: IndexDomain) -> int:
        found = actor_of(env, actor, "get_actor_rigid_body_index")
        return place_of(found, domain, "bodies", found.body(index, "get_actor_rigid_body_index"))

    def find_actor_rigid_body_index(self, env: Env, actor: int, name: str, domain: IndexDomain) -> int:
        found = actor_of(env, actor, "find_actor_rigid_body_index")
        index = self.find_asset_rigid_body_index(found.asset, name)
        return index if index == INVALID_HANDLE else place_of(found, domain, "bodies", index)

    def find_actor_rigid_body_handle(self, env: Env, actor: int, name: str) -> int:
        return self.find_actor_rigid_body_index(env, actor, name, IndexDomain.DOMAIN_ENV)

    def get_rigid_handle(self, env: Env, actor: str, name: str) -> int:
        """Return the handle of the body of that name of the actor of that name."""
        handle = self.find_actor_handle(env, actor)
        return handle if handle == INVALID_HANDLE else self.find_actor_rigid_body_handle(env, handle, name)

    def get_env_rigid_body_count(self, env: Env) -> int:
        return env_of(env, "get_env_rigid_body_count").counts.bodies

    def get_env_dof_count(self, env: Env) -> int:
        return env_of(env, "get_env_dof_count").counts.dofs

    def get_actor_rigid_shape_count(self, env: Env, actor: int) -> int:
        return len(actor_of(env, actor, "get_actor_rigid_shape_count").asset.solid)

    def get_actor_joint_count(self, env: Env, actor: int) -> int:
        return len(actor_of(env, actor, "get_actor_joint_count").asset.joints)

    def get_env_joint_count(self, env: Env) -> int:
        return sum(len(actor.asset.joints) for actor in env_of(env, "get_env_joint_count").actors)

    def get_actor_joint_dict(self, env: Env, actor: int) -> dict[str, int]:
        return self.get_asset_joint_dict(actor_of(env, actor, "get_actor_joint_dict").asset)

    def get_actor_dof_count(self, env: Env, actor: int) -> int:
        return len(actor_of(env, actor, "get_actor_dof_count").asset.dofs)

    def get_actor_dof_names(self, env: Env, actor: int) -> list[str]:
        return self.get_asset_dof_names(actor_of(env, actor, "get_actor_dof_names").asset)

    def get_actor_dof_dict(self, env: Env, actor: int) -> dict[str, int]:
        return self.get_asset_dof_dict(actor_of(env, actor, "get_actor_dof_dict").asset)

    def find_actor_dof_index(self, env: Env, actor: int, name: str, domain: IndexDomain) -> int:
        found = actor_of(env, actor, "find_actor_dof_index")
        index = self.find_asset_dof_index(found.asset, name)
        return index if index == INVALID_HANDLE else place_of(found, domain, "dofs", index)

    def find_actor_dof_handle(self, env: Env, actor: int, name: str) -> int:
        return self.find_actor_dof_index(env, actor, name, IndexDomain.DOMAIN_ENV)

    def get_actor_dof_properties(self, env: Env, actor: int) -> np.ndarray:
        """(dof,) of ``DofProperties.dtype``; a copy."""
        return actor_of(env, actor, "get_actor_dof_properties").properties.copy()

    def set_actor_dof_properties(self, env: Env, actor: int, properties: np.ndarray) -> bool:
        """Limits, drives and gains."""
        found = actor_of(env, actor, "set_actor_dof_properties")
        if getattr(properties, "dtype", None) != DOF_PROPERTIES or properties.shape != found.properties.shape:
            raise WarpcamError(
                f"set_actor_dof_properties: what get_actor_dof_properties gives is needed, {len(found.properties)} rows"
            )
        for mode in properties["driveMode"]:
            one_of(DofDriveMode, mode, "set_actor_dof_properties: driveMode")
        found.properties[:] = properties
        if env.sim.prepared:
            env.sim.physics.stale.add("drives")
        return True

    def get_sim_actor_count(self, sim: Sim) -> int:
        return _all(sim, "get_sim_actor_count").actors

    def get_sim_rigid_body_count(self, sim: Sim) -> int:
        return _all(sim, "get_sim_rigid_body_count").bodies

    def get_sim_dof_count(self, sim: Sim) -> int:
        return _all(sim, "get_sim_dof_count").dofs

    def get_sim_joint_count(self, sim: Sim) -> int:
        return sum(self.get_env_joint_count(env) for env in sim_of(sim, "get_sim_joint_count").envs)


def asset_of(value: Any, where: str) -> Asset:
    if not isinstance(value, Asset):
        raise WarpcamError(f"{where}: an asset is needed, got {type(value).__name__}")
    return value


def one_at(values: Sequence[Any], index: Any, where: str) -> Any:
    place = handle_of(index, len(values))
    if place is None:
        raise WarpcamError(f"{where}: index {index!r} came, the asset has {len(values)}")
    return values[place]


def _options(value: Any, where: str) -> AssetOptions:
    if value is None:
        return AssetOptions()
    if not isinstance(value, AssetOptions):
        raise WarpcamError(f"{where}: options must be AssetOptions, got {type(value).__name__}")
    return value


def _positive(where: str, name: str, value: float) -> float:
    number = real(value)
    if not 0.0 < number < np.inf:
        raise WarpcamError(f"{where}: {name} must be positive and finite, got {value!r}")
    return number


def actor_of(env: Any, handle: Any, where: str) -> Actor:
    return env_of(env, where).actor(handle, where)


def _all(sim: Any, where: str) -> Counts:
    return sum((env.counts for env in sim_of(sim, where).envs), Counts())


def place_of(actor: Actor, domain: IndexDomain, kind: str, index: int) -> int:
    """Return the index of a part of an actor in the actor, its environment or the simulation."""
    if domain == IndexDomain.DOMAIN_SIM:
        index += getattr(actor.env.before(), kind)
    if domain in (IndexDomain.DOMAIN_SIM, IndexDomain.DOMAIN_ENV):
        index += getattr(actor.before, kind)
    elif domain != IndexDomain.DOMAIN_ACTOR:
        raise WarpcamError(f"index domain {domain!r} came; allowed are {', '.join(each.name for each in IndexDomain)}")
    return int(index)
