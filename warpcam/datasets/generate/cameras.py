"""Cameras of a data set: those of the scene, one that sees all of it, or ones on shells around it."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

import warpcam
from warpcam.core.errors import WarpcamError
from warpcam.core.rotations import rotation_quaternions
from warpcam.datasets.generate.plan import Plan
from warpcam.datasets.generate.random_numbers import generator
from warpcam.datasets.generate.recipes import CameraRecipe, Shell
from warpcam.sources.mujoco import batch_file

FREE_CAMERA = "free"
FOVY = 45.0  # of a camera of one's own, unless the recipe says otherwise [degrees]


def choose_cameras(plan: Plan, scene: warpcam.Scene) -> dict[str, tuple[str | int | None, CameraRecipe]]:
    """The scene's key, None for one of its own, and the recipe of each camera, by name."""
    known, recipes = list(scene.cameras), plan.recipes.cameras
    if recipes is None:
        names = plan.cameras or tuple(name or str(index) for index, name in enumerate(known)) or (FREE_CAMERA,)
        chosen = {name: CameraRecipe() for name in names}
    else:
        chosen = dict(recipes)
        missing = [name for name in plan.cameras or () if name not in chosen]
        if missing:
            raise WarpcamError(f"--camera: {missing[0]!r} came, the recipes have {', '.join(chosen)}")
        chosen = {name: chosen[name] for name in plan.cameras or chosen}
    found: dict[str, tuple[str | int | None, CameraRecipe]] = {}
    for name, recipe in chosen.items():
        if recipe.shell is not None or (name == FREE_CAMERA and name not in known):
            found[name] = None, recipe
        elif name in known:
            found[name] = name, recipe
        elif name.isdecimal() and int(name) < len(known):
            found[name] = int(name), recipe
        else:
            has = ", ".join(map(repr, known)) or "none"
            raise WarpcamError(f"cameras: {name!r} came without a shell, the cameras of the scene are: {has}")
    files: dict[str, str] = {}
    for name in found:
        if (other := files.setdefault(file_name(name), name)) != name:
            raise WarpcamError(f"cameras: files of {other!r} and {name!r} would have the same names; leave one away")
    for name, _ in plan.recipes.sensors:
        if name not in found:
            raise WarpcamError(f"sensors: {name!r} is none of the cameras, which are {', '.join(found)}")
    return found


def make_camera(
    plan: Plan, scene: warpcam.Scene, host: Any, name: str, key: str | int | None, recipe: CameraRecipe, outputs: Any
) -> warpcam.Camera:
    """Camera of a renderer; what differs by sample has room for each world."""
    options: dict[str, Any] = {}
    worlds = plan.worlds
    if recipe.exposure is not None or recipe.gain is not None:
        options["exposure"] = 0.0
    if plan.recipes.backgrounds is not None:
        options["background"] = (0.0, 0.0, 0.0)
    if key is None and recipe.shell is None:
        options |= batch_file.free_camera(host, *scene.bounds(), plan.width / plan.height)
    elif key is None:
        options |= {"position": np.zeros((worlds, 3)), "rotation": np.tile((1.0, 0.0, 0.0, 0.0), (worlds, 1))}
    if recipe.fovy is not None or recipe.shell is not None:
        options["lens"] = warpcam.Pinhole(fovy=np.full(worlds, FOVY if recipe.fovy is None else recipe.fovy[0]))
    return warpcam.Camera(
        name if key is None else key,
        width=plan.width,
        height=plan.height,
        outputs=outputs,
        shadows=True,
        antialiasing=plan.antialiasing,
        **options,
    )


def shell_poses(
    plan: Plan, name: str, shell: Shell, middle: np.ndarray, samples: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (sample, 3) [m] and rotations (sample, 4) w x y z of a camera on a shell, float32."""
    target = middle if shell.target is None else np.array(shell.target)
    drawn = np.empty((len(samples), 7))
    for place, sample in enumerate(samples):
        random = generator(plan.seed, sample, f"camera {name}")
        radius = random.uniform(*shell.radius)
        # Elevations as a sphere's area has them.
        sine = random.uniform(*np.sin(np.radians(shell.elevation)))
        drawn[place, :4] = radius, sine, random.uniform(*shell.azimuth), random.uniform(*shell.roll)
        drawn[place, 4:] = random.uniform(-1.0, 1.0, 3)
    (radius, sine), (azimuth, roll) = drawn[:, :2].T, np.radians(drawn[:, 2:4].T)
    level, nothing = np.sqrt(1.0 - sine * sine), np.zeros(len(samples))
    backward = np.stack((level * np.cos(azimuth), level * np.sin(azimuth), sine), axis=1)
    right = np.stack((-np.sin(azimuth), np.cos(azimuth), nothing), axis=1)
    turned = np.cos(roll)[:, None] * right + np.sin(roll)[:, None] * np.cross(backward, right)
    positions = target + drawn[:, 4:] * shell.spread + radius[:, None] * backward
    matrices = np.stack((turned, np.cross(backward, turned), backward), axis=2)
    quaternions = rotation_quaternions(matrices)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return positions.astype(np.float32), quaternions.astype(np.float32)


def fields_of_view(plan: Plan, name: str, span: tuple[float, float], samples: Sequence[int]) -> np.ndarray:
    """Vertical fields of view [degrees], (sample,) float32."""
    draws = [generator(plan.seed, sample, f"fovy {name}").uniform(*span) for sample in samples]
    return np.array(draws, np.float32)


def file_name(camera: str) -> str:
    """Plain part of a file name."""
    return re.sub(r"[^\w.-]+", "_", camera).strip("_") or "camera"
