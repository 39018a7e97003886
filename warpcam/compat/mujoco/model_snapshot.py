"""A MuJoCo model as it was when a state was taken: what is written to it afterwards is not seen."""

import copy
from typing import Any

import mujoco
import numpy as np

from warpcam.compat.mujoco.frame_renderer import VIS_COLORS
from warpcam.compat.mujoco.model_variants import FOLLOWED

ASSETS = ("mesh_", "hfield_", "tex_", "skin_")  # how arrays begin that a renderer reads once, or when they are uploaded
# Numbers that a scene is made by, and where they are.
SETTINGS = {
    "vis.headlight": ("active",),
    "vis.map": ("znear", "zfar", "shadowclip", "shadowscale", "haze", "alpha"),
    "vis.scale": ("slidercrank",),
    "stat": ("extent", "meansize"),
    "opt": ("disableflags",),
}
COLORS = {"vis.headlight": ("ambient", "diffuse", "specular"), "vis.rgba": VIS_COLORS}


class Snapshot:
    """A copy of a model.

    Attributes:
        model: The copy, which stays the same object.
    """

    def __init__(self, model: mujoco.MjModel):
        self._of, self.model = model, copy.copy(model)
        both = (self.model, model)
        places = [(*both, name) for name in FOLLOWED]
        places += [(*(_at(one, path) for one in both), name) for path, names in COLORS.items() for name in names]
        arrays = [(getattr(mine, name), getattr(theirs, name)) for mine, theirs, name in places]
        self._arrays = [pair for pair in arrays if pair[0].size]  # they stay where they are in memory
        self._settings = [
            (*(_at(one, path) for one in both), name) for path, names in SETTINGS.items() for name in names
        ]

    def follow(self) -> None:
        """Bring the copy to what the model says now."""
        for mine, theirs in self._arrays:
            np.copyto(mine, theirs)
        for mine, theirs, name in self._settings:
            setattr(mine, name, getattr(theirs, name))

    def upload(self) -> None:
        """Bring the copy's meshes, height fields and textures to what the model says now."""
        for name in dir(self._of):
            if name.startswith(ASSETS) and isinstance(getattr(self._of, name), np.ndarray):
                np.copyto(getattr(self.model, name), getattr(self._of, name))


def _at(model: mujoco.MjModel, path: str) -> Any:
    found: Any = model
    for name in path.split("."):
        found = getattr(found, name)
    return found
