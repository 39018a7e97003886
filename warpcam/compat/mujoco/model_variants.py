"""Copies of a MuJoCo model in which what is transparent is left out, or what can move is transparent.

The former is all that the buffer of depth has where MuJoCo draws colours, the latter what ``mjVIS_TRANSPARENT`` shows.
"""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE
from warpcam.sources.mujoco.model import MODEL_NAMES

KINDS = ("geom", "site", "tendon", "flex", "skin")
PLAIN = np.array((0.5, 0.5, 0.5, 1.0), np.float32)  # a colour that lets the material's count
# What a copy of a model follows.
FOLLOWED = tuple(
    dict.fromkeys(
        (
            *MODEL_NAMES.values(),
            *(f"{kind}_{what}" for kind in KINDS for what in ("rgba", "matid", "group")),
            *("geom_type", "site_type", "site_size", "tendon_width", "mat_reflectance"),
            *("tendon_limited", "tendon_range", "tendon_margin", "tendon_solimp_lim"),
            *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "tendon_lengthspring"),
            *("flex_radius", "flex_flatskin", "skin_inflate", "actuator_cranklength"),
        )
    )
)


def has_transparent(model: mujoco.MjModel, groups: Sequence[Sequence[int]], draw: Sequence[str]) -> bool:
    """Return whether a geom of those groups is transparent and drawn.

    Args:
        model: The model.
        groups: Those that are drawn, for each of ``KINDS``.
        draw: Kinds that are drawn: "geoms", "sites" and so on.
    """
    for kind, shown in zip(KINDS, groups, strict=True):
        plural = "flexes" if kind == "flex" else f"{kind}s"
        opacity = _opacity(model, kind)
        transparent = (opacity > 0.0) & (opacity < OPAQUE_ABOVE)
        if (
            plural in draw
            and transparent.any()
            and np.isin(getattr(model, f"{kind}_group")[transparent], list(shown)).any()
        ):
            return True
    return False


def sees_transparent(model: mujoco.MjModel, objects: np.ndarray) -> bool:
    """Return whether an image shows anything transparent.

    Args:
        model: The model.
        objects: (height, width, 2) ids and ``mjtObj``.
    """
    for kind in KINDS:
        ids = objects[..., 0][objects[..., 1] == int(getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"))]
        if ids.size and (_opacity(model, kind)[ids] < OPAQUE_ABOVE).any():
            return True
    return False


class ModelVariant:
    """A copy of a model with other colours.

    Attributes:
        model: The copy.
    """

    def __init__(self, model: mujoco.MjModel):
        self._of, self.model = model, copy.copy(model)

    def is_old(self) -> bool:
        """Return whether something has changed that a copy does not follow."""
        return any(getattr(self.model, name) != getattr(self._of, name) for name in ("vis", "stat", "opt"))

    def follow(self) -> None:
        """Bring the copy to what the model says now."""
        for name in FOLLOWED:
            np.copyto(getattr(self.model, name), getattr(self._of, name))
        for kind in KINDS:
            self._recolor(getattr(self.model, f"{kind}_rgba"), _colors(self._of, kind), kind)

    def _recolor(self, colors: np.ndarray, shown: np.ndarray, kind: str) -> None:
        """Write the colours of a kind, which shows those of the model."""
        raise NotImplementedError


class WithoutTransparent(ModelVariant):
    """A copy in which nothing that is transparent is to be seen."""

    def _recolor(self, colors: np.ndarray, shown: np.ndarray, kind: str) -> None:
        colors[shown[:, 3] < OPAQUE_ABOVE] = 0.0


class WithModelTransparency(ModelVariant):
    """A copy in which all but what is fixed to the world has ``vis.map.alpha`` of its opacity."""

    def _recolor(self, colors: np.ndarray, shown: np.ndarray, kind: str) -> None:
        model = self._of
        moves = np.full(len(shown), True)
        if kind in ("geom", "site"):
            body = getattr(model, f"{kind}_bodyid")
            moves = (model.body_weldid[body] != 0) | (model.body_mocapid[model.body_rootid[body]] >= 0)
        shown[:, 3] *= model.vis.map.alpha
        colors[moves] = shown[moves]


def _opacity(model: mujoco.MjModel, kind: str) -> np.ndarray:
    return _colors(model, kind)[:, 3]


def _colors(model: mujoco.MjModel, kind: str) -> np.ndarray:
    """Return the displayed colours, geoms' own or their materials'."""
    colors = np.array(getattr(model, f"{kind}_rgba"))
    materials = getattr(model, f"{kind}_matid")[: len(colors)]  # flex_matid of MuJoCo 4.0 is as long as all elements
    by_material = (materials >= 0) & (colors == PLAIN).all(axis=1)
    colors[by_material] = model.mat_rgba[materials[by_material]]
    return colors
