"""Isaac Gym's cameras, with no graphics: ``from warpcam.compat.isaacgym import gymapi, gymtorch``."""

import sys
from importlib import import_module

from warpcam.core.errors import WarpcamError

__all__ = ["install", "uninstall"]

MODULES = ("gymapi", "gymtorch", "gymutil", "terrain_utils", "torch_utils")


def install() -> None:
    """Have ``import isaacgym`` mean this package, in all files of a program; call it before they are imported."""
    there = sys.modules.get("isaacgym")
    if there is not None and there is not sys.modules[__name__]:
        raise WarpcamError("install: isaacgym has been imported already; call install before that")
    for name in MODULES:
        sys.modules[f"isaacgym.{name}"] = import_module(f"{__name__}.{name}")
    sys.modules["isaacgym"] = sys.modules[__name__]


def uninstall() -> None:
    """Have ``import isaacgym`` look for Isaac Gym again; what has been imported stays."""
    if sys.modules.get("isaacgym") is sys.modules[__name__]:
        for name in ("isaacgym", *(f"isaacgym.{name}" for name in MODULES)):
            del sys.modules[name]
