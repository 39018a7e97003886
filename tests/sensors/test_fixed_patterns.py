"""Fixed patterns: statistics, equal in all frames, others in each world."""

import numpy as np
import pytest
import warp as wp
from measured_colors import Bench, measured

from warpcam import sensors

PATTERNS = [sensors.Prnu(0.05), sensors.Dsnu(0.05), sensors.DeadPixels(dead=0.1, hot=0.1, level=2.0)]


def flat(light: float, worlds: int = 2, side: int = 64) -> np.ndarray:
    return np.full((worlds, side, side, 3), light, np.float32)


@pytest.mark.parametrize("effect", PATTERNS)
def test_patterns_stay_from_frame_to_frame_and_differ_between_worlds(effect: sensors.Effect, device: wp.Device) -> None:
    bench = Bench(effect, flat(0.4), device)
    first = bench()
    assert (first == bench()).all()
    assert abs(np.corrcoef(first[0].ravel(), first[1].ravel())[0, 1]) < 0.05
    assert (measured(effect, flat(0.4, 3), device)[:2] == first).all()
    assert abs(np.corrcoef(first.ravel(), measured(effect, flat(0.4), device, seed=7).ravel())[0, 1]) < 0.05


def test_gains_vary_about_one(device: wp.Device) -> None:
    found = measured(sensors.Prnu([0.02, 0.1]), flat(0.4, side=420), device) / 0.4 - 1.0
    for world, sigma in enumerate((0.02, 0.1)):
        assert abs(found[world].mean()) < 0.006 * sigma + 1e-6 and abs(found[world].std() / sigma - 1.0) < 0.006
    assert (measured(sensors.Prnu(0.1), flat(0.0), device) == 0.0).all()


def test_dark_signal_is_added_whatever_the_light(device: wp.Device) -> None:
    dark, bright = (measured(sensors.Dsnu(0.02), flat(light, 1, 578), device) - light for light in (0.0, 0.5))
    assert np.abs(dark - bright).max() < 1e-6
    assert abs(dark.mean()) < 1e-4 and abs(dark.std() - 0.02) < 1e-4


def test_shares_of_dead_and_hot_pixels(device: wp.Device) -> None:
    effect = sensors.DeadPixels(dead=[0.01, 0.0], hot=[0.002, 0.05], level=1.5)
    found = measured(effect, flat(0.4, side=708), device)
    for world, (dead, hot) in enumerate(((0.01, 0.002), (0.0, 0.05))):
        pixels = found[world].reshape(-1, 3)
        for value, share in ((0.0, dead), (1.5, hot), (np.float32(0.4), 1.0 - dead - hot)):
            assert abs((pixels == value).all(axis=-1).mean() - share) <= 5.0 * (share * (1.0 - share) / 500_000) ** 0.5
