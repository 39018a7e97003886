"""Robosuite's camera observations with no graphics library behind them: ``warpcam.compat.robosuite.install()``."""

from warpcam.compat.robosuite.renderer import OffscreenContext, install, observables, uninstall

__all__ = ["OffscreenContext", "install", "observables", "uninstall"]
