"""Data sets: labelled images in bulk, and trajectories of batched worlds for learning from demonstrations."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpcam.datasets.trajectories.replay import replay
    from warpcam.datasets.trajectories.writer import Writer

__all__ = ["Writer", "replay"]

_MODULES = {"Writer": "writer", "replay": "replay"}  # each imported when it is first asked for


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"warpcam.datasets.trajectories.{_MODULES[name]}"), name)
