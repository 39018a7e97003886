"""Tables of rays that no lens has."""

import numpy as np

WIDTH, HEIGHT = 45, 27


def random_rays(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH, 3))


def curled_rays() -> np.ndarray:
    across, down = np.meshgrid(np.linspace(-3, 3, WIDTH), np.linspace(-3, 3, HEIGHT))
    return np.stack([np.sin(1.1 * across + down), np.cos(1.7 * down), np.sin(2 * across - 0.5 * down)], -1) + 0.05
