"""A simulation: what a program has made of it so far, and where it is on the way from step to image."""

import math
import warnings
from copy import deepcopy
from typing import Any

import newton
import warp as wp

from warpcam.compat.common.scalars import real
from warpcam.compat.isaacgym.api.enums import UpAxis
from warpcam.compat.isaacgym.api.math_types import Vec3
from warpcam.compat.isaacgym.api.params import SimParams
from warpcam.compat.isaacgym.cameras.appearance import Appearance, DirectionalLight
from warpcam.compat.isaacgym.cameras.camera_batches import CameraBatches
from warpcam.compat.isaacgym.physics.environments import Counts, Env, Grounds
from warpcam.compat.isaacgym.physics.physics import Physics
from warpcam.core.errors import WarpcamError

DAYLIGHT = DirectionalLight((0.85, 0.85, 0.85), (0.25, 0.25, 0.25), (0.5, -0.5, 0.8))


class Sim:
    """What ``create_sim`` gives.

    Attributes:
        device: Where all of it is simulated and drawn.
        on_host: Whether state tensors are on the CPU though the device is not.
        fetched: Whether the last step's results have been fetched.
        shown: Whether ``step_graphics`` has been called since the last step.
        accessing: Whether images are being read, between start and end.
        steps: How many there have been.
    """

    def __init__(self, device: wp.Device, params: SimParams, quirks: bool):
        self.device, self.params, self.quirks = device, _checked(params, "create_sim"), quirks
        self.on_host = device.is_cuda and not params.use_gpu_pipeline
        self.up = newton.Axis.Z if params.up_axis == UpAxis.UP_AXIS_Z else newton.Axis.Y
        self.gravity = Vec3(*params.gravity)
        self.appearance, self.grounds = Appearance(), Grounds()
        self.appearance.lamps[0] = DAYLIGHT if self.up == newton.Axis.Z else DirectionalLight(*_lying(DAYLIGHT))
        self.envs: list[Env] = []
        self.camera_batches = CameraBatches(self.appearance, self.grounds, self.up)
        self.fetched = self.shown = True
        self.accessing = self.alive = False
        self.alive = True
        self.time, self.steps = 0.0, 0
        self._physics: Physics | None = None
        self._sum, self._summed = Counts(), 0
        self._warned: set[str] = set()

    @property
    def prepared(self) -> bool:
        return self._physics is not None

    @property
    def physics(self) -> Physics:
        """Made when it is first needed; from then on nothing can be added."""
        if self._physics is None:
            if not self.envs:
                raise WarpcamError("prepare_sim: the simulation has no environments; create_env makes one")
            self._physics = Physics(self.envs, self.grounds, self.up, self.gravity, self.device, self.on_host)
        return self._physics

    def change(self, params: SimParams) -> None:
        """Take other parameters, of which some can no longer be changed."""
        up = newton.Axis.Z if params.up_axis == UpAxis.UP_AXIS_Z else newton.Axis.Y
        if up != self.up:
            raise WarpcamError("set_sim_params: up_axis is another than that of create_sim; it cannot be changed")
        self.params, self.gravity = _checked(params, "set_sim_params"), Vec3(*params.gravity)
        if self._physics is not None:
            self._physics.set_gravity(self.gravity)

    def total_before(self, env: Env) -> Counts:
        """What is in the environments before one, as of now."""
        if env is not self.envs[-1]:
            return sum((other.counts for other in self.envs[: env.index]), Counts())
        # As programs mostly ask, of the newest one: what has been summed already is.
        for other in self.envs[self._summed : -1]:
            self._sum = self._sum + other.counts
        self._summed = len(self.envs) - 1
        return self._sum

    def grew(self, env: Env) -> None:
        """Something was put into an environment."""
        if env.index < self._summed:
            self._sum, self._summed = Counts(), 0

    def require_open(self, where: str) -> None:
        if self.prepared:
            raise WarpcamError(f"{where}: the simulation is prepared already; nothing can be added to it any more")

    def warn_once(self, message: str) -> None:
        if message not in self._warned:
            self._warned.add(message)
            warnings.warn(message, RuntimeWarning, stacklevel=3)


def _checked(params: SimParams, where: str) -> SimParams:
    """A copy of parameters that can be stepped with."""
    if not 0.0 < real(params.dt) < math.inf:
        raise WarpcamError(f"{where}: SimParams.dt must be positive and finite, got {params.dt!r}")
    if not isinstance(params.gravity, Vec3) or not all(math.isfinite(value) for value in params.gravity):
        raise WarpcamError(f"{where}: SimParams.gravity must be a Vec3 of finite numbers, got {params.gravity!r}")
    return deepcopy(params)


def sim_of(value: Any, where: str) -> Sim:
    if not isinstance(value, Sim):
        raise WarpcamError(f"{where}: a simulation of create_sim is needed, got {type(value).__name__}")
    if not value.alive:
        raise WarpcamError(f"{where}: the simulation has been destroyed")
    return value


def env_of(value: Any, where: str) -> Env:
    if not isinstance(value, Env):
        raise WarpcamError(f"{where}: an environment of create_env is needed, got {type(value).__name__}")
    return value


def _lying(lamp: DirectionalLight) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """The same where y is up."""
    x, y, z = lamp.direction
    return lamp.intensity, lamp.ambient, (x, z, -y)
