"""Outputs that a camera can be asked for: see ``warpcam.camera.outputs``."""

from warpcam.camera.outputs import OUTPUTS, Output

__all__ = ["OUTPUTS", "Output"]
