"""MuJoCo's abstract scene, ``MjvScene``, as far as what a program writes into it would have to be drawn from there."""

import ctypes
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np

from warpcam.errors import WarpcamError


def content(scene: mujoco.MjvScene) -> bytes:
    """Equal as long as its geoms and lights, with all their fields, are as MuJoCo has made them."""
    return b"%d %d" % (scene.ngeom, scene.nlight) + b"".join(
        _bytes(items, count) for items, count in ((scene.geoms, scene.ngeom), (scene.lights, scene.nlight))
    )


def refuse_views(scene: mujoco.MjvScene) -> None:
    """Raise for a scene that is to be seen twice, or in another frame."""
    if int(scene.stereo):
        raise WarpcamError(f"scene.stereo is {int(scene.stereo)}, which warpcam does not draw; allowed is 0")
    moved = scene.translate.any() or abs(scene.rotate[0]) != 1.0 or scene.rotate[1:].any() or scene.scale != 1.0
    if scene.enabletransform and moved:
        raise WarpcamError(
            f"scene.enabletransform is 1 with translate {scene.translate}, rotate {scene.rotate} and scale "
            f"{scene.scale}, which warpcam does not draw; allowed is 0"
        )


def _bytes(items: Any, count: int) -> bytes:
    """The first ``count`` structs, which lie one after another in memory: one by one they would take far longer."""
    if not count:
        return b""
    first, last = items[0], items[count - 1]
    struct: Any = type(first)
    numbers, arrays = _fields(struct)
    parts = [repr((numbers(first), numbers(last))).encode()]
    parts += [array.tobytes() for array in (*arrays(first), *arrays(last))]
    if count > 1:  # all but what lies before pos in the first, and from there on in the last
        begin = first.pos.ctypes.data
        parts.append(ctypes.string_at(begin, (count - 1) * (items[1].pos.ctypes.data - begin)))
    return b"".join(parts)


@cache
def _fields(struct: type) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Those of this version of MuJoCo that are numbers or text, and those that are arrays."""
    names = [name for name, field in vars(struct).items() if isinstance(field, property)]
    arrays = [name for name in names if isinstance(getattr(struct(), name), np.ndarray)]
    return attrgetter(*(name for name in names if name not in arrays)), attrgetter(*arrays)
