"""``mujoco.Renderer`` with no graphics library behind it: ``from warpcam.compat.mujoco import Renderer``."""

from warpcam.compat.mujoco.renderer import Renderer, install, uninstall

__all__ = ["Renderer", "install", "uninstall"]
