"""Outputs that a camera can be asked for: see ``warpcam.kernels.outputs``."""

from warpcam.kernels.outputs import OUTPUTS, Output

__all__ = ["OUTPUTS", "Output"]
