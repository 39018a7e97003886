"""Noise of depth against its formulas, over a million samples each."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from depth_frames import FOCAL, DepthBench, tilted

from warpcam import sensors

SHAPE = (4, 500, 500)


def plane(depth: float) -> np.ndarray:
    return np.full(SHAPE, depth, np.float32)


def noise(effect: sensors.Effect, device: wp.Device, depth: float, **options: Any) -> np.ndarray:
    return DepthBench(effect, device, **options).measure(plane(depth)).astype(np.float64) - depth


def assert_gaussian(samples: np.ndarray, mean: float, sigma: float) -> None:
    """Mean, standard deviation, skewness and tails of a million samples."""
    count = samples.size
    assert count >= 10**6
    assert abs(samples.mean() - mean) < 5.0 * sigma / count**0.5
    assert abs(samples.std() / sigma - 1.0) < 0.004
    scaled = (samples - mean) / sigma
    assert abs((scaled**3).mean()) < 0.015 and abs((scaled**4).mean() - 3.0) < 0.06
    assert abs((np.abs(scaled) > 2.0).mean() - 0.0455) < 0.0015


@pytest.mark.parametrize("depth", [0.5, 1.5, 3.0])
def test_polynomial_noise(device: wp.Device, depth: float) -> None:
    effect = sensors.PolynomialNoise(constant=0.001, linear=0.002, quadratic=0.003, offset=-0.02)
    assert_gaussian(noise(effect, device, depth), -0.02, 0.001 + 0.002 * depth + 0.003 * depth**2)


@pytest.mark.parametrize(("depth", "sigma"), [(0.3, 0.0005), (0.5, 0.0005), (2.5, 0.0025)])
def test_azure_kinect_noise(device: wp.Device, depth: float, sigma: float) -> None:
    assert_gaussian(noise(sensors.AzureKinectNoise(), device, depth), 0.0, sigma)


def test_axial_noise_grows_with_depth_and_angle(device: wp.Device) -> None:
    for depth in (0.5, 1.5, 3.0):
        samples = noise(sensors.AxialNoise(angular=0.0), device, depth, normal=tilted(60.0))
        assert_gaussian(samples, 0.0, 0.0012 + 0.0019 * (depth - 0.4) ** 2)
    bench = DepthBench(sensors.AxialNoise(), device, normal=tilted(75.0))
    depth = np.full((100_000, 2, 5), 2.0, np.float32)  # few pixels: the rays' angles are almost those of the middle
    theta = np.radians(75.0)
    sigma = 0.0012 + 0.0019 * 1.6**2 + 0.0001 / 2.0**0.5 * (theta / (np.pi / 2.0 - theta)) ** 2
    assert_gaussian(bench.measure(depth).astype(np.float64) - 2.0, 0.0, sigma)


def test_the_angle_is_that_of_the_pixels_ray(device: wp.Device) -> None:
    effect = sensors.AxialNoise(constant=0.0, quadratic=0.0, angular=0.01)
    samples = DepthBench(effect, device).measure(np.full((8000, 1, 401), 1.0, np.float32)) - 1.0
    for column in (0, 100, 399):
        theta = np.arctan(abs(column + 0.5 - 200.5) / FOCAL)
        expected = 0.01 * (theta / (np.pi / 2.0 - theta)) ** 2
        assert abs(samples[:, 0, column].std() / expected - 1.0) < 0.04
    assert (samples[:, 0, 200] == 0.0).all()


@pytest.mark.parametrize(
    "effect",
    [
        sensors.AxialNoise(constant=0.0, quadratic=0.0, angular=0.1),
        sensors.LateralNoise(constant=0.0, angular=1.0),
        sensors.GrazingDropout(start=10.0, end=20.0),
    ],
)
def test_depth_without_a_normal_is_seen_head_on(device: wp.Device, effect: sensors.Effect) -> None:
    depth = np.linspace(1.0, 2.0, 64).reshape(1, 8, 8)
    measured = DepthBench(effect, device, normal=(0.0, 0.0, 0.0)).measure(depth)
    np.testing.assert_array_equal(measured, depth.astype(np.float32))
    tilt = DepthBench(effect, device, normal=tilted(80.0)).measure(depth)
    assert (tilt != depth.astype(np.float32)).mean() > 0.5


def test_lateral_noise_is_that_of_the_lookup(device: wp.Device) -> None:
    columns = np.arange(500, dtype=np.float32) + 1.0
    ramp = np.broadcast_to(columns, SHAPE)
    for angle, constant in ((0.0, 0.8), (0.0, 2.5)):
        effect = sensors.LateralNoise(constant=constant, angular=0.0)
        moved = (DepthBench(effect, device, normal=tilted(angle)).measure(ramp) - ramp)[:, 20:-20, 20:-20]
        assert abs(moved.mean()) < 0.01
        assert abs(moved.var() - (constant**2 + 1.0 / 12.0)) < 0.01 * (constant**2 + 1.0 / 12.0)
    bench = DepthBench(sensors.LateralNoise(constant=0.0, angular=0.5), device, normal=tilted(70.0))
    block = np.broadcast_to(np.arange(101, dtype=np.float32) + 1.0, (5000, 3, 101))
    theta = np.radians(70.0)
    sigma = 0.5 * theta / (np.pi / 2.0 - theta)
    moved = (bench.measure(block) - block)[:, 1, 50]
    assert abs(moved.var() / (sigma**2 + 1.0 / 12.0) - 1.0) < 0.06


def test_shifted_lookup_is_bilinear(device: wp.Device) -> None:
    rows, columns = np.mgrid[0:500, 0:500].astype(np.float32)
    ramp = np.broadcast_to(10.0 + 0.5 * columns + 0.25 * rows, SHAPE)
    moved = (DepthBench(sensors.ShiftedLookup(sigma=2.0), device).measure(ramp) - ramp)[:, 20:-20, 20:-20]
    assert abs(moved.mean()) < 0.01
    assert abs(moved.std() / (2.0 * np.hypot(0.5, 0.25)) - 1.0) < 0.005
    coarse = sensors.ShiftedLookup(sigma=2.0, focal_length=4.0 * FOCAL)
    moved = (DepthBench(coarse, device).measure(ramp) - ramp)[:, 20:-20, 20:-20]
    assert abs(moved.std() / (0.5 * np.hypot(0.5, 0.25)) - 1.0) < 0.005


@pytest.mark.parametrize("lateral", [False, True])
@pytest.mark.parametrize(
    ("focals", "across", "down"),
    [
        ((), 1.0, 1.0),
        ((2.0 * FOCAL,), 0.5, 1.5),
        ((0.5 * FOCAL, 1.5 * FOCAL), 2.0, 2.0),
        ((0.0, 1.5 * FOCAL), 1.0, 2.0),
    ],
)
def test_lookups_in_images_of_another_aspect(
    lateral: bool, focals: tuple[float, ...], across: float, down: float, device: wp.Device
) -> None:
    """Pixels of an image that is squeezed are as many pixels of the sensor across and down as they are."""
    names = ("focal_length", "focal_length_y")
    options = dict(zip(names, focals, strict=False))
    effect = sensors.LateralNoise(2.0, 0.0, **options) if lateral else sensors.ShiftedLookup(2.0, **options)
    for axis, expected in ((0, down), (1, across)):
        ramp = np.broadcast_to(np.mgrid[0:500, 0:500][axis] + 1.0, SHAPE)
        found = DepthBench(effect, device, focal_y=3.0 * FOCAL).measure(ramp)
        moved = (found - ramp)[:, 20:-20, 20:-20]
        variance = (2.0 * expected) ** 2 + (1.0 / 12.0 if lateral else 0.0)
        assert abs(moved.var() / variance - 1.0) < 0.015


@pytest.mark.parametrize("focal", [0.0, 640.0])
def test_disparity_noise(device: wp.Device, focal: float) -> None:
    effect = sensors.DisparityNoise(baseline=0.05, sigma=0.1, bias=0.25, focal_length=focal)
    scale = (focal or FOCAL) * 0.05
    measured = DepthBench(effect, device).measure(plane(1.5)).astype(np.float64)
    assert_gaussian(scale / measured - scale / 1.5, 0.25, 0.1)
    small = sensors.DisparityNoise(baseline=0.05, sigma=0.01, focal_length=640.0)
    assert abs(noise(small, device, 2.0).std() / (2.0**2 * 0.01 / (640.0 * 0.05)) - 1.0) < 0.005


def test_disparity_noise_is_shared_within_cells(device: wp.Device) -> None:
    effect = sensors.DisparityNoise(baseline=0.05, sigma=0.1, cell=4.0)
    measured = DepthBench(effect, device).measure(np.full((1, 10, 14), 1.0))[0]
    assert (measured[:4, :4] == measured[0, 0]).all() and (measured[8:, 12:] == measured[8, 12]).all()
    assert len(np.unique(measured)) == 12


def test_a_disparity_below_zero_is_no_measurement(device: wp.Device) -> None:
    effect = sensors.DisparityNoise(baseline=0.05, sigma=0.1)
    measured = DepthBench(effect, device).measure(plane(100.0))  # 0.1 pixels
    assert abs((measured == 0.0).mean() - 0.1587) < 0.002 and (measured >= 0.0).all()


def test_disparity_comes_in_steps(device: wp.Device) -> None:
    depth = np.linspace(0.2, 60.0, 500 * 500 * 4).reshape(SHAPE)
    measured = DepthBench(sensors.DisparityQuantization(baseline=0.05, step=0.125), device).measure(depth)
    steps = np.floor(FOCAL * 0.05 / depth / 0.125 + 0.5)
    with np.errstate(divide="ignore"):
        expected = np.where(steps > 0, FOCAL * 0.05 / (steps * 0.125), 0.0)
    off = np.abs(measured - expected) > 1e-5 * expected
    assert off.mean() < 1e-4 and np.unique(steps).size > 300
    exact = DepthBench(sensors.DisparityQuantization(baseline=0.05, step=0.0), device).measure(depth)
    assert (exact == depth.astype(np.float32)).all()


def test_the_kinect_of_barron_and_malik_is_noise_and_steps_of_a_disparity(device: wp.Device) -> None:
    """simkinect's last line: 351.3 m / round(351.3 m / z + N(0, 1/6) + 0.5)."""
    pixel = {"baseline": 0.075, "focal_length": 351.3 / 8.0 / 0.075}
    noise = sensors.DisparityNoise(sigma=1.0 / 48.0, bias=1.0 / 16.0, **pixel)
    steps = sensors.DisparityQuantization(step=1.0 / 8.0, **pixel)
    depth = np.linspace(1.0, 4.0, 10**6).reshape(SHAPE)
    measured = DepthBench(steps, device).measure(DepthBench(noise, device).measure(depth)).astype(np.float64)
    drawn = np.random.default_rng(0).normal(0.0, 1.0 / 6.0, SHAPE)
    expected = 351.3 / np.round(351.3 / depth + drawn + 0.5)
    assert np.abs(351.3 / measured - np.round(351.3 / measured)).max() < 1e-3
    for some in np.array_split(np.arange(10**6), 10):
        errors = [(each.ravel()[some] - depth.ravel()[some]) for each in (measured, expected)]
        assert abs(errors[0].mean() - errors[1].mean()) < 0.01 * errors[1].std()
        assert abs(errors[0].std() / errors[1].std() - 1.0) < 0.01


