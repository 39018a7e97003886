"""Datasets: trajectories of batched worlds for learning from demonstrations."""

from warpcam.datasets.trajectories.writer import Writer

__all__ = ["Writer"]
