"""Cameras for thousands of robot-simulation worlds at once, with no graphics stack."""

from collections.abc import Collection as _Collection
from importlib import import_module as _import_module
from importlib.metadata import PackageNotFoundError as _PackageNotFoundError
from importlib.metadata import version as _version
from typing import Any as _Any

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.lens import Lens, Orthographic, Pinhole
from warpcam.memory import Memory, estimate_memory
from warpcam.renderer import Renderer
from warpcam.scene import Scene

try:
    __version__ = _version("warpcam")
except _PackageNotFoundError:  # run from its sources
    __version__ = "0+unknown"

__all__ = [
    "Camera",
    "Lens",
    "Memory",
    "Orthographic",
    "Pinhole",
    "Renderer",
    "Scene",
    "WarpcamError",
    "estimate_memory",
    "from_mujoco",
    "from_mujoco_warp",
]


def from_mujoco_warp(mjm: _Any, m: _Any, d: _Any, *, groups: _Collection[int] = (0, 1, 2)) -> Scene:
    """The worlds of a MuJoCo-Warp simulation, read where they lie: nothing that changes is copied.

    What a world may change in ``m`` and ``d`` is seen at the next render: poses, sizes, colours, materials, lights,
    cameras, which mesh a geom shows. Meshes, height fields, textures and the headlight are read once.

    Args:
        mjm: The host's ``mujoco.MjModel``.
        m: The ``mujoco_warp.Model`` put from it.
        d: The ``mujoco_warp.Data``; its device is the scene's.
        groups: Geom groups that are drawn.
    """
    scene: Scene = _source("mujoco_warp").load(mjm, m, d, groups)
    return scene


def from_mujoco(mjm: _Any, mjd: _Any, *, groups: _Collection[int] = (0, 1, 2), device: _Any = None) -> Scene:
    """Worlds of classic MuJoCo, copied to the device before each frame.

    Args:
        mjm: The ``mujoco.MjModel``. What changes in it is seen at the next render, but for meshes, height fields and
            textures, which are read once.
        mjd: A ``mujoco.MjData``, or a list with one for each world.
        groups: Geom groups that are drawn.
        device: Where to render: a name, a Warp or torch device, a CUDA ordinal; None is Warp's current device.
    """
    scene: Scene = _source("mujoco").load(mjm, mjd, groups, device)
    return scene


def _source(name: str) -> _Any:
    """The module that reads one simulator, imported only now: the simulator need not be installed otherwise."""
    try:
        return _import_module(f"warpcam.sources.{name}")
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and this scene needs it: pip install 'warpcam[mujoco]'"
        ) from error
