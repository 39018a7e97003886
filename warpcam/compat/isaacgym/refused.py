"""Calls that the front end refuses: see ``warpcam.compat.isaacgym.api.unsupported``."""

from warpcam.compat.isaacgym.api.unsupported import UNSUPPORTED as REFUSED

__all__ = ["REFUSED"]
