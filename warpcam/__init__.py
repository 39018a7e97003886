"""Cameras for thousands of robot-simulation worlds at once, with no graphics stack."""

from collections.abc import Collection as _Collection
from collections.abc import Sequence as _Sequence
from importlib import import_module as _import_module
from importlib.metadata import PackageNotFoundError as _PackageNotFoundError
from importlib.metadata import version as _version
from typing import Any as _Any

from warpcam.camera import Camera
from warpcam.errors import WarpcamError
from warpcam.lens import Lens, Orthographic, Pinhole
from warpcam.light import Light
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
    "Light",
    "Memory",
    "Orthographic",
    "Pinhole",
    "Renderer",
    "Scene",
    "WarpcamError",
    "estimate_memory",
    "from_mujoco",
    "from_mujoco_warp",
    "from_newton",
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


def from_newton(
    model: _Any, state: _Any, *, lights: _Sequence[Light] | None = None, ambient: _Any = (0.2, 0.2, 0.2)
) -> Scene:
    """The worlds of a Newton simulation, whichever solver moves it, read where they lie.

    What changes in the state and in the model's ``shape_transform``, ``shape_scale``, ``shape_color``,
    ``shape_opacity`` and ``shape_flags`` is seen at the next render; types, meshes, height fields and textures are read
    once. A solver that goes back and forth between two states needs ``scene.bind(state)`` before the next render.

    ``segmentation`` gives Newton's shape index, ``bodies`` its body index. A camera's parent is a body's label or
    index; in every world the camera rides on the body of that name.

    Args:
        model: A ``newton.Model``; its device is the scene's.
        state: A ``newton.State`` of it.
        lights: Newton has none of its own. None is one from above, as in Newton's own renderer. What a world may change
            lies in ``scene.array("light_directions")`` and the like, (world, light).
        ambient: (3,) light that is everywhere.
    """
    scene: Scene = _source("newton").load(model, state, lights, ambient)
    return scene


def _source(name: str) -> _Any:
    """The module that reads one simulator, imported only now: the simulator need not be installed otherwise."""
    try:
        return _import_module(f"warpcam.sources.{name}")
    except ModuleNotFoundError as error:
        extra = "newton" if name == "newton" else "mujoco"
        raise WarpcamError(
            f"{error.name} is not installed, and this scene needs it: pip install 'warpcam[{extra}]'"
        ) from error
