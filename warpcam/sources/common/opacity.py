"""Opacity of a material: a number, or a map."""

import numpy as np

from warpcam.kernels.passes.mirrors import OPAQUE_ABOVE


def opacity_of(values: np.ndarray | None, factor: float, cutoff: float) -> tuple[float, np.ndarray | None]:
    """A material's opacity as the kernels have it.

    Args:
        values: (height, width) in [0, 1], what its map says, or None.
        factor: Of these; without a map the opacity itself.
        cutoff: What is less opaque is not there, all else is solid; 0 for none.

    Returns:
        The opacity that is alike all over, and a map, (height, width, 1) uint8, where it is not.
    """
    if values is None:
        return (float(factor >= cutoff) if cutoff > 0.0 else float(np.clip(factor, 0.0, 1.0))), None
    values = np.clip(values * factor, 0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    if cutoff > 0.0 and (low >= cutoff or high < cutoff):
        return float(low >= cutoff), None
    if cutoff <= 0.0 and (low >= OPAQUE_ABOVE or high - low < 1.0 / 255.0):
        return (1.0 if low >= OPAQUE_ABOVE else low), None
    return 1.0, np.rint(255.0 * values).astype(np.uint8)[..., None]
