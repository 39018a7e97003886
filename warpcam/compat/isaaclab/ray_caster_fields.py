"""Fields that the configurations of Isaac Lab's ray casters share, checked."""

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import warp as wp

from warpcam.compat.common.scalars import real
from warpcam.core.errors import WarpcamError
from warpcam.scene.scene import Scene

Quaternions = Literal["xyzw", "wxyz"]
# Fields that say what is not offered here, by the value that asks for nothing.
NEUTRAL = {
    "update_period": 0.0,
    "global_world_only": False,
    "debug_vis": False,
    "history_length": 0,
    "update_mesh_ids": False,
}


def check_fields(cfg: Any, where: str, quaternions: Any, neutral: Mapping[str, Any] = NEUTRAL) -> None:
    """Raise for fields that are missing or ask for what is not offered; ``where`` begins the text."""
    if quaternions not in get_args(Quaternions):
        raise WarpcamError(f"{where}: quaternions is {quaternions!r}; allowed are 'xyzw' and 'wxyz'")
    for name in ("prim_path", "pattern_cfg"):
        if not hasattr(cfg, name):
            raise WarpcamError(f"{where}: cfg has no {name}")
    for name, value in neutral.items():
        if getattr(cfg, name, value) != value:
            raise WarpcamError(f"{where}: {name} is {getattr(cfg, name)!r}; allowed is {value!r}")
    if not real(getattr(cfg, "max_distance", 1e6)) > 0.0:
        raise WarpcamError(f"{where}: max_distance must be a positive number [m], got {cfg.max_distance!r}")
    if getattr(cfg, "mesh_prim_paths", ()):
        warnings.warn(
            f"{where}: mesh_prim_paths is not read: rays meet all shapes of the scene but those of exclude_bodies",
            stacklevel=3,
        )


def body_of(cfg: Any, scene: Scene, where: str) -> int:
    """Index of the body that the last part of ``prim_path`` names."""
    return scene.body(str(cfg.prim_path).rstrip("/").rsplit("/", 1)[-1], f"{where}: prim_path")


def offset_numbers(cfg: Any, name: str, default: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Finite numbers of ``offset``, as many as ``default`` has."""
    given = getattr(getattr(cfg, "offset", None), name, default)
    return numbers_of(given, len(default), f"{where}: offset.{name}")


def numbers_of(given: Any, count: int, where: str) -> tuple[float, ...]:
    """So many finite numbers."""
    numbers = tuple(real(value) for value in given) if isinstance(given, Sequence) else ()
    if len(numbers) != count or any(value - value != 0.0 for value in numbers):
        raise WarpcamError(f"{where} must be {count} numbers, got {given!r}")
    return numbers


def offset_turn(cfg: Any, quaternions: str, where: str) -> wp.quat:
    """The rotation of ``offset.rot``, a unit quaternion."""
    identity = (0.0, 0.0, 0.0, 1.0) if quaternions == "xyzw" else (1.0, 0.0, 0.0, 0.0)
    rotation = offset_numbers(cfg, "rot", identity, where)
    if not any(rotation):
        raise WarpcamError(f"{where}: offset.rot must not be of length 0, got {cfg.offset.rot!r}")
    return wp.normalize(wp.quat(*(rotation if quaternions == "xyzw" else (*rotation[1:], rotation[0]))))
