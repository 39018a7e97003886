"""The simulation under the environments: Newton moves it, and states go to and from its tensors."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import newton
import numpy as np
import warp as wp

from warpcam.compat.common.scalars import whole
from warpcam.compat.isaacgym.api.enums import DOF_STATE, CoordinateSpace
from warpcam.compat.isaacgym.api.math_types import Transform, Vec3
from warpcam.compat.isaacgym.api.tensors import Tensor, take
from warpcam.compat.isaacgym.kernels import state as kernels
from warpcam.compat.isaacgym.physics import model_writes
from warpcam.compat.isaacgym.physics.applied_forces import AppliedForces
from warpcam.compat.isaacgym.physics.contact_forces import ContactForces, Sensors
from warpcam.compat.isaacgym.physics.contacts import contacts_of
from warpcam.compat.isaacgym.physics.environments import Actor, Counts, Env, Grounds, build, collide_alike
from warpcam.compat.isaacgym.physics.jacobians import JacobianArrays
from warpcam.compat.isaacgym.physics.joint_forces import JointForces
from warpcam.core import torch_interop
from warpcam.core.errors import WarpcamError

Source = tuple[tuple[int, ...], Callable[[wp.array], None]]
CONTACTS_PER_SHAPE, LEAST_CONTACTS = 8, 64


@dataclass(frozen=True)
class Reading:
    """A tensor that programs read.

    Attributes:
        array: On the device.
        shown: The same memory, or a copy on the host.
        read: What fills it.
    """

    array: wp.array
    shown: Tensor
    read: Callable[[wp.array], None]


class Physics:
    """All environments, simulated together. They can no longer be added to.

    Attributes:
        model: The ``newton.Model``.
        spot: Where its shapes and bodies are.
        state: The ``newton.State`` that is current.
        total: How much of each there is.
        stale: "drives", "surfaces" or "masses", where actors' are others than the model's until the next step.
    """

    def __init__(
        self, envs: Sequence[Env], grounds: Grounds, up: newton.Axis, gravity: Vec3, device: wp.Device, on_host: bool
    ):
        self.device, self._on_host, self._gravity = device, on_host, gravity
        before = Counts()
        for env in envs:
            env.start = before
            before = before + env.counts
        self.total, self.actors = before, [actor for env in envs for actor in env.actors]
        builder, self.spot = build(envs, grounds, up, gravity)
        self.model = builder.finalize(device=device)
        self.model.set_gravity(tuple(gravity))
        self._read_places()
        self._write_rest()
        self.state, self._other = self.model.state(), self.model.state()
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.state)
        self._control = self.model.control()
        self._solver: Any = None
        self._outdated = True  # the next step needs another solver
        self._changes = model_writes.NOTHING  # of the model, that the solver has not been told of
        self._moved = False  # joints are behind bodies
        self.stale = {"drives", "surfaces", "masses"}
        self._write_stale()
        self._contacts_felt = ContactForces(self.model)
        rows = [row for actor in self.actors for row in _sensors(actor, self.start_of(actor).bodies)]
        self._sensors = Sensors(rows, device)
        self.num_sensors = len(rows)
        self._matrices = JacobianArrays(self.model, self.actors, self.start_of)
        self._envs = envs
        self._pushes: AppliedForces | None = None
        self._listed: np.ndarray | None = None
        self._efforts = JointForces(self.model, self._speeds.numpy())
        self._told = [actor for actor in self.actors if actor.targets]
        self._readings: dict[tuple[str, str], Reading] = {}

    def start_of(self, actor: Actor) -> Counts:
        return actor.env.start + actor.before

    def simulate(self, dt: float, substeps: int) -> None:
        """Move on by ``dt`` [s]."""
        with torch_interop.in_order(self.device), wp.ScopedDevice(self.device):
            self._take_targets()
            self._write_stale()
            if self._outdated:
                self._solver, self._outdated = self._make_solver(), False
                self._efforts.bind(self._solver)
            else:
                model_writes.tell(self._solver, self._changes)
            self._changes = model_writes.NOTHING
            for _ in range(substeps):
                self.state.clear_forces()
                if self._pushes is not None:
                    self._pushes.put(self.state.body_f)
                if self._floating.size:
                    inputs = [self._floating, self.model.body_mass, wp.vec3(*self._gravity), self.state.body_f]
                    kernels.launch(kernels.hold_up, self._floating.size, inputs, self.device)
                contacts = None
                if self._pipeline is not None:
                    contacts = self._contacts
                    self._pipeline.collide(self.state, contacts)
                self._solver.step(self.state, self._other, self._control, contacts, dt / substeps)
                self.state, self._other = self._other, self.state
            if self._pushes is not None:
                self._pushes.clear()
            self._listed = None
            self._moved = self._pipeline is not None

    def tensor(self, kind: str, of: str = "") -> Tensor:
        """One of ``_reading``, brought up to date at each ``refresh`` of its kind from now on."""
        key = kind, of
        if key not in self._readings:
            shape, read = self._reading(kind, of)
            array = wp.zeros(shape, dtype=wp.float32, device=self.device)
            shown = wp.zeros(shape, dtype=wp.float32, device="cpu") if self._on_host else array
            self._readings[key] = Reading(array, Tensor(torch_interop.to_torch(shown)), read)
            try:
                self._refresh(self._readings[key])
            except WarpcamError:
                del self._readings[key]  # asked for once more it is the same error, not zeros
                raise
        return self._readings[key].shown

    def refresh(self, kind: str) -> None:
        """Bring the tensors of a kind up to date, if anybody has them."""
        for (name, _), reading in self._readings.items():
            if name == kind:
                self._refresh(reading)

    def _refresh(self, reading: Reading) -> None:
        with torch_interop.in_order(self.device):
            reading.read(reading.array)
        if self._on_host:
            reading.shown.torch.copy_(torch_interop.to_torch(reading.array))

    def _reading(self, kind: str, of: str) -> Source:
        """Shape of the tensor of that kind, and what fills it."""
        total = self.total
        readings: dict[str, Callable[[], Source]] = {
            "roots": lambda: ((total.actors, 13), partial(self._read_bodies, self._roots)),
            "bodies": lambda: ((total.bodies, 13), partial(self._read_bodies, self._bodies)),
            "dofs": lambda: ((total.dofs, 2), self._read_dofs),
            "contacts": lambda: ((total.bodies, 3), self._read_contacts),
            "sensors": lambda: ((self.num_sensors, 6), self._read_sensors),
            "efforts": lambda: ((total.dofs,), self._efforts.read),
            "jacobians": lambda: self._matrix(*self._matrices.jacobians(of)),
            "masses": lambda: self._matrix(*self._matrices.masses(of)),
        }
        return readings[kind]()

    def _read_bodies(self, rows: wp.array, array: wp.array) -> None:
        inputs = [self.state.body_q, self.state.body_qd, rows, array]
        kernels.launch(kernels.read_bodies, len(rows), inputs, self.device)

    def _read_dofs(self, array: wp.array) -> None:
        self._catch_up()
        inputs = [self.state.joint_q, self.state.joint_qd, self._coordinates, self._speeds, array]
        kernels.launch(kernels.read_dofs, self.total.dofs, inputs, self.device)

    def _read_contacts(self, array: wp.array) -> None:
        self._contacts_felt.read(self._solver, "contact forces (contacts)")
        self._contacts_felt.write(self._bodies, array)

    def _read_sensors(self, array: wp.array) -> None:
        self._contacts_felt.read(self._solver, "contact forces (sensors)")
        self._sensors.read(self._contacts_felt.felt, self._other.body_q, array)

    def _matrix(self, shape: tuple[int, ...], read: Callable[[newton.State, wp.array], None]) -> Source:
        def refresh(array: wp.array) -> None:
            self._catch_up()
            self._write_stale()
            read(self.state, array)

        return shape, refresh

    def set_roots(self, value: Any, chosen: Any, count: int | None, where: str) -> None:
        """Place actors; with what hangs on them, at once."""
        states = take(value, where, wp.float32, (self.total.actors, 13), self.device)
        which = self._chosen(chosen, count, where)
        with torch_interop.in_order(self.device):
            self._catch_up()
            places = [self._free_coordinates, self._free_speeds, self._first_joints]
            into = [self.state.joint_q, self.state.joint_qd, self.model.joint_X_p]
            kernels.launch(kernels.write_roots, len(which), [states, which, *places, *into], self.device)
            if self._any_fixed:
                self._changes |= newton.ModelFlags.JOINT_PROPERTIES
            self._place()

    def set_dofs(self, value: Any, chosen: Any, count: int | None, where: str) -> None:
        states = take(value, where, wp.float32, (self.total.dofs, 2), self.device)
        which = self._chosen(chosen, count, where)
        with torch_interop.in_order(self.device):
            self._catch_up()
            inputs = [states, which, self._first_dofs, self._coordinates, self._speeds]
            into = [self.state.joint_q, self.state.joint_qd]
            kernels.launch(kernels.write_dofs, len(which), [*inputs, *into], self.device)
            self._place()

    def set_targets(self, kind: str, value: Any, chosen: Any, count: int | None, where: str) -> None:
        """Of "positions", "velocities" or "forces", (dof,)."""
        values = take(value, where, wp.float32, (self.total.dofs,), self.device)
        which = self._chosen(chosen, count, where)
        places, into = {
            "positions": (self._coordinates, self._control.joint_target_q),
            "velocities": (self._speeds, self._control.joint_target_qd),
            "forces": (self._speeds, self._control.joint_f),
        }[kind]
        with torch_interop.in_order(self.device):
            self._take_targets()
            inputs = [values, which, self._first_dofs, places, into]
            kernels.launch(kernels.write_targets, len(which), inputs, self.device)

    def contacts(self, where: str) -> np.ndarray:
        """Of the last step, see ``contacts_of``; waits for the device once a step."""
        if self._listed is None:
            with torch_interop.in_order(self.device):
                self._listed = contacts_of(self._solver, self.model, self._other, self._envs, where)
        return self._listed

    def push(self, space: CoordinateSpace, where: str, **given: Any) -> None:
        """Have forces act on bodies in the next step, see ``AppliedForces.add``."""
        with torch_interop.in_order(self.device):
            self._pushing().add(self.state, space, where, **given)

    def push_one(self, space: CoordinateSpace, body: int, **given: Vec3 | None) -> None:
        """Likewise on one of all bodies."""
        with torch_interop.in_order(self.device):
            self._pushing().add_one(self.state, space, body, **given)

    def _pushing(self) -> AppliedForces:
        """Made for programs that push; centres of mass are those that were set last."""
        self._write_stale()
        if self._pushes is None:
            self._pushes = AppliedForces(self.model, self._envs)
        return self._pushes

    def set_gravity(self, gravity: Vec3) -> None:
        self._gravity = gravity
        with torch_interop.in_order(self.device):
            self.model.set_gravity(tuple(gravity))
            self._changes |= newton.ModelFlags.MODEL_PROPERTIES

    def tell(self, actor: Actor, kind: str, values: np.ndarray) -> None:
        """Set targets of one actor, "positions", "velocities" or "forces"; NaN leaves one as it is.

        All that are told are brought over at once, with the next step.
        """
        if not actor.targets:
            self._told.append(actor)
        actor.targets[kind] = values

    def targets(self, actor: Actor, kind: str) -> np.ndarray:
        """(dof,) "positions" or "velocities" that the joints of one actor are driven to; waits for the device."""
        start, dofs = self.start_of(actor), actor.asset.dofs
        with torch_interop.in_order(self.device):
            self._take_targets()
            if kind == "positions":
                return self._control.joint_target_q.numpy()[[start.coordinates + dof.coordinate for dof in dofs]]
            return self._control.joint_target_qd.numpy()[[start.speeds + dof.speed for dof in dofs]]

    def _take_targets(self) -> None:
        """Have drives follow what their actors were told one by one."""
        for kind, into, first in (
            ("positions", self._control.joint_target_q, "coordinate"),
            ("velocities", self._control.joint_target_qd, "speed"),
            ("forces", self._control.joint_f, "speed"),
        ):
            told = [actor for actor in self._told if kind in actor.targets]
            if not told:
                continue
            host = into.numpy()
            for actor in told:
                start = self.start_of(actor)
                begin = start.coordinates if first == "coordinate" else start.speeds
                rows, values = [begin + getattr(dof, first) for dof in actor.asset.dofs], actor.targets.pop(kind)
                host[rows] = np.where(np.isnan(values), host[rows], values)
            into.assign(host)
        self._told.clear()

    def _write_rest(self) -> None:
        """Have joints begin where actors were told before."""
        rows = np.concatenate([np.zeros(0, DOF_STATE), *(actor.states for actor in self.actors)])
        for array, places, column in (
            (self.model.joint_q, self._coordinates, "pos"),
            (self.model.joint_qd, self._speeds, "vel"),
        ):
            if len(rows):
                host = array.numpy()
                host[places.numpy()] = rows[column]
                array.assign(host)

    def _write_drives(self) -> None:
        modes = self.model.joint_target_mode.numpy().copy()  # on a CPU it is the same memory
        self._changes |= model_writes.write_drives(self.model, self._speeds.numpy(), self.actors)
        if not np.array_equal(modes, self.model.joint_target_mode.numpy()):
            self._outdated = True  # what drives a joint is built into the solver, which still tells of the last step

    def _write_stale(self) -> None:
        """Bring the model's joints, shapes and bodies up to date with the actors', of all that changed at once."""
        starts = [(actor, self.start_of(actor)) for actor in self.actors] if self.stale else []
        if "drives" in self.stale:
            self._write_drives()
        if "surfaces" in self.stale:
            self._changes |= model_writes.write_surfaces(self.model, self.spot, starts)
        if "masses" in self.stale:
            self._changes |= model_writes.write_masses(self.model, starts)
            self._floating = self._ints(model_writes.weightless(starts))
        self.stale.clear()

    def _read_places(self) -> None:
        """Where actors, bodies and degrees of freedom are in the model's arrays."""
        coordinates: list[int] = []
        speeds: list[int] = []
        first_dofs = [0]
        roots, free_q, free_qd, joints = [], [], [], []
        starts = [self.start_of(actor) for actor in self.actors]
        for actor, start in zip(self.actors, starts, strict=True):
            asset = actor.asset
            coordinates += [start.coordinates + dof.coordinate for dof in asset.dofs]
            speeds += [start.speeds + dof.speed for dof in asset.dofs]
            first_dofs.append(len(speeds))
            roots.append(start.bodies)
            joints.append(start.joints)
            free_q.append(start.coordinates if asset.free else -1)
            free_qd.append(start.speeds if asset.free else -1)
        self._any_fixed = -1 in free_q
        self._coordinates, self._speeds, self._first_dofs = map(self._ints, (coordinates, speeds, first_dofs))
        self._roots, self._first_joints, self._free_coordinates, self._free_speeds = map(
            self._ints, (roots, joints, free_q, free_qd)
        )
        self._bodies, self._all = self._ints(range(self.total.bodies)), self._ints(range(len(self.actors)))

    def _ints(self, values: Any) -> wp.array:
        return wp.array(np.array(list(values), np.int32), dtype=wp.int32, device=self.device)

    def _chosen(self, indices: Any, count: int | None, where: str) -> wp.array:
        if indices is None:
            return self._all
        most = indices.torch.numel()
        number = whole(count)
        if number is None or not 0 <= number <= most:
            raise WarpcamError(f"{where}: count must be a whole number, from 0 to the {most} indices, got {count!r}")
        taken = take(indices, f"{where}: indices", wp.int32, (most,), self.device)
        return taken[:number] if number else wp.zeros(0, dtype=wp.int32, device=self.device)

    def _place(self) -> None:
        newton.eval_fk(self.model, self.state.joint_q, self.state.joint_qd, self.state)

    def _catch_up(self) -> None:
        """Joints from bodies, where the solver moves bodies."""
        if self._moved:
            newton.eval_ik(self.model, self.state, self.state.joint_q, self.state.joint_qd)
            self._moved = False

    def _make_solver(self) -> Any:
        """MuJoCo-Warp, or for one environment on a CPU MuJoCo, which compiles nothing; where they cannot, XPBD."""
        self._pipeline, per_world = None, self.model.shape_count // max(self.model.world_count, 1)
        most = max(LEAST_CONTACTS, CONTACTS_PER_SHAPE * per_world)
        try:
            if not collide_alike(self._envs):
                raise ValueError("groups and filters keep other actors apart in one environment than in another")
            if self.device.is_cpu and self.model.world_count <= 1:
                return newton.solvers.SolverMuJoCo(self.model, use_mujoco_cpu=True)
            return newton.solvers.SolverMuJoCo(self.model, nconmax=most, njmax=4 * most)
        except (ImportError, ValueError, NotImplementedError) as error:
            logging.getLogger("warpcam").warning("simulate: by XPBD, as MuJoCo cannot: %s", error)
        self._pipeline = newton.CollisionPipeline(self.model)
        self._contacts = self._pipeline.contacts()
        return newton.solvers.SolverXPBD(self.model, iterations=8)


def _sensors(actor: Actor, first: int) -> Iterator[tuple[int, Transform, bool, bool]]:
    """Body, counted from ``first``, pose in its frame, whether it feels contacts, whether along the world's axes."""
    for body, pose, props in actor.sensors:
        yield first + body, pose, bool(props.enable_constraint_solver_forces), bool(props.use_world_frame)
