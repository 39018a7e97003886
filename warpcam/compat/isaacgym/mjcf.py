"""What MuJoCo's files say beside bodies and joints: motors and tendons."""

from pathlib import Path
from typing import Any

import numpy as np

from warpcam.compat.isaacgym.properties import ActuatorProperties, TendonProperties
from warpcam.errors import WarpcamError


def motors_of(path: Path | None) -> list[ActuatorProperties]:
    """In the file's order; none of other files."""
    model = _read(path, "get_asset_actuator_properties")
    return [] if model is None else [_motor(model, index) for index in range(model.nu)]


def tendons_of(path: Path | None) -> list[tuple[str, TendonProperties]]:
    """Names and properties, in the file's order; none of other files, or of one that MuJoCo cannot read."""
    try:
        model = _read(path, "load_asset")
    except WarpcamError:
        return []
    return [] if model is None else [_tendon(model, index) for index in range(model.ntendon)]


def _read(path: Path | None, where: str) -> Any:
    if path is None or path.suffix.lower() not in (".xml", ".mjcf"):
        return None
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise WarpcamError(f"{where}: {str(path)!r} cannot be read: {error}") from error


def _motor(model: Any, index: int) -> ActuatorProperties:
    import mujoco

    joint, moved = "", int(model.actuator_trnid[index, 0])
    if int(model.actuator_trntype[index]) in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)):
        joint = model.joint(moved).name
    control, force = model.actuator_ctrlrange[index], model.actuator_forcerange[index]
    affine = model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE
    bias = model.actuator_biasprm[index] if affine else np.zeros(3)
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


def _tendon(model: Any, index: int) -> tuple[str, TendonProperties]:
    lower, upper = (float(value) for value in model.tendon_range[index])
    return model.tendon(index).name, TendonProperties(
        stiffness=float(model.tendon_stiffness[index]),
        damping=float(model.tendon_damping[index]),
        fixed_spring_rest_length=float(model.tendon_lengthspring[index, 0]),
        is_fixed_limited=bool(model.tendon_limited[index]),
        fixed_lower_limit=lower,
        fixed_upper_limit=upper,
    )
