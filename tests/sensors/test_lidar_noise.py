"""Noise and dropout of lidars: their statistics against the formulas, and that they are drawn the same again."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from lidar_scenes import downward, floor, host

import warpcam as wc
from warpcam import sensors

SIDE = 500  # 250,000 rays in each of four worlds
HEIGHTS = np.array([2.0, 5.0, 9.0, 20.0])


def lidar_at(heights: np.ndarray, device: wp.Device, side: int = SIDE, **settings: Any) -> sensors.Lidar:
    """A lidar that looks straight down from a height of its own in each world."""
    places = np.zeros((len(heights), 3))
    places[:, 2] = heights
    scene = floor(len(heights), device)
    return sensors.Lidar(scene, downward(side), position=places, **{"outputs": ("ranges",), **settings})


def test_range_noise(device: wp.Device) -> None:
    """Mean and sigma of ranges, and how many lie within one sigma, two and three."""
    constant, linear, quadratic, offset = 0.01, -5e-4, 1.5e-4, np.array([0.0, 0.1, -0.1, 0.02])
    noise = sensors.LidarNoise(constant=constant, linear=linear, quadratic=quadratic, offset=offset)
    ranges = host(lidar_at(HEIGHTS, device, noise=noise).read())["ranges"].reshape(4, -1).astype(np.float64)
    sigma = constant + linear * HEIGHTS + quadratic * HEIGHTS**2
    deviations = (ranges - (HEIGHTS + offset)[:, None]) / sigma[:, None]
    assert np.abs(deviations.mean(axis=1)).max() < 5.0 / SIDE
    assert np.abs(deviations.std(axis=1) - 1.0).max() < 5.0 / SIDE
    for widths, share in ((1.0, 0.682689), (2.0, 0.954500), (3.0, 0.997300)):
        assert abs((np.abs(deviations) < widths).mean() - share) < 2e-3
    # Neighbours and worlds have nothing to do with each other.
    assert np.abs(np.corrcoef(deviations)[np.triu_indices(4, 1)]).max() < 5.0 / SIDE
    assert abs(np.corrcoef(deviations[:, 1:].ravel(), deviations[:, :-1].ravel())[0, 1]) < 5e-3


def test_sigma_is_at_least_zero(device: wp.Device) -> None:
    ranges = host(lidar_at(HEIGHTS[:1], device, 10, noise=sensors.LidarNoise(constant=0.1, linear=-1.0)).read())
    np.testing.assert_allclose(ranges["ranges"], 2.0, atol=1e-6)


@pytest.mark.parametrize("carla", [False, True])
def test_dropout(device: wp.Device, carla: bool) -> None:
    """Shares of lost returns at distances on both sides of the limit."""
    dropout = sensors.LidarDropout.carla() if carla else sensors.LidarDropout(0.2, 0.9, 0.7, 0.05)
    rate, limit, zero, attenuation = (0.45, 0.8, 0.4, 0.004) if carla else (0.2, 0.9, 0.7, 0.05)
    heights = np.array([10.0, 60.0, 200.0, 500.0]) if carla else np.array([1.0, 5.0, 20.0, 80.0])
    light = np.exp(-attenuation * heights)
    assert (light > limit).any() and (light < limit).any()
    kept = np.where(light > limit, 1.0, zero / limit * light + 1.0 - zero) * (1.0 - rate)
    ranges = host(lidar_at(heights, device, dropout=dropout).read())["ranges"].reshape(4, -1)
    np.testing.assert_allclose(np.isfinite(ranges).mean(axis=1), kept, atol=5.0 / SIDE / 2.0)
    seen = np.isfinite(ranges)
    np.testing.assert_allclose(ranges[seen], np.broadcast_to(heights[:, None], ranges.shape)[seen], rtol=1e-5)


def test_ranges_have_a_resolution(device: wp.Device) -> None:
    noise = sensors.LidarNoise(constant=0.2, resolution=0.03)
    ranges = host(lidar_at(HEIGHTS[:1], device, noise=noise).read())["ranges"].astype(np.float64)
    steps = ranges / 0.03
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)
    assert abs(ranges.std() - np.hypot(0.2, 0.03 / 12**0.5)) < 1e-3


def test_what_noise_moves_out_of_range_is_lost(device: wp.Device) -> None:
    pattern = sensors.patterns.Pattern(downward(100).directions, origins=downward(100).origins, max_range=2.0)
    lidar = sensors.Lidar(
        floor(1, device), pattern, position=(0, 0, 1.9), noise=sensors.LidarNoise(constant=0.1), outputs=("ranges",)
    )
    ranges = host(lidar.read())["ranges"]
    assert abs(np.isinf(ranges).mean() - 0.158655) < 0.02 and ranges[np.isfinite(ranges)].max() <= 2.0


NOISE = {"noise": sensors.LidarNoise(constant=0.05), "dropout": sensors.LidarDropout(rate=0.3)}


def test_a_world_measures_the_same_among_others(device: wp.Device) -> None:
    """Numbers follow from the seed, the world, how often it was read, and the ray alone."""
    many, few = (lidar_at(np.full(count, 2.0), device, 40, seed=7, **NOISE) for count in (5, 2))
    for _ in range(3):
        np.testing.assert_array_equal(host(many.read())["ranges"][:2], host(few.read())["ranges"])
    first, second = host(few.read())["ranges"], host(few.read())["ranges"]
    assert (first != second).mean() > 0.5 and (first[0] != first[1]).mean() > 0.5
    # Worlds that are read apart go on as if they were read together.
    many.read(worlds=[0, 3])
    many.read(worlds=[1])
    np.testing.assert_array_equal(host(many.scan)["ranges"][:2], first)
    other = lidar_at(np.full(2, 2.0), device, 40, seed=8, **NOISE)
    again = lidar_at(np.full(2, 2.0), device, 40, seed=7, **NOISE)
    mixed = lidar_at(np.full(2, 2.0), device, 40, seed=np.array([7, 8]), **NOISE)
    start, apart, both = (host(each.read())["ranges"] for each in (again, other, mixed))
    assert (start != apart).mean() > 0.5
    np.testing.assert_array_equal(both, np.stack((start[0], apart[1])))


def test_parameters_are_written_in_place(device: wp.Device) -> None:
    place = wp.device_to_torch(device)
    offset = torch.tensor([0.0, 0.5], device=place)
    lidar = lidar_at(np.full(2, 2.0), device, 20, noise=sensors.LidarNoise(offset=offset))
    assert np.allclose(host(lidar.read())["ranges"].mean(axis=(1, 2)), (2.0, 2.5))
    offset[0] = 0.25
    lidar.parameters.noise_resolution[:] = 0.75
    lidar.parameters.dropout_rate[1] = 1.0
    ranges = host(lidar.read())["ranges"]
    assert (ranges[0] == 2.25).all() and np.isinf(ranges[1]).all()
    lidar.parameters.noise_resolution[:] = 0.0
    lidar.parameters.dropout_rate[:] = 0.0
    wc.randomize(lidar.parameters, seed=3, noise_offset=(1.0, 2.0))
    drawn = lidar.parameters.noise_offset.cpu().numpy()
    assert (drawn >= 1.0).all() and (drawn <= 2.0).all() and drawn[0] != drawn[1]
    np.testing.assert_allclose(host(lidar.read())["ranges"][:, 3, 3], 2.0 + drawn, rtol=1e-6)
    with pytest.raises(wc.WarpcamError, match=r"dropout_rate: values must be from 0 to 1"):
        wc.randomize(lidar.parameters, dropout_rate=(0.0, 2.0))
