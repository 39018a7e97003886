"""Sources whose simulator need not be installed."""

from importlib import import_module
from typing import Any

from warpcam.core.errors import WarpcamError


def import_source(module: str, extra: str = "mujoco") -> Any:
    """Import the module that reads one simulator, only now: the simulator need not be installed otherwise."""
    try:
        return import_module(f"warpcam.sources.{module}")
    except ModuleNotFoundError as error:
        raise WarpcamError(
            f"{error.name} is not installed, and this scene needs it: pip install 'warpcam[{extra}]'"
        ) from error
