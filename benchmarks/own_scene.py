"""A scene of anyone's as a case of the benchmark, from an MJCF, URDF or USD file."""

from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from warpcam.benchmarks.cases import Case
from warpcam.benchmarks.scenes import facing
from warpcam.core.errors import WarpcamError
from warpcam.core.file_access import FileAccess
from warpcam.sources.common.formats import USD
from warpcam.sources.mujoco import mjcf_files, urdf

ADDED = "whole scene"  # camera of a scene that has none
AWAY = np.array((0.55, -0.75, 0.55))  # direction from the middle of a scene to that camera
FOVY = 45.0  # [degrees]
SWAY = 0.02  # of a scene's radius, how far the camera moves along each axis where nothing else does


def case_of(path: Path, camera: str | None) -> Case:
    """The case of a file, seen by the camera of this name, else its first, else one that sees all of it."""
    _, name = prepared(path, camera)
    about = f"{path.name}, seen by {name}"
    return Case(path.stem, about, partial(spec_of, path, camera), (name,), cpu_worlds=4, keyframe=True)


def spec_of(path: Path, camera: str | None) -> mujoco.MjSpec:
    return prepared(path, camera)[0]


def prepared(path: Path, camera: str | None) -> tuple[mujoco.MjSpec, str]:
    """The scene of a file, and the name of the camera that looks at it: one that moves where nothing else does.

    Else every frame would be the one before.
    """
    spec = read(path)
    for index, item in enumerate(spec.cameras):
        item.name = item.name or f"camera{index}"
    names = [item.name for item in spec.cameras]
    if camera is not None and camera not in names:
        known = ", ".join(names) or f"none: leave it out, and {ADDED!r} is added"
        raise WarpcamError(f"--camera: {camera!r} came, {path.name} has {known}")
    try:
        model = spec.compile()
    except ValueError as error:
        raise refused(path, error) from None
    name = camera or (names[0] if names else ADDED)
    moves = model.nv > 0
    if names and moves:
        return spec, name
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    lower, upper = bounds(model, data)
    middle, radius = 0.5 * (lower + upper), max(0.5 * float(np.linalg.norm(upper - lower)), 1e-3)
    if names:
        index, quaternion = model.camera(name).id, np.empty(4)
        position, fovy = data.cam_xpos[index], float(model.cam_fovy[index])
        mujoco.mju_mat2Quat(quaternion, data.cam_xmat[index])
        name = f"{name}, swaying"
    else:
        position, fovy = middle + AWAY / np.linalg.norm(AWAY) * radius / np.sin(np.radians(0.5 * FOVY)), FOVY
        quaternion = facing(tuple(position), tuple(middle))
    body = spec.worldbody.add_body(pos=position, mass=1.0, inertia=(1.0, 1.0, 1.0), explicitinertial=True)
    if not moves:
        for axis in np.eye(3):
            reach = 2.0 * SWAY * radius
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, range=(-reach, reach), limited=True)
    body.add_camera(name=name, quat=quaternion, fovy=fovy)
    return spec, name


def read(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise WarpcamError(f"--scene: there is no file {str(path)!r}")
    kind = path.suffix.lower()
    if kind in USD:
        from warpcam.benchmarks import usd_scene

        return usd_scene.read(path)
    if kind not in (".xml", ".urdf"):
        raise WarpcamError(f"--scene: {str(path)!r} came; known are .xml, .urdf, {', '.join(USD)}")
    try:
        own = FileAccess(path, trusted=True)  # a scene of one's own
        return (urdf.load_spec if kind == ".urdf" else mjcf_files.read_spec)(path, own)
    except ValueError as error:
        raise refused(path, error) from None


def refused(path: Path, error: ValueError) -> WarpcamError:
    return WarpcamError(f"--scene: MuJoCo cannot read {str(path)!r}: {' '.join(str(error).split())}")


def bounds(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box around all drawn geoms but planes [m]; of 1 m around the origin where there are none."""
    solid = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_group <= 2)
    if not solid.any():
        return np.full(3, -1.0), np.full(3, 1.0)
    center, reach = data.geom_xpos[solid], model.geom_rbound[solid, None]
    return (center - reach).min(axis=0), (center + reach).max(axis=0)