def test_bias(device: wp.Device) -> None:
    measured = DepthBench(sensors.DepthBias(offset=-0.5, scale=1.01), device).measure(plane(2.0))
    assert np.allclose(measured, 1.52)
    assert (DepthBench(sensors.DepthBias(offset=-3.0), device).measure(plane(2.0)) == 0.0).all()


@pytest.mark.parametrize(("relaxation", "variance"), [(0.0, 20.0), (0.3, (1.0 - 0.49**20) / 0.51)])
def test_drift_walks_from_frame_to_frame(device: wp.Device, relaxation: float, variance: float) -> None:
    bench = DepthBench(sensors.DepthDrift(sigma=0.01, relaxation=relaxation), device)
    depth = np.full((50000, 1, 2), 3.0)
    drift = [bench.measure(depth) - 3.0 for _ in range(20)]
    assert all((each[..., 0] == each[..., 1]).all() for each in drift)
    last = np.array([each[:, 0, 0] for each in drift], np.float64)
    steps = np.diff(last, axis=0) + relaxation * last[:-1]
    assert abs(steps.std() / 0.01 - 1.0) < 0.004 and abs(last[-1].std() / (0.01 * variance**0.5) - 1.0) < 0.02
    assert abs(np.corrcoef(steps[3], steps[4])[0, 1]) < 0.02


def test_a_fixed_pattern_stays(device: wp.Device) -> None:
    bench = DepthBench(sensors.DepthFixedPattern(constant=0.01, linear=0.002), device)
    first, second = bench.measure(plane(2.0)), bench.measure(plane(2.0))
    assert (first == second).all()
    assert_gaussian(first.astype(np.float64) - 2.0, 0.0, 0.014)
    other = DepthBench(bench.effect, device, seed=1).measure(plane(2.0))
    assert abs(np.corrcoef((first - 2.0).ravel(), (other - 2.0).ravel())[0, 1]) < 0.005
