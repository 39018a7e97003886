"""The scenes that are measured, as data. Every scene comes from a wheel that is installed beside warpcam."""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np


@dataclass(frozen=True)
class Case:
    """One scene and the cameras that look at it."""

    name: str
    about: str
    spec: Callable[[], mujoco.MjSpec]
    cameras: tuple[str, ...]
    worlds: int = 8192  # on a GPU
    cpu_worlds: int = 64
    # How far free bodies are moved from where the scene has them: up to this along each axis [m], and turned up to
    # this about each [rad].
    scatter: tuple[float, float] = (0.05, 0.5)


def package_folder(package: str) -> Path:
    """Where a package's files are, found without importing it: its own needs may be missing."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        raise FileNotFoundError(f"the scene comes with the package {package}, which is not installed")
    return Path(found.origin).parent


def from_mujoco_warp(file: str) -> Callable[[], mujoco.MjSpec]:
    return lambda: mujoco.MjSpec.from_file(str(package_folder("mujoco_warp") / "test_data" / file))


def from_mjlab(file: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(package_folder("mjlab") / "asset_zoo" / "robots" / file))


def look_at(spec: mujoco.MjSpec, position: tuple[float, float, float], target: tuple[float, float, float]) -> None:
    """Add a fixed camera `fixed` at `position` [m] that has `target` [m] in its centre and z upwards."""
    backward = np.subtract(position, target)
    backward /= np.linalg.norm(backward)
    right = np.cross((0.0, 0.0, 1.0), backward)
    right /= np.linalg.norm(right)
    rotation = np.column_stack((right, np.cross(backward, right), backward))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    spec.worldbody.add_camera(name="fixed", pos=position, quat=quaternion, fovy=45.0)


def smooth_terrain(samples: int, seed: int) -> np.ndarray:
    """Random hills and bumps, (samples, samples) float64 in [0, 1], flat where a robot stands in the middle."""
    random = np.random.default_rng(seed)
    x = np.linspace(-1.0, 1.0, samples)
    x, y = np.meshgrid(x, x)
    height = np.zeros_like(x)
    for wave in range(48):
        frequency = 2.0 * 1.08**wave
        angle, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        height += np.sin(frequency * (x * np.cos(angle) + y * np.sin(angle)) + phase) / frequency
    height = (height - height.min()) / (height.max() - height.min())
    flat = np.exp(-np.square((x**2 + y**2) / 0.08**2))
    return height * (1.0 - flat) + height.mean() * flat


def g1_on_terrain() -> mujoco.MjSpec:
    """Unitree G1 on a height field of 20 m x 20 m with 128 x 128 samples."""
    spec = from_mjlab("unitree_g1/xmls/g1.xml")
    height = smooth_terrain(128, seed=0)
    spec.add_hfield(name="terrain", size=[10.0, 10.0, 1.5, 0.1], nrow=128, ncol=128, userdata=height.ravel())
    ground = -1.5 * (height[64, 64] - height.min()) / (height.max() - height.min())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="terrain", pos=[0.0, 0.0, ground])
    look_at(spec, (1.7, -1.1, 1.1), (0.0, 0.0, 0.65))
    return spec


def yam_arm() -> mujoco.MjSpec:
    """I2RT YAM arm alone, without ground."""
    spec = from_mjlab("i2rt_yam/xmls/yam.xml")
    look_at(spec, (0.9, -0.7, 0.6), (0.1, 0.0, 0.27))
    return spec


ALOHA_CAMERAS = ("overhead_cam", "worms_eye_cam", "wrist_cam_left", "wrist_cam_right")

CASES = {
    case.name: case
    for case in (
        Case(
            "primitives",
            "125 free bodies scattered over a table",
            from_mujoco_warp("primitives.xml"),
            ("camera0",),
            scatter=(0.3, 3.0),
        ),
        Case(
            "primitives_rows", "125 free bodies in rows over a table", from_mujoco_warp("primitives.xml"), ("camera0",)
        ),
        Case("humanoid", "capsules on a plane", from_mujoco_warp("humanoid/humanoid.xml"), ("side",)),
        Case("yam", "robot arm of 18 meshes, 105 thousand faces", yam_arm, ("fixed",), cpu_worlds=16),
        Case("g1_terrain", "robot of 35 meshes on a height field", g1_on_terrain, ("fixed",), cpu_worlds=16),
        Case(
            "aloha_pot",
            "two arms at a table, seen by four cameras",
            from_mujoco_warp("aloha_pot/scene.xml"),
            ALOHA_CAMERAS,
            worlds=2048,
            cpu_worlds=4,
        ),
    )
}


def compile_case(case: Case) -> mujoco.MjModel:
    """The compiled model; cameras without a name are called camera0, camera1, ... by their index."""
    spec = case.spec()
    for index, camera in enumerate(spec.cameras):
        camera.name = camera.name or f"camera{index}"
    return spec.compile()
