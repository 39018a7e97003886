"""Masks as lengths of runs, as COCO has them."""

import numpy as np

from warpcam.datasets.generate.frames import Instance


def run_lengths(by_column: np.ndarray, instance: Instance) -> list[int]:
    """Lengths of runs of a visible mask, column after column, first of pixels that it lacks.

    Only columns of its box are looked at.

    Args:
        by_column: ``Frame.ids``, (height, width), in Fortran's order.
        instance: Whose mask it is.
    """
    height, width = by_column.shape
    left, _, right, _ = instance.visible_box
    shown = np.zeros((right - left) * height + 2, bool)
    shown[1:-1] = by_column.T[left:right].reshape(-1) == instance.id
    edges = np.flatnonzero(shown[1:] != shown[:-1]) + left * height
    runs: list[int] = np.diff(edges, prepend=0, append=height * width).tolist()
    return runs if runs[-1] else runs[:-1]
