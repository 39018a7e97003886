"""A scene of anyone's as a case of the benchmark, from an MJCF or URDF file."""

from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from warpcam.benchmarks.cases import Case
from warpcam.benchmarks.scenes import facing
from warpcam.core.errors import WarpcamError
from warpcam.sources.mujoco import urdf

ADDED = "whole scene"  # camera of a scene that has none
AWAY = np.array((0.55, -0.75, 0.55))  # direction from the middle of a scene to that camera
FOVY = 45.0  # [degrees]
SWAY = 0.02  # of a scene's radius, how far that camera moves along each axis where nothing else does


def case_of(path: Path, camera: str | None) -> Case:
    """The case of a file, seen by the camera of this name, else its first, else one that sees all of it."""
    spec = read(path)
    names = [item.name or f"camera{index}" for index, item in enumerate(spec.cameras)]
    if camera is not None and camera not in names:
        known = ", ".join(names) or f"none: leave it out, and {ADDED!r} is added"
        raise WarpcamError(f"--camera: {camera!r} came, {path.name} has {known}")
    name = camera or (names[0] if names else ADDED)
    about = f"{path.name}, seen by {name}"
    return Case(path.stem, about, partial(with_camera, path), (name,), cpu_worlds=4, keyframe=True)


def read(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise WarpcamError(f"--scene: there is no file {str(path)!r}")
    kind = path.suffix.lower()
    if kind not in (".xml", ".urdf"):
        raise WarpcamError(f"--scene: {str(path)!r} came; known are .xml and .urdf")
    try:
        return urdf.load_spec(path) if kind == ".urdf" else mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise WarpcamError(f"--scene: MuJoCo cannot read {str(path)!r}: {' '.join(str(error).split())}") from None


def with_camera(path: Path) -> mujoco.MjSpec:
    """The scene of a file, with a camera that sees all of it if it has none."""
    spec = read(path)
    if not spec.cameras:
        model = spec.compile()
        lower, upper = bounds(model)
        middle, radius = 0.5 * (lower + upper), max(0.5 * float(np.linalg.norm(upper - lower)), 1e-3)
        position = middle + AWAY / np.linalg.norm(AWAY) * radius / np.sin(np.radians(0.5 * FOVY))
        body = spec.worldbody.add_body(pos=position, mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
        if model.nv == 0:  # else every frame would be the one before
            for axis in np.eye(3):
                reach = 2.0 * SWAY * radius
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, range=(-reach, reach), limited=True)
        body.add_camera(name=ADDED, quat=facing(tuple(position), tuple(middle)), fovy=FOVY)
    return spec


def bounds(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box around all drawn geoms but planes [m]; of 1 m around the origin where there are none."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    solid = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_group <= 2)
    if not solid.any():
        return np.full(3, -1.0), np.full(3, 1.0)
    center, reach = data.geom_xpos[solid], model.geom_rbound[solid, None]
    return (center - reach).min(axis=0), (center + reach).max(axis=0)
