"""Contents of a program's environments, and Newton models of them."""

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.common.scalars import whole
from warpcam.compat.isaacgym.api.math_types import Transform, Vec3, matrix_of
from warpcam.compat.isaacgym.api.params import PlaneParams
from warpcam.compat.isaacgym.assets.asset import Asset
from warpcam.compat.isaacgym.terrain.terrain import Terrain, surface_of
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

NO_TEXTURE = -1
GREY = (0.5, 0.5, 0.5)
VISIBLE, COLLIDES = int(newton.ShapeFlags.VISIBLE), int(newton.ShapeFlags.COLLIDE_SHAPES)
Apart = tuple[tuple[int, ...], tuple[tuple[int, int], ...]]


@dataclass
class Counts:
    """Numbers of bodies, shapes and joints: of an actor, an environment or all, or before it."""

    actors: int = 0
    bodies: int = 0
    shapes: int = 0
    dofs: int = 0
    joints: int = 0
    coordinates: int = 0
    speeds: int = 0

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    def __sub__(self, other: "Counts") -> "Counts":
        return Counts(*(a - b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


class Actor:
    """An asset in an environment.

    Attributes:
        handle: Its place in the environment.
        group: What is in another one does not collide with it, but for -1.
        filter: Bits; what shares one does not collide with it, nor do its bodies with one another. 0 and -1 are none.
        before: What is in the environment before it.
        segments: (body,) int64, ids in segmentation images.
        colors: (shape,) display colours, (n, 3) float32.
        textures: (shape,) int64, handles, or NO_TEXTURE.
        properties: (dof,) of DOF_PROPERTIES.
        states: (dof,) of DOF_STATE, until the simulation is prepared.
        targets: (dof,) by "positions", "velocities" and "forces", NaN for none, until the simulation has them.
        surfaces: (shape,) of SURFACE.
        masses: (body,) of MASS.
        sensors: Its asset's force sensors, as they were when it was made.
    """

    def __init__(self, env: "Env", asset: Asset, pose: Transform, name: str, group: int, filter: int, segment: int):
        self.env, self.asset, self.name, self.group, self.filter = env, asset, name, group, filter
        self.pose = Transform(pose.p, pose.r)
        self.handle, self.before = len(env.actors), env.counts
        self.segments = np.full(len(asset.bodies), segment, np.int64)
        self.segment = segment
        self.properties, self.states = asset.properties.copy(), asset.rest.copy()
        self.targets: dict[str, np.ndarray] = {}
        self.surfaces, self.masses = asset.surfaces, asset.masses  # never written in place
        self.sensors = tuple(asset.sensors)
        builder = asset.builder
        self.counts = Counts(
            actors=1,
            bodies=len(asset.bodies),
            shapes=builder.shape_count,
            dofs=len(asset.dofs),
            joints=builder.joint_count,
            coordinates=builder.joint_coord_count,
            speeds=builder.joint_dof_count,
        )
        self.reset_looks(np.arange(builder.shape_count))

    def reset_looks(self, shapes: np.ndarray) -> None:
        if not hasattr(self, "colors"):
            self.colors = self.asset.colors.copy()
            self.textures = np.full(len(self.colors), NO_TEXTURE, np.int64)
        self.colors[shapes] = self.asset.colors[shapes]
        self.textures[shapes] = NO_TEXTURE

    def bodies(self) -> np.ndarray:
        """(body, 13) of its bodies in its environment's frame, until the simulation is prepared."""
        rows = self.asset.bodies_at(self.states).astype(np.float64)
        turn = matrix_of(self.pose.r)
        for row in rows:
            place = self.pose * Transform(row[:3], row[3:7])
            row[:7] = place.numbers()
            row[7:10], row[10:] = turn @ row[7:10], turn @ row[10:]
        return rows

    def body(self, index: int, where: str) -> int:
        count = len(self.asset.bodies)
        if handle_of(index, count) is None:
            raise WarpcamError(f"{where}: body {index!r} came, actor {self.name!r} has 0 to {count - 1}")
        return int(index)


class Env:
    """One environment: a world of its own, which nothing of another one is seen from.

    Attributes:
        origin: Of its frame in the frame that all share [m].
        start: What is before it, once the simulation is prepared.
    """

    def __init__(self, sim: Any, index: int, origin: Vec3):
        self._sim = weakref.ref(sim)
        self.index, self.origin = index, origin
        self.actors: list[Actor] = []
        self.counts = Counts()
        self.start = Counts()
        self.cameras: dict[int, Any] = {}
        self.next_camera = 0

    def actor(self, handle: Any, where: str) -> Actor:
        count = len(self.actors)
        place = handle_of(handle, count)
        if place is None:
            known = f"0 to {count - 1}" if count else "none"
            raise WarpcamError(f"{where}: actor {handle!r} came, environment {self.index} has {known}")
        return self.actors[place]

    def body(self, handle: Any, where: str) -> int:
        count = self.counts.bodies
        place = handle_of(handle, count)
        if place is None:
            known = f"0 to {count - 1}" if count else "none"
            raise WarpcamError(f"{where}: body {handle!r} came, environment {self.index} has {known}")
        return place

    def place(self, body: int) -> Transform:
        """Return the present pose of a body, in this environment's frame; waits for the device."""
        if self.sim.prepared:
            first = self.start.bodies + body
            row = torch_interop.to_numpy(self.sim.physics.state.body_q[first : first + 1])[0]
        else:
            actor = next(actor for actor in reversed(self.actors) if actor.before.bodies <= body)
            row = actor.bodies()[body - actor.before.bodies]
        return Transform(row[:3].tolist(), row[3:7].tolist())

    def add(self, actor: Actor) -> None:
        self.actors.append(actor)
        self.counts = self.counts + actor.counts
        self.sim.grew(self)

    @property
    def sim(self) -> Any:
        """The simulation that it is in."""
        sim = self._sim()
        if sim is None or not sim.alive:
            raise WarpcamError(f"environment {self.index}: its simulation has been destroyed")
        return sim

    def before(self) -> Counts:
        """Return the counts of all environments before this one, as of now."""
        if self.sim.prepared:
            return self.start
        return self.sim.total_before(self)


def handle_of(value: Any, count: int) -> int | None:
    """The whole number that it is, of Python, numpy or torch, or None if it is none from 0 to below ``count``."""
    number = None if isinstance(value, bool) else whole(value)
    return number if number is not None and 0 <= number < count else None


@dataclass
class Grounds:
    """Objects that stand in no environment and are seen from all."""

    planes: list[PlaneParams] = field(default_factory=list)
    terrains: list[Terrain] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.planes) + len(self.terrains)

    def moved(self, origin: Vec3) -> bool:
        """Return whether the objects move in the frame of an environment with that origin."""
        level = all(plane.normal.dot(origin) == 0.0 for plane in self.planes)
        return not level or bool(self.terrains and any(origin))

    @property
    def differ(self) -> bool:
        """Return whether a visible object differs from the one that collides."""
        return any(terrain.seen is not terrain.felt for terrain in self.terrains)

    @property
    def segments(self) -> list[int]:
        planes = [int(plane.segmentation_id) for plane in self.planes]
        return planes + [int(terrain.params.segmentation_id) for terrain in self.terrains]


@dataclass(frozen=True)
class Spot:
    """Start of a model's shapes in a list of all shapes of all environments.

    Attributes:
        shapes: (shape,) int64, or -1 - n for ground n.
        bodies: (body,) int64, likewise in a list of all bodies.
    """

    shapes: np.ndarray
    bodies: np.ndarray


def build(
    envs: Sequence[Env], grounds: Grounds, up: newton.Axis, gravity: Vec3, drawn: bool = False
) -> tuple[newton.ModelBuilder, Spot]:
    """A world for each environment, one on the other; where grounds differ between them, each has its own.

    To be simulated, or ``drawn``.
    """
    builder = newton.ModelBuilder(up_axis=up, gravity=tuple(gravity))
    apart = any(grounds.moved(env.origin) for env in envs)
    shapes: list[np.ndarray] = []
    if not apart:
        shapes.append(_add_grounds(builder, grounds, Vec3(), drawn))
    before = Counts()
    for together in _alike(envs):
        first = together[0]
        one = newton.ModelBuilder(up_axis=up, gravity=tuple(gravity))
        for actor in first.actors:
            one.add_builder(actor.asset.builder, xform=wp.transform(*actor.pose.numbers()))
        _keep_apart(one, first)
        if apart:
            firsts = []
            for env in together:
                builder.begin_world()
                shapes += [_add_grounds(builder, grounds, env.origin, drawn), _shapes_of(env)]
                firsts.append(builder.shape_count)
                builder.add_builder(one)
                builder.end_world()
        else:
            firsts = [builder.shape_count + number * one.shape_count for number in range(len(together))]
            builder.replicate(one, len(together))  # in one go: thousands of environments are made in seconds
            shapes += [_shapes_of(env) for env in together]
        for env, first_shape in zip(together, firsts, strict=True):
            start = replace(before, shapes=first_shape)
            for actor, pattern in zip(env.actors, first.actors, strict=True):
                if actor.pose != pattern.pose:
                    _move(builder, actor, start + actor.before)
            before = before + env.counts
    bodies = [np.arange(env.start.bodies, env.start.bodies + env.counts.bodies) for env in envs]
    return builder, Spot(np.concatenate(shapes), np.concatenate(bodies))


def _shapes_of(env: Env) -> np.ndarray:
    return np.arange(env.start.shapes, env.start.shapes + env.counts.shapes)


def collide_alike(envs: Sequence[Env]) -> bool:
    """Return whether collisions between actors are filtered alike in all environments.

    MuJoCo filters as the first does.
    """
    return len({_apart_in(env) for env in envs}) <= 1


def _alike(envs: Sequence[Env]) -> list[list[Env]]:
    """Runs of environments with the same assets, which collide in the same way."""
    runs: list[list[Env]] = []
    assets: tuple[list[int], Apart] | None = None
    for env in envs:
        found = [id(actor.asset) for actor in env.actors], _apart_in(env)
        if runs and found == assets:
            runs[-1].append(env)
        else:
            runs.append([env])
            assets = found
    return runs


def _apart_in(env: Env) -> Apart:
    """Actors whose bodies do not collide with one another, and pairs of actors that do not."""
    groups = [actor.group for actor in env.actors]
    # Which actors are of one group matters, not its number: that differs between environments.
    firsts = tuple(-1 if group < 0 else groups.index(group) for group in groups)
    return _apart(firsts, tuple(max(actor.filter, 0) for actor in env.actors))


@lru_cache(maxsize=64)
def _apart(groups: tuple[int, ...], filters: tuple[int, ...]) -> Apart:
    pairs = [
        (one, other)
        for one, other in combinations(range(len(groups)), 2)
        if filters[one] & filters[other] or (groups[one] != groups[other] and min(groups[one], groups[other]) >= 0)
    ]
    return tuple(np.flatnonzero(filters).tolist()), tuple(pairs)


def _keep_apart(builder: newton.ModelBuilder, env: Env) -> None:
    """Have what shares bits of filters, or is in different groups, not collide."""
    alone, pairs = _apart_in(env)
    for actor in (env.actors[index] for index in alone):
        for shape in _solid(actor):  # of a negative group, shapes collide with all but one another
            builder.shape_collision_group[shape] = -actor.filter
    for one, other in ((env.actors[first], env.actors[second]) for first, second in pairs):
        if not one.filter == other.filter > 0:
            for pair in product(_solid(one), _solid(other)):
                builder.add_shape_collision_filter_pair(*pair)


def _solid(actor: Actor) -> list[int]:
    """Its shapes that collide, in its environment's."""
    flags = np.asarray(actor.asset.builder.shape_flags, np.int64)
    return [actor.before.shapes + int(shape) for shape in np.flatnonzero(flags & COLLIDES)]


def _move(builder: newton.ModelBuilder, actor: Actor, start: Counts) -> None:
    """Put an actor, which begins there in the builder, where its pose says."""
    own, pose = actor.asset.builder, wp.transform(*actor.pose.numbers())
    for joint, parent in enumerate(own.joint_parent):
        if parent >= 0:
            continue
        if own.joint_type[joint] == newton.JointType.FREE:
            q = int(own.joint_q_start[joint])
            place = pose * wp.transform(*own.joint_q[q : q + 7])
            builder.joint_q[start.coordinates + q : start.coordinates + q + 7] = [float(value) for value in place]
        else:
            builder.joint_X_p[start.joints + joint] = pose * wp.transform(*own.joint_X_p[joint])
    for body, place in enumerate(own.body_q):
        builder.body_q[start.bodies + body] = pose * wp.transform(*place)
    for shape in np.flatnonzero(actor.asset.shapes < 0):
        builder.shape_transform[start.shapes + shape] = pose * wp.transform(*own.shape_transform[shape])


def _add_grounds(builder: newton.ModelBuilder, grounds: Grounds, origin: Vec3, drawn: bool) -> np.ndarray:
    """In an environment whose frame has its origin there."""
    for plane in grounds.planes:
        normal = plane.normal.normalize()
        config = surface_of(plane)
        away = plane.distance + normal.dot(origin)
        builder.add_shape_plane(plane=(*normal, away), width=0.0, length=0.0, cfg=config, color=GREY, label="ground")
    for terrain in grounds.terrains:
        terrain.add(builder, origin, GREY, drawn)
    return -1 - np.arange(len(grounds))
