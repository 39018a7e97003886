"""MuJoCo's abstract scene, ``MjvScene``, as far as what a program writes into it would have to be drawn from there."""

from typing import Any

import mujoco
import numpy as np

from warpcam.errors import WarpcamError

GEOMS = ("pos", "mat", "size", "rgba")
LIGHTS = ("pos", "dir", "attenuation", "ambient", "diffuse", "specular")
LIGHTS_TOO = ("cutoff", "exponent", "castshadow")


def content(scene: mujoco.MjvScene) -> bytes:
    """Equal as long as its geoms and lights are as MuJoCo has made them."""
    parts = [b"%d %d" % (scene.ngeom, scene.nlight)]
    if scene.ngeom:
        parts += [_rows(scene.geoms, scene.ngeom, name).tobytes() for name in GEOMS]
    for light in scene.lights[: scene.nlight]:
        parts += [getattr(light, name).tobytes() for name in LIGHTS]
        parts.append(repr([getattr(light, name) for name in LIGHTS_TOO]).encode())
    return b"".join(parts)


def refuse_views(scene: mujoco.MjvScene) -> None:
    """Raise for a scene that is to be seen twice, or in another frame."""
    if int(scene.stereo):
        raise WarpcamError(f"scene.stereo is {int(scene.stereo)}, which warpcam does not draw; allowed is 0")
    if scene.enabletransform:
        raise WarpcamError("scene.enabletransform is 1, which warpcam does not draw; allowed is 0")


def _rows(geoms: Any, count: int, name: str) -> np.ndarray:
    """One field of all geoms, which lie one after another in MuJoCo's memory: the fields one by one take far longer."""
    first = getattr(geoms[0], name)
    step = getattr(geoms[1], name).ctypes.data - first.ctypes.data if count > 1 else 0
    return np.lib.stride_tricks.as_strided(first, (count, *first.shape), (step, *first.strides), writeable=False)
