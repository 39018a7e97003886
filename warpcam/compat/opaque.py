"""What of a MuJoCo model is not transparent: all that the buffer of depth has where MuJoCo draws colours."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from warpcam.sources.mujoco_model import MODEL_NAMES

KINDS = ("geom", "site", "tendon", "flex", "skin")
PLAIN = np.array((0.5, 0.5, 0.5, 1.0), np.float32)  # a colour that lets the material's count
SOLID = 0.995  # opacity from which on MuJoCo draws something solid
# What a copy of a model follows.
FOLLOWED = tuple(
    dict.fromkeys(
        (
            *MODEL_NAMES.values(),
            *(f"{kind}_{what}" for kind in KINDS for what in ("rgba", "matid", "group")),
            *("geom_type", "site_type", "site_size", "tendon_width", "mat_reflectance"),
        )
    )
)


def has_veils(model: mujoco.MjModel, groups: Sequence[Sequence[int]], draw: Sequence[str]) -> bool:
    """Whether something of those groups is transparent and drawn.

    Args:
        model: The model.
        groups: Those that are drawn, for each of ``KINDS``.
        draw: Kinds that are drawn: "geoms", "sites" and so on.
    """
    for kind, shown in zip(KINDS, groups, strict=True):
        plural = "flexes" if kind == "flex" else f"{kind}s"
        opacity = _opacity(model, kind)
        veils = (opacity > 0.0) & (opacity < SOLID)
        if plural in draw and veils.any() and np.isin(getattr(model, f"{kind}_group")[veils], list(shown)).any():
            return True
    return False


def sees_veils(model: mujoco.MjModel, objects: np.ndarray) -> bool:
    """Whether something transparent is to be seen in an image.

    Args:
        model: The model.
        objects: (height, width, 2) ids and ``mjtObj``.
    """
    for kind in KINDS:
        ids = objects[..., 0][objects[..., 1] == int(getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"))]
        if ids.size and (_opacity(model, kind)[ids] < SOLID).any():
            return True
    return False


class Opaque:
    """A copy of a model in which nothing that is transparent is to be seen.

    Attributes:
        model: The copy.
    """

    def __init__(self, model: mujoco.MjModel):
        self._of, self.model = model, copy.copy(model)

    def follow(self) -> None:
        """Bring the copy to what the model says now."""
        for name in FOLLOWED:
            np.copyto(getattr(self.model, name), getattr(self._of, name))
        for kind in KINDS:
            getattr(self.model, f"{kind}_rgba")[_opacity(self._of, kind) < SOLID] = 0.0


def _opacity(model: mujoco.MjModel, kind: str) -> np.ndarray:
    colors, materials = getattr(model, f"{kind}_rgba"), getattr(model, f"{kind}_matid")
    opacity = np.array(colors[:, 3])
    by_material = (materials >= 0) & (colors == PLAIN).all(axis=1)
    opacity[by_material] = model.mat_rgba[materials[by_material], 3]
    return opacity
