"""MuJoCo's abstract scene, ``MjvScene``: its geoms and lights as arrays."""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np

from warpcam.core.errors import WarpcamError

LABEL = 100  # bytes of a geom's label


def geoms_of(scene: mujoco.MjvScene) -> np.ndarray:
    """A copy of its geoms: (geom,), with all fields that this version of MuJoCo has."""
    return _copy_of("geoms", scene.geoms, int(scene.ngeom))


def lights_of(scene: mujoco.MjvScene) -> np.ndarray:
    """A copy of its lights: (light,), likewise."""
    return _copy_of("lights", scene.lights, int(scene.nlight))


def soft_of(scene: mujoco.MjvScene) -> tuple[bytes, ...]:
    """Equal for scenes whose flexes and skins are drawn alike, as far as their geoms do not tell."""
    arrays = scene.flexvert, scene.skinvert
    options = scene.flexvertopt, scene.flexedgeopt, scene.flexfaceopt, scene.flexskinopt
    return (*(values.tobytes() for values in arrays), bytes(bool(option) for option in options))


def same(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return which of two copies' items are the same in all fields, (item,) bool."""
    width = one.dtype.itemsize
    bytes_of = [np.frombuffer(items.tobytes(), np.uint8).reshape(-1, width) for items in (one, other)]
    return (bytes_of[0] == bytes_of[1]).all(axis=1)


def same_all(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two copies are the same."""
    return len(one) == len(other) and one.tobytes() == other.tobytes()


def refuse_views(scene: mujoco.MjvScene) -> None:
    """Raise for a scene that is to be seen twice, or in another frame."""
    if int(scene.stereo):
        raise WarpcamError(f"scene.stereo is {int(scene.stereo)}, which warpcam does not draw; allowed is 0")
    if scene.enabletransform and (
        scene.translate.any() or abs(scene.rotate[0]) != 1.0 or scene.rotate[1:].any() or scene.scale != 1.0
    ):
        raise WarpcamError(
            f"scene.enabletransform is 1 with translate {scene.translate}, rotate {scene.rotate} and scale "
            f"{scene.scale}, which warpcam does not draw; allowed is 0"
        )


def _copy_of(kind: str, items: Sequence[Any], count: int) -> np.ndarray:
    """The first ``count`` structs, which lie one after another in memory: one by one they would take far longer."""
    layout, before = _layouts()[kind]
    if not count:
        return np.zeros(0, layout)
    begin = items[0].pos.ctypes.data - before
    return np.frombuffer(ctypes.string_at(begin, count * layout.itemsize), layout)


@cache
def _layouts() -> dict[str, tuple[np.dtype, int]]:
    """Return the memory layout of geoms and lights in this version of MuJoCo, and the offset of ``pos``."""
    scene = mujoco.MjvScene(mujoco.MjModel.from_xml_string("<mujoco/>"), 3)
    scene.geoms[1].label = ""  # nobody has written to that memory yet
    return {"geoms": _layout(scene.geoms), "lights": _layout(scene.lights)}


def _layout(items: Sequence[Any]) -> tuple[np.dtype, int]:
    """Found by writing each field of the second of three structs and looking for what has changed around it."""
    pos = [item.pos.ctypes.data for item in items[:3]]
    size, item = pos[1] - pos[0], items[1]
    names = [name for name, field in vars(type(item)).items() if isinstance(field, property)]
    places: dict[str, tuple[Any, int]] = {}
    for name in names:
        value = getattr(item, name)
        if isinstance(value, np.ndarray):
            places[name] = (value.dtype, value.shape), value.ctypes.data - pos[1]
            continue
        text = isinstance(value, str)
        setattr(item, name, "" if text else 0)
        before = np.frombuffer(ctypes.string_at(pos[0], 2 * size), np.uint8)
        setattr(item, name, "a" if text else 1)
        after = np.frombuffer(ctypes.string_at(pos[0], 2 * size), np.uint8)
        at, number = int(np.flatnonzero(before != after)[0]), isinstance(value, float)
        kind: Any = (np.uint8, (LABEL,)) if text else np.float32 if number else np.int32
        places[name] = kind, at - size - (2 if number else 0)  # of 1.0 the upper two bytes are not 0
    begin = min(place for _, place in places.values())
    starts = [*sorted(place - begin for _, place in places.values()), size]
    formats: list[Any] = []
    for kind, place in places.values():
        room = starts[starts.index(place - begin) + 1] - (place - begin)
        formats.append(np.uint8 if kind is np.int32 and room < 4 else kind)
    offsets = [place - begin for _, place in places.values()]
    layout = np.dtype({"names": list(places), "formats": formats, "offsets": offsets, "itemsize": size})
    return layout, -begin
