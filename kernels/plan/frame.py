"""Plan of a frame: the kernels that draw one camera, in the order of their launches."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Any

from warpcam.kernels.plan.edges import EdgeKey
from warpcam.kernels.plan.launches import SceneTypes
from warpcam.kernels.plan.shading import ShadingKey
from warpcam.kernels.plan.shadow import ShadowKey
from warpcam.kernels.plan.splats import SplatKey
from warpcam.kernels.plan.trace import ListKey, MirrorKey, TraceKey

KernelKey = ListKey | TraceKey | ShadowKey | MirrorKey | ShadingKey | EdgeKey | SplatKey

NAMES: dict[type, str] = {
    ListKey: "views and lists of shapes",
    TraceKey: "trace",
    ShadowKey: "shadows",
    MirrorKey: "trace in mirrors",
    ShadingKey: "shading",
    EdgeKey: "smooth edges",
    SplatKey: "Gaussians",
}


@dataclass(frozen=True)
class FramePlan:
    """Kernels of one camera.

    Attributes:
        keys: Each kernel once, in the order of launches.
    """

    keys: tuple[KernelKey, ...]

    @classmethod
    def of(cls, keys: Iterable[KernelKey]) -> "FramePlan":
        """The plan that has these keys, each once."""
        return cls(tuple(dict.fromkeys(keys)))

    def __str__(self) -> str:
        return "\n".join(describe(key) for key in self.keys)


def describe(key: KernelKey) -> str:
    """A key in words, on one line."""
    words = [f"{field.name.replace('_', ' ')} {_word(getattr(key, field.name))}" for field in fields(key)]
    return f"{NAMES[type(key)]}: {'; '.join(words)}; blocks a multiprocessor holds {key.blocks}".replace(
        f"; blocks {key.blocks};", ";"
    )


def _word(value: Any) -> str:
    if isinstance(value, SceneTypes):
        return " ".join(part for part in map(_word, (value.geometry, value.scene)) if part != "none") or "none"
    if isinstance(value, IntFlag):
        return " ".join(str(flag.name) for flag in type(value) if flag in value) or "none"
    if isinstance(value, IntEnum):
        return value.name
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "x".join(map(str, value)) if isinstance(value, tuple) else str(value)
