"""MuJoCo's options of what is drawn, ``MjvOption`` and the flags of an ``MjvScene``: honoured, or refused by name."""

from collections.abc import Callable, Iterable, Mapping
from itertools import compress, count
from typing import Any

import mujoco
import numpy as np

from warpcam.compat.mujoco.frame_renderer import Style
from warpcam.core.errors import WarpcamError

GROUPS = ("geomgroup", "sitegroup", "tendongroup", "flexgroup", "skingroup")  # in the order of Style.groups

Matters = Callable[[mujoco.MjModel], bool]


def _always(_model: mujoco.MjModel) -> bool:
    return True


def _any(*counts: str) -> Matters:
    return lambda model: any(getattr(model, count) > 0 for count in counts)


def _soft(model: mujoco.MjModel) -> bool:
    return bool((np.asarray(model.flex_dim) > 1).any())


# Flags that must be as they are by default, with what in a model makes a difference of them. The others are honoured
# (tendons, skins, transparency), make geoms of the abstract scene, which are drawn from there, or change these alone.
AS_DEFAULT: Mapping[str, Matters] = {
    "CONVEXHULL": _any("nmesh"),
    "TEXTURE": _any("ntex"),
    "ISLAND": _always,
    "STATIC": _any("ngeom"),
    "FLEXVERT": _any("nflex"),
    "FLEXEDGE": _any("nflex"),
    "FLEXFACE": _soft,
    "FLEXSKIN": _soft,
}
RENDERING_AS_DEFAULT = ("WIREFRAME", "ADDITIVE", "FOG", "HAZE", "DEPTH", "SEGMENT", "IDCOLOR", "CULL_FACE")


def _numbers(enum: Any, prefix: str, names: Iterable[str]) -> dict[str, int]:
    """Of those flags that this version of MuJoCo has."""
    return {name: int(getattr(enum, prefix + name)) for name in names if hasattr(enum, prefix + name)}


KINDS = Style().draw
OPTION_FLAGS = _numbers(mujoco.mjtVisFlag, "mjVIS_", AS_DEFAULT)
OPTION_DEFAULTS = mujoco.MjvOption().flags.tolist()
RENDERING_FLAGS = _numbers(mujoco.mjtRndFlag, "mjRND_", RENDERING_AS_DEFAULT)
RENDERING_DEFAULTS = {name: name in ("HAZE", "CULL_FACE") for name in RENDERING_FLAGS}
TENDON, SKIN, TRANSPARENT = (int(getattr(mujoco.mjtVisFlag, f"mjVIS_{n}")) for n in ("TENDON", "SKIN", "TRANSPARENT"))
SHADOW, REFLECTION, SKYBOX = (int(getattr(mujoco.mjtRndFlag, f"mjRND_{n}")) for n in ("SHADOW", "REFLECTION", "SKYBOX"))


def style_of(model: mujoco.MjModel, option: mujoco.MjvOption, flags: Any) -> Style:
    """The style that these ask for.

    Args:
        model: What is drawn.
        option: Groups and flags of what is drawn of it.
        flags: Those of an ``MjvScene``, by ``mjtRndFlag``.

    Raises:
        WarpcamError: A flag asks for something that is not drawn here.
    """
    chosen, flags = option.flags.tolist(), flags.tolist()
    for name, number in OPTION_FLAGS.items():
        if chosen[number] != OPTION_DEFAULTS[number] and AS_DEFAULT[name](model):
            allowed = OPTION_DEFAULTS[number]
            raise WarpcamError(_refusal(f"scene_option.flags[mjVIS_{name}]", chosen[number], allowed))
    if option.label:
        raise WarpcamError(_refusal("scene_option.label", option.label, 0))
    for name, number in RENDERING_FLAGS.items():
        if flags[number] != RENDERING_DEFAULTS[name]:
            raise WarpcamError(_refusal(f"scene.flags[mjRND_{name}]", flags[number], RENDERING_DEFAULTS[name]))
    hidden = [kind for kind, number in (("tendons", TENDON), ("skins", SKIN)) if not chosen[number]]
    quality = model.vis.quality
    return Style(
        groups=tuple(tuple(compress(count(), getattr(option, name).tolist())) for name in GROUPS),
        draw=tuple(kind for kind in KINDS if kind not in hidden),
        shadows=bool(flags[SHADOW]) and quality.shadowsize > 0,
        reflections=bool(flags[REFLECTION]),
        sky=bool(flags[SKYBOX]),
        antialiasing=4 if quality.offsamples > 1 else 1,
        model_transparency=bool(chosen[TRANSPARENT]) and model.vis.map.alpha != 1.0,
    )


def _refusal(what: str, came: Any, allowed: Any) -> str:
    return f"{what} is {int(came)}, which warpcam does not draw; allowed is {int(allowed)}"
