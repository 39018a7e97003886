"""Arrays over the memory of others."""

import gc

import numpy as np
import warp as wp

from warpcam.core.shared_memory import shared


def test_memory_is_seen_in_another_type_and_lives_as_long(device: wp.Device) -> None:
    values = np.arange(24, dtype=np.float32)
    seen = shared(wp.array(values, dtype=wp.float32, device=device), (2, 3), wp.vec3, start=6 * 4)
    gc.collect()
    others = [wp.full(24, 7.0, dtype=wp.float32, device=device) for _ in range(8)]  # would take memory that is free
    np.testing.assert_array_equal(seen.numpy().reshape(-1), values[6:])
    assert seen.device == device and len(others) == 8


def test_writes_are_seen(device: wp.Device) -> None:
    whole = wp.zeros((2, 4), dtype=wp.uint8, device=device)
    shared(whole, (2,), wp.uint32).fill_(0x04030201)
    np.testing.assert_array_equal(whole.numpy(), [[1, 2, 3, 4]] * 2)
