"""Scenes whose files come with other packages, and what is added to them: cameras, floors, lights."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np

from warpcam.core.errors import WarpcamError

Point = tuple[float, float, float]
GEOM = mujoco.mjtGeom


def package_folder(package: str) -> Path:
    """Return the folder of a package's files without importing it: its own needs may be missing."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        raise WarpcamError(f"--case: its files come with the package {package}; pip install --no-deps {package}")
    return Path(found.origin).parent


def from_mujoco_warp(file: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(package_folder("mujoco_warp") / "test_data" / file))


def from_mjlab(file: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(package_folder("mjlab") / "asset_zoo" / "robots" / file))


def facing(position: Point, target: Point) -> np.ndarray:
    """Quaternion wxyz of a camera at `position` [m] that has `target` [m] in its centre and z upwards."""
    backward = np.subtract(position, target)
    backward /= np.linalg.norm(backward)
    right = np.cross((0.0, 0.0, 1.0), backward)
    right /= np.linalg.norm(right)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.column_stack((right, np.cross(backward, right), backward)).ravel())
    return quaternion


def look_at(spec: mujoco.MjSpec, position: Point, target: Point) -> None:
    """Add a camera `fixed` that stays where it is."""
    spec.worldbody.add_camera(name="fixed", pos=position, quat=facing(position, target), fovy=45.0)


def add_sun(spec: mujoco.MjSpec, direction: Point = (-0.4, 0.3, -1.0)) -> None:
    """Add a light from far away that casts shadows."""
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(type=sun, pos=(2.0, -1.5, 5.0), dir=direction, diffuse=(0.6, 0.6, 0.6), castshadow=True)


def add_checkered(spec: mujoco.MjSpec, name: str, first: Point, second: Point, repeat: float) -> str:
    """Add a material of squares, `repeat` of them a metre on a plane; returns its name."""
    checker = mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    flat = mujoco.mjtTexture.mjTEXTURE_2D
    spec.add_texture(name=name, type=flat, builtin=checker, rgb1=first, rgb2=second, width=256, height=256)
    material = spec.add_material(name=name, texuniform=True, texrepeat=(repeat, repeat))
    material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
    return name


def add_floor(spec: mujoco.MjSpec) -> None:
    """Add a plane of 40 m x 40 m with a texture: the renderers do not agree where an infinite one ends."""
    squares = add_checkered(spec, "floor", (0.25, 0.3, 0.35), (0.45, 0.5, 0.55), 1.0)
    spec.worldbody.add_geom(type=GEOM.mjGEOM_PLANE, size=(20.0, 20.0, 1.0), material=squares)


def hills(samples: int, seed: int) -> np.ndarray:
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


def add_hills(spec: mujoco.MjSpec, samples: int, seed: int) -> None:
    """Add a height field of 20 m x 20 m, its flat middle at height 0."""
    height = hills(samples, seed)
    spec.add_hfield(name="hills", size=[10.0, 10.0, 1.5, 0.1], nrow=samples, ncol=samples, userdata=height.ravel())
    middle = height[samples // 2, samples // 2]
    ground = -1.5 * (middle - height.min()) / (height.max() - height.min())
    grass = add_checkered(spec, "grass", (0.3, 0.42, 0.25), (0.4, 0.5, 0.3), 1.0)
    spec.worldbody.add_geom(type=GEOM.mjGEOM_HFIELD, hfieldname="hills", pos=[0.0, 0.0, ground], material=grass)


def g1_on_terrain() -> mujoco.MjSpec:
    """Unitree G1 on a height field of 127 x 127 cells."""
    spec = from_mjlab("unitree_g1/xmls/g1.xml")
    add_hills(spec, 128, seed=0)
    add_sun(spec)
    look_at(spec, (1.7, -1.1, 1.1), (0.0, 0.0, 0.65))
    return spec


def go1_on_plane() -> mujoco.MjSpec:
    """Unitree Go1 on a plane."""
    spec = from_mjlab("unitree_go1/xmls/go1.xml")
    add_floor(spec)
    look_at(spec, (1.0, -0.9, 0.6), (0.0, 0.0, 0.25))
    return spec


def yam_arm() -> mujoco.MjSpec:
    """I2RT YAM arm alone, without ground."""
    spec = from_mjlab("i2rt_yam/xmls/yam.xml")
    look_at(spec, (0.9, -0.7, 0.6), (0.1, 0.0, 0.27))
    return spec
