"""What MuJoCo's files say beside bodies and joints: motors and tendons."""

import re
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from warpcam.compat.isaacgym.api.property_types import ActuatorProperties, TendonProperties
from warpcam.core.errors import WarpcamError

APIRATE = re.compile(r"""\sapirate=["'][^"']*["']""")
INCLUDE = re.compile(r"""<include\s+file=["']([^"']+)["']""")


class MjcfDetails:
    """Of one file, which is read when they are first asked for: MuJoCo makes a whole model of it.

    Args:
        path: Of any file, or None. Those that are no MJCF have none.
    """

    def __init__(self, path: Path | None):
        self._path = path

    @property
    def motors(self) -> list[ActuatorProperties]:
        """In the file's order."""
        return self._both[0]

    @property
    def tendons(self) -> list[tuple[str, TendonProperties]]:
        """Names and properties, in the file's order."""
        return self._both[1]

    @cached_property
    def _both(self) -> tuple[list[ActuatorProperties], list[tuple[str, TendonProperties]]]:
        path = self._path
        if path is None or path.suffix.lower() not in (".xml", ".mjcf"):
            return [], []

        try:
            spec = _spec(path)
            known = {material.name for material in spec.materials}
            for drawn in (*spec.geoms, *spec.sites):
                if drawn.material not in known:  # which Isaac Gym passes over, MuJoCo does not
                    drawn.material = ""
            model = spec.compile()
        except (ValueError, OSError) as error:
            raise WarpcamError(f"motors and tendons: {str(path)!r} cannot be read: {error}") from error
        return [_motor(model, row) for row in range(model.nu)], [_tendon(model, row) for row in range(model.ntendon)]


def _spec(path: Path) -> Any:
    """MuJoCo's description of a file, also of one that was written before ``apirate`` was no option any more."""
    import mujoco

    text = path.read_text(encoding="utf-8", errors="replace")
    if not APIRATE.search(text):
        return mujoco.MjSpec.from_file(str(path))
    included: dict[str, bytes] = {}
    waiting = INCLUDE.findall(text)
    while waiting:
        name = waiting.pop()
        if name not in included and (path.parent / name).is_file():  # else it is in a comment, or MuJoCo says so
            included[name] = (path.parent / name).read_bytes()
            waiting += INCLUDE.findall(included[name].decode(errors="replace"))
    spec = mujoco.MjSpec.from_string(APIRATE.sub("", text), include=included)
    spec.modelfiledir = str(path.parent)
    return spec


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
