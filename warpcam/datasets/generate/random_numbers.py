"""Random numbers of a sample: they follow from the plan's seed, the sample and their purpose alone."""

import math
from zlib import crc32

import numpy as np


def generator(seed: int, sample: int, purpose: str) -> np.random.Generator:
    """Generator of one purpose of one sample."""
    return np.random.default_rng([seed, sample, crc32(purpose.encode())])


def seed_of(seed: int, sample: int, purpose: str) -> int:
    """A seed of 31 bits."""
    return int(generator(seed, sample, purpose).integers(2**31))


def any_rotation(random: np.random.Generator) -> np.ndarray:
    """A rotation, all as likely, as a quaternion w x y z."""
    numbers = random.normal(size=4)
    return numbers / np.linalg.norm(numbers)


def yaw(random: np.random.Generator) -> np.ndarray:
    """A rotation about z by any angle, as a quaternion w x y z."""
    half = random.uniform(0.0, np.pi)
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def apart(
    random: np.random.Generator, low: np.ndarray, high: np.ndarray, others: list[np.ndarray], spacing: float
) -> np.ndarray:
    """A position from ``low`` to ``high`` that is ``spacing`` away from others, or the one farthest away of 100."""
    best, distance = None, -1.0
    for _ in range(100 if spacing > 0.0 and others else 1):
        position = random.uniform(low, high)
        nearest = min((math.dist(position, other) for other in others), default=np.inf)
        if nearest > distance:
            best, distance = position, nearest
        if nearest >= spacing:
            break
    assert best is not None  # the loop runs once at least
    return best
