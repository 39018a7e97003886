"""Devices: see ``warpcam.core.device``."""

from warpcam.core.device import contexts, ordinals, resolve

__all__ = ["contexts", "ordinals", "resolve"]
