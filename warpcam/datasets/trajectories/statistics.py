"""Statistics of features, as LeRobot datasets keep them for each episode and for all."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Statistics = dict[str, Any]  # by name, each nested lists of numbers of one shape, and "count" of one number
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SAMPLES = 100  # images of an episode that are looked at, at most


def of_images(images: np.ndarray) -> Statistics:
    """Of each channel, from 0 to 1: (3, 1, 1), of at most ``SAMPLES`` images (frame, height, width, 3) uint8."""
    chosen = images[np.linspace(0, len(images) - 1, min(len(images), SAMPLES)).astype(int)]
    found = _of(chosen.reshape(-1, 3) / 255.0, len(chosen))
    return {name: value if name == "count" else np.reshape(value, (3, 1, 1)).tolist() for name, value in found.items()}


def of_values(values: np.ndarray) -> Statistics:
    """Of each number of vectors, (frame, number) or (frame,); of arrays with more dimensions over all their numbers."""
    values = values.astype(np.float64)
    if values.ndim <= 2:
        return _of(values.reshape(len(values), -1), len(values))
    found = _of(values.reshape(-1, 1), len(values))
    one = (1,) * (values.ndim - 1)
    return {name: value if name == "count" else np.reshape(value, one).tolist() for name, value in found.items()}


def merged(parts: Sequence[Mapping[str, Any]]) -> Statistics:
    """Of all frames together; quantiles are means of the parts', weighted by their frames, as LeRobot has them."""
    counts = np.array([part["count"][0] for part in parts], np.float64)

    def stacked(name: str) -> np.ndarray:
        return np.stack([np.asarray(part[name], np.float64) for part in parts])

    means, deviations = stacked("mean"), stacked("std")
    weights = (counts / counts.sum()).reshape(-1, *(1,) * (means.ndim - 1))
    mean = (weights * means).sum(axis=0)
    variance = (weights * (deviations**2 + (means - mean) ** 2)).sum(axis=0)
    every = {"min": stacked("min").min(axis=0), "max": stacked("max").max(axis=0), "mean": mean, "std": variance**0.5}
    for name in QUANTILES:
        if all(name in part for part in parts):
            every[name] = (weights * stacked(name)).sum(axis=0)
    return {**{name: value.tolist() for name, value in every.items()}, "count": [int(counts.sum())]}


def _of(rows: np.ndarray, count: int) -> Statistics:
    every = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    every.update(zip(QUANTILES, np.quantile(rows, list(QUANTILES.values()), axis=0), strict=True))
    return {**{name: value.tolist() for name, value in every.items()}, "count": [count]}
