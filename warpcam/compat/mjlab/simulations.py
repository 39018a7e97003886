"""Sensors of mjlab's simulations: importing this has ``Simulation.sense`` read ours beside whatever else it does."""

import weakref
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

import mujoco
from mjlab.sim import Simulation
from mjlab.sim.sim_data import WarpBridge


class Part(Protocol):
    """All sensors of one kind in one simulation."""

    def __init__(self, mjm: mujoco.MjModel, m: Any, d: Any): ...

    def render(self) -> None:
        """Read them all."""


PartType = TypeVar("PartType", bound=Part)


class SimulationSensors:
    """All sensors of one simulation, which hold it."""

    def __init__(self, mjm: mujoco.MjModel, m: Any, d: Any):
        self.data = d
        self._mjm, self._m = mjm, m
        self._parts: dict[type, Part] = {}

    def part(self, kind: type[PartType]) -> PartType:
        """The sensors of that kind, which begin with the first call."""
        if kind not in self._parts:
            self._parts[kind] = kind(self._mjm, self._m, self.data)
        return cast(PartType, self._parts[kind])

    def render(self) -> None:
        for part in self._parts.values():
            part.render()


# Each is alive as long as a sensor of its simulation is.
_simulations: weakref.WeakValueDictionary[int, SimulationSensors] = weakref.WeakValueDictionary()


def sensors_of(mjm: mujoco.MjModel, model: Any, data: Any) -> SimulationSensors:
    """The sensors of a simulation.

    Args:
        mjm: The host's model.
        model: ``mujoco_warp.Model``, or mjlab's bridge to it.
        data: ``mujoco_warp.Data``, or mjlab's bridge to it.
    """
    m, d = _struct_of(model), _struct_of(data)
    sensors = _simulations.get(id(d))
    if sensors is None or sensors.data is not d:
        sensors = _simulations[id(d)] = SimulationSensors(mjm, m, d)
    return sensors


def _struct_of(bridge: Any) -> Any:
    """Return the struct that mjlab's bridge to torch wraps."""
    return bridge.struct if isinstance(bridge, WarpBridge) else bridge


def _sense_too() -> None:
    if hasattr(Simulation.sense, "_of_warpcam"):
        return
    sense = Simulation.sense

    @wraps(sense)
    def sense_and_read(self: Simulation) -> None:
        sense(self)
        sensors = _simulations.get(id(self.wp_data))
        if sensors is not None and sensors.data is self.wp_data:
            sensors.render()

    sense_and_read._of_warpcam = True  # type: ignore[attr-defined]
    Simulation.sense = sense_and_read


_sense_too()
