"""Errors: see ``warpcam.core.errors``."""

from warpcam.core.errors import WarpcamError

__all__ = ["WarpcamError"]
