"""Random numbers of a sample: they follow from the plan's seed, the sample and their purpose alone."""

import math
import threading
from zlib import crc32

import numpy as np

GENERATORS = 8  # of a thread
NOTHING = np.zeros(4, np.uint64)
START = {"bit_generator": "Philox", "buffer": NOTHING, "buffer_pos": 4, "has_uint32": 0, "uinteger": 0}
_THREAD = threading.local()


def generator(seed: int, sample: int, purpose: str) -> np.random.Generator:
    """Generator of one purpose of one sample, as it is at its beginning.

    It is one of the thread's few, in turn, as making one takes several times as long: use it before as many others are
    asked for.
    """
    if not hasattr(_THREAD, "generators"):
        _THREAD.generators = [np.random.Generator(np.random.Philox(0)) for _ in range(GENERATORS)]
    found: np.random.Generator = _THREAD.generators.pop(0)
    _THREAD.generators.append(found)
    state = {
        **START,
        "state": {"counter": NOTHING, "key": np.array((seed, sample << 32 | crc32(purpose.encode())), "u8")},
    }
    found.bit_generator.state = state
    return found


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
