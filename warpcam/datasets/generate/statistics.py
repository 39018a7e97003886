"""Statistics of a data set: counts that shards keep, and that add up."""

import math
from typing import Any

import numpy as np
import torch

from warpcam.datasets.generate.frames import Frame

# Edges of the histograms' bins.
DEPTHS = np.geomspace(0.05, 100.0, 34)  # [m]
SIZES = np.concatenate(([0.0], np.geomspace(2.0, 2048.0, 21)))  # roots of boxes' areas [pixels]
SHARES = np.linspace(0.0, 1.0, 11)  # of visibility


def empty(classes: int) -> dict[str, Any]:
    """Statistics of no frame."""
    return {
        "frames": 0,
        "instances": [0] * classes,
        "hidden": [0] * classes,
        "truncated": 0,
        "sizes": [0] * (len(SIZES) - 1),
        "visibility": [0] * (len(SHARES) - 1),
        "depth": [0] * (len(DEPTHS) - 1),
        "depth_missing": 0,
    }


def of_frame(frame: Frame) -> dict[str, Any]:
    """Statistics of one frame. Instances are those that are visible; "hidden" are the others."""
    found = empty(len(frame.classes))
    found["frames"] = 1
    seen = [each for each in frame.instances if each.visible_pixels > 0]
    for each in frame.instances:
        found["instances" if each.visible_pixels > 0 else "hidden"][each.category] += 1
    found["truncated"] = sum(each.truncated for each in seen)
    boxes = np.array([each.visible_box for each in seen], np.float64).reshape(-1, 4)
    found["sizes"] = _counts(np.sqrt((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])), SIZES)
    found["visibility"] = _counts(np.array([each.visibility for each in seen]), SHARES)
    *found["depth"], found["depth_missing"] = frame.depth_counts.tolist()
    return found


def add(total: dict[str, Any], other: dict[str, Any]) -> None:
    """Add statistics to others."""
    for name, value in other.items():
        total[name] = (
            [a + b for a, b in zip(total[name], value, strict=True)] if isinstance(value, list) else total[name] + value
        )


def _counts(values: np.ndarray, edges: np.ndarray) -> list[int]:
    """Numbers of each bin; what lies beyond counts to the first or last one."""
    return np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0].tolist()


def depth_counts(depths: torch.Tensor) -> torch.Tensor:
    """Pixels of each bin of ``DEPTHS``, and last of those without depth, (image, bin + 1) int64, on the images' device.

    Args:
        depths: (image, height, width) float32 [m]; what lies beyond the edges counts to the first or the last bin.
    """
    bins, low, high = len(DEPTHS) - 1, math.log(DEPTHS[0]), math.log(DEPTHS[-1])
    flat = depths.reshape(len(depths), -1)
    # Bins of equal width in logarithm: on a CPU a third of the time of a search among the edges.
    places = (flat.log() - low).mul_(bins / (high - low)).clamp_(0, bins - 1)
    places.masked_fill_(~((flat > 0.0) & (flat < math.inf)), bins)
    found = places.to(torch.int64)
    found += torch.arange(len(flat), device=depths.device)[:, None] * (bins + 1)
    return torch.bincount(found.ravel(), minlength=len(flat) * (bins + 1)).reshape(len(flat), bins + 1)
