"""Writers of joints', surfaces' and masses' properties into the model that is simulated."""

from collections.abc import Sequence
from typing import Any

import newton
import numpy as np

from warpcam.compat.isaacgym.api.enums import DofDriveMode
from warpcam.compat.isaacgym.api.property_types import FRICTIONS, RIGID_BODY_DISABLE_GRAVITY
from warpcam.compat.isaacgym.physics.environments import Actor, Counts, Spot

MODES = {
    DofDriveMode.DOF_MODE_NONE: newton.JointTargetMode.NONE,
    DofDriveMode.DOF_MODE_POS: newton.JointTargetMode.POSITION,
    DofDriveMode.DOF_MODE_VEL: newton.JointTargetMode.VELOCITY,
    DofDriveMode.DOF_MODE_EFFORT: newton.JointTargetMode.EFFORT,
}
# Gains by mode, as that system has them: a speed is driven by its damping alone.
STIFF, DAMPED = (DofDriveMode.DOF_MODE_POS,), (DofDriveMode.DOF_MODE_POS, DofDriveMode.DOF_MODE_VEL)


# Bits of newton.ModelFlags: what a solver has to be told. It may lose the contacts of the last step by that, so it is
# told when the next one begins.
NOTHING = 0


def write_drives(model: newton.Model, speeds: np.ndarray, actors: Sequence[Actor]) -> int:
    """Limits, drives and gains of all joints.

    Args:
        model: What is simulated.
        speeds: (dof,) places among the model's joint velocities.
        actors: All of them.
    """
    if not len(speeds):
        return NOTHING
    rows = np.concatenate([actor.properties for actor in actors])
    modes = rows["driveMode"]
    for array, values in (
        (model.joint_limit_lower, rows["lower"]),
        (model.joint_limit_upper, rows["upper"]),
        (model.joint_target_ke, np.where(np.isin(modes, STIFF), rows["stiffness"], 0.0)),
        (model.joint_target_kd, np.where(np.isin(modes, DAMPED), rows["damping"], 0.0)),
        (model.joint_velocity_limit, rows["velocity"]),
        (model.joint_effort_limit, rows["effort"]),
        (model.joint_friction, rows["friction"]),
        (model.joint_armature, rows["armature"]),
        (model.joint_target_mode, np.array([int(MODES[DofDriveMode(mode)]) for mode in modes])),
    ):
        host = array.numpy()
        host[speeds] = values
        array.assign(host)
    return int(newton.ModelFlags.JOINT_DOF_PROPERTIES)


def write_surfaces(model: newton.Model, spot: Spot, starts: Sequence[tuple[Actor, Counts]]) -> int:
    """Frictions of the shapes of actors that have others than their assets."""
    changed = [pair for pair in starts if pair[0].surfaces is not pair[0].asset.first_surfaces]
    if not changed:
        return NOTHING
    in_model = np.flatnonzero(spot.shapes >= 0)
    places = in_model[np.argsort(spot.shapes[in_model])]
    for name, field in FRICTIONS.items():
        array = getattr(model, field)
        host = array.numpy()
        for actor, start in changed:
            host[places[start.shapes : start.shapes + len(actor.surfaces)]] = actor.surfaces[name]
        array.assign(host)
    return int(newton.ModelFlags.SHAPE_PROPERTIES)


def weightless(starts: Sequence[tuple[Actor, Counts]]) -> list[int]:
    """Bodies that gravity passes over."""
    return [
        start.bodies + int(body)
        for actor, start in starts
        for body in np.flatnonzero(actor.masses["flags"] & RIGID_BODY_DISABLE_GRAVITY)
    ]


def write_masses(model: newton.Model, starts: Sequence[tuple[Actor, Counts]]) -> int:
    """Masses, centres and inertias of the bodies of actors that have others than their assets."""
    changed = [pair for pair in starts if pair[0].masses is not pair[0].asset.masses]
    if not changed:
        return NOTHING
    mass, com, inertia = model.body_mass.numpy(), model.body_com.numpy(), model.body_inertia.numpy()
    for actor, start in changed:
        rows = slice(start.bodies, start.bodies + len(actor.masses))
        mass[rows], com[rows], inertia[rows] = (actor.masses[name] for name in ("mass", "com", "inertia"))
    fine = inertia.astype(np.float64)
    regular = (np.abs(np.linalg.det(fine)) > 0.0)[:, None, None]
    back = np.where(regular, np.linalg.inv(np.where(regular, fine, np.eye(3))), 0.0)
    rate = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)
    for array, values in (
        (model.body_mass, mass),
        (model.body_com, com),
        (model.body_inertia, inertia),
        (model.body_inv_mass, rate),
        (model.body_inv_inertia, back.astype(np.float32)),
    ):
        array.assign(values)
    return int(newton.ModelFlags.BODY_INERTIAL_PROPERTIES)


def tell(solver: Any, changes: int) -> None:
    """Let Newton's solver know."""
    if not changes:
        return
    solver.notify_model_changed(changes)
    if changes & newton.ModelFlags.SHAPE_PROPERTIES and getattr(solver, "use_mujoco_cpu", False):
        solver.mj_model.geom_friction[:] = solver.mjw_model.geom_friction.numpy()[0]  # Newton does not tell MuJoCo
