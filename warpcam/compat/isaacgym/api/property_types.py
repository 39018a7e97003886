"""Surfaces of shapes, masses of bodies, motors and force sensors, as actors keep them and as programs fill them in."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import newton
import numpy as np

from warpcam.compat.common.scalars import real, whole
from warpcam.compat.isaacgym.api.math_types import Mat33, Vec3
from warpcam.compat.isaacgym.api.params import Strict
from warpcam.core.errors import WarpcamError

HELD = ("restitution", "compliance", "thickness", "filter", "contact_offset", "rest_offset")
FRICTIONS = {
    "friction": "shape_material_mu",
    "rolling_friction": "shape_material_mu_rolling",
    "torsion_friction": "shape_material_mu_torsional",
}
XPBD_ALONE = ("rolling_friction", "torsion_friction")  # MuJoCo's contacts slide only
FIELDS = (*FRICTIONS, *HELD)
SURFACE = np.dtype([(name, "f8") for name in FIELDS])
MASS = np.dtype([("mass", "f8"), ("com", "f8", 3), ("inertia", "f8", (3, 3)), ("flags", "i8")])
# Flags of bodies. Gyroscopic forces always act.
RIGID_BODY_NONE, RIGID_BODY_DISABLE_GRAVITY, RIGID_BODY_DISABLE_SIMULATION = 0, 1, 2
RIGID_BODY_ENABLE_GYROSCOPIC_FORCES = 4


@dataclass
class RigidShapeProperties(Strict):
    """Surface properties of a shape.

    Attributes:
        friction: Where it slides; of two surfaces the larger one counts.
        rolling_friction: Against rolling [m], by XPBD alone.
        torsion_friction: Against spinning [m], by XPBD alone.
        restitution: Held, as are all that follow.
    """

    friction: float = 1.0
    rolling_friction: float = 0.0
    torsion_friction: float = 0.0
    restitution: float = 0.0
    compliance: float = 0.0
    thickness: float = 0.0
    filter: int = 0
    contact_offset: float = 0.02
    rest_offset: float = 0.0


@dataclass
class RigidBodyProperties(Strict):
    """Mass properties of a body.

    Attributes:
        mass: [kg].
        com: Its centre, in the body's frame [m].
        inertia: About the centre, along the axes of the body's frame [kg m^2].
        invMass: Given, never taken.
        invInertia: Given, never taken.
        flags: ``RIGID_BODY_DISABLE_GRAVITY``, or ``RIGID_BODY_NONE``.
    """

    mass: float = 0.0
    com: Vec3 = field(default_factory=Vec3)
    inertia: Mat33 = field(default_factory=Mat33)
    invMass: float = 0.0  # noqa: N815, that system's name
    invInertia: Mat33 = field(default_factory=Mat33)  # noqa: N815
    flags: int = 0


@dataclass
class ForceSensorProperties(Strict):
    """Properties of a force sensor.

    Attributes:
        enable_forward_dynamics_forces: Held: only contacts are felt.
        enable_constraint_solver_forces: Whether contacts are.
        use_world_frame: Whether numbers are along the world's axes, not the sensor's.
    """

    enable_forward_dynamics_forces: bool = True
    enable_constraint_solver_forces: bool = True
    use_world_frame: bool = False


@dataclass
class ActuatorProperties(Strict):
    """Properties of a motor of an MJCF file.

    Attributes:
        name: Its own.
        joint: Of what it moves.
        motor_effort: Its gear: force or torque of a control of 1.
        control_limited: Whether its control is limited, by ``lower_control_limit`` and ``upper_control_limit``.
        force_limited: Whether its force is, by ``lower_force_limit`` and ``upper_force_limit``.
        kp: Stiffness of a servo of places, else 0.
        kv: Damping of a servo of speeds, else 0.
    """

    name: str = ""
    joint: str = ""
    motor_effort: float = 1.0
    control_limited: bool = False
    lower_control_limit: float = 0.0
    upper_control_limit: float = 0.0
    force_limited: bool = False
    lower_force_limit: float = 0.0
    upper_force_limit: float = 0.0
    kp: float = 0.0
    kv: float = 0.0


@dataclass
class TendonProperties(Strict):
    """Properties of a tendon of an MJCF file. Held."""

    stiffness: float = 0.0
    damping: float = 0.0
    fixed_spring_rest_length: float = 0.0
    is_fixed_limited: bool = False
    fixed_lower_limit: float = 0.0
    fixed_upper_limit: float = 0.0
    limit_stiffness: float = 1.0


@dataclass(frozen=True)
class IndexRange:
    """Some that follow one another: the first of them, and how many."""

    start: int
    count: int


def surfaces_of(builder: newton.ModelBuilder) -> np.ndarray:
    """(shape,) of SURFACE."""
    rows = np.zeros(builder.shape_count, SURFACE)
    usual = RigidShapeProperties()
    for name in HELD:
        rows[name] = getattr(usual, name)
    for name, array in FRICTIONS.items():
        rows[name] = getattr(builder, array)
    rows["restitution"] = builder.shape_material_restitution
    return rows


def masses_of(builder: newton.ModelBuilder, weightless: bool) -> np.ndarray:
    """(body,) of MASS."""
    rows = np.zeros(builder.body_count, MASS)
    rows["flags"] = RIGID_BODY_DISABLE_GRAVITY if weightless else RIGID_BODY_NONE
    for body in range(len(rows)):
        rows["mass"][body] = builder.body_mass[body]
        rows["com"][body] = tuple(builder.body_com[body])
        rows["inertia"][body] = np.array(builder.body_inertia[body]).reshape(3, 3)
    return rows


def to_surfaces(rows: np.ndarray) -> list[RigidShapeProperties]:
    found = []
    for row in rows:
        values: dict[str, Any] = {name: float(row[name]) for name in FIELDS}
        found.append(RigidShapeProperties(**{**values, "filter": int(row["filter"])}))
    return found


def from_surfaces(values: Any, before: np.ndarray, solid: np.ndarray, where: str) -> np.ndarray:
    """(shape,) of SURFACE, as they were before but for those at the places of the values."""
    rows = before.copy()
    for place, value in zip(solid, listed(values, RigidShapeProperties, len(solid), where), strict=True):
        for name in FIELDS:
            number = real(getattr(value, name))
            if not np.isfinite(number) or (name in FRICTIONS and number < 0.0):
                raise WarpcamError(f"{where}: {name} must be finite, and no friction negative, got {number}")
            rows[name][place] = number
    return rows


def idle_changes(rows: np.ndarray, before: np.ndarray) -> list[str]:
    """Return a sentence for each changed value that has no effect, or none with MuJoCo."""
    reasons = dict.fromkeys(HELD, "is held and changes nothing") | dict.fromkeys(XPBD_ALONE, "counts by XPBD alone")
    return [f"{name} {reason}" for name, reason in reasons.items() if (rows[name] != before[name]).any()]


def to_masses(rows: np.ndarray) -> list[RigidBodyProperties]:
    found = []
    for row in rows:
        mass, inertia = float(row["mass"]), row["inertia"]
        singular = abs(np.linalg.det(inertia)) < 1e-30
        inverse = np.zeros((3, 3)) if singular else np.linalg.inv(inertia)
        found.append(
            RigidBodyProperties(
                mass,
                Vec3(*row["com"].tolist()),
                Mat33.of(inertia),
                1.0 / mass if mass > 0.0 else 0.0,
                Mat33.of(inverse),
                int(row["flags"]),
            )
        )
    return found


def from_masses(values: Any, before: np.ndarray, recompute: bool, where: str) -> np.ndarray:
    """(body,) of MASS.

    Args:
        values: RigidBodyProperties of each.
        before: What there was.
        recompute: Whether inertia follows the mass, instead of what is given.
        where: The call.
    """
    rows = before.copy()
    for row, value in zip(rows, listed(values, RigidBodyProperties, len(before), where), strict=True):
        for name, kind in (("com", Vec3), ("inertia", Mat33)):
            if not isinstance(getattr(value, name), kind):
                came = type(getattr(value, name)).__name__
                raise WarpcamError(f"{where}: {name} must be a {kind.__name__}, got {came}")
        mass = real(value.mass)
        if not 0.0 <= mass < np.inf:
            raise WarpcamError(f"{where}: mass must be finite and not negative, got {value.mass!r}")
        flags = whole(value.flags)
        if flags is None or flags & ~(RIGID_BODY_DISABLE_GRAVITY | RIGID_BODY_ENABLE_GYROSCOPIC_FORCES):
            raise WarpcamError(
                f"{where}: flags {value.flags!r} came; of the flags RIGID_BODY_DISABLE_GRAVITY and "
                "RIGID_BODY_ENABLE_GYROSCOPIC_FORCES may be set"
            )
        row["flags"] = flags
        if recompute:
            row["inertia"] *= mass / row["mass"] if row["mass"] > 0.0 else 1.0
        else:
            row["inertia"] = value.inertia.numbers()
        row["mass"], row["com"] = mass, tuple(value.com)
        if not np.isfinite(row["inertia"]).all() or not np.isfinite(row["com"]).all():
            raise WarpcamError(f"{where}: com and inertia must be finite, got {value!r}")
    return rows


def listed(values: Any, kind: type, count: int, where: str) -> Sequence[Any]:
    if not isinstance(values, Sequence) or len(values) != count or not all(isinstance(each, kind) for each in values):
        raise WarpcamError(f"{where}: a list of {count} {kind.__name__} is needed, got {values!r}")
    return values
