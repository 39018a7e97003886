"""Noise of photons and electronics: statistics against formulas, and the linearity test of EMVA 1288."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from measured_colors import Bench, measured

from warpcam import sensors
from warpcam.kernels.runtime.compile import compiler_flags
from warpcam.sensors.kernels.electrons import few_electrons

wp.set_module_options(compiler_flags())

SIDE = 578  # 578 x 578 pixels of three channels are a million samples
CAMERA: dict[str, Any] = {
    "photons_at_white": 20000.0,
    "quantum_efficiency": 0.6,
    "full_well": 11000.0,
    "gain": 0.35,
    "dark_noise": 4.0,
    "bits": 12.0,
    "dark_current": 50.0,
    "exposure_time": 0.1,
    "black_level": 64.0,
}


def flat(light: Any, side: int = SIDE) -> np.ndarray:
    """Images of one colour each: (world, side, side, 3)."""
    return np.broadcast_to(np.reshape(light, (-1, 1, 1, 1)), (np.size(light), side, side, 3))


def numbers(light: np.ndarray, **changed: Any) -> np.ndarray:
    """Digital numbers of a measurement."""
    values = {**CAMERA, **changed}
    scale = values["gain"] * values["quantum_efficiency"] * values["photons_at_white"]
    return light.astype(np.float64) * scale + values["black_level"]


@pytest.mark.parametrize("mean", [0.1, 1.0, 3.99, 4.0, 7.0, 25.0, 60.0, 400.0, 12000.0])
def test_electrons_have_poissons_distribution(mean: float, device: wp.Device) -> None:
    electrons = 20000.0
    counts = np.rint(measured(sensors.ShotNoise(electrons), flat(mean / electrons), device) * electrons).ravel()
    assert counts.size > 1_000_000 and counts.min() >= 0.0
    error = 1.0 / math.sqrt(counts.size)
    assert abs(counts.mean() - mean) < 5.0 * error * math.sqrt(mean) + 1e-5 * mean
    kurtosis = 2.0 + 1.0 / mean
    assert abs(counts.var() / mean - 1.0) < 5.0 * error * math.sqrt(kurtosis) + 1e-3
    skewness = ((counts - mean) ** 3).mean() / mean**1.5
    assert abs(skewness - 1.0 / math.sqrt(mean)) < (0.02 if mean >= 1.0 else 0.1)
    values = np.arange(int(counts.max()) + 1)
    logarithms = values * math.log(mean) - mean - np.array([math.lgamma(value + 1.0) for value in values])
    expected = np.cumsum(np.exp(logarithms))
    found = np.cumsum(np.bincount(counts.astype(np.int64))) / counts.size
    assert np.abs(found - expected).max() < 5e-4 + 1.7 * error


@wp.kernel(enable_backward=False)
def count_few(means: wp.array(dtype=float), uniforms: wp.array(dtype=float), counts: wp.array(dtype=float)):
    place = wp.tid()
    counts[place] = few_electrons(means[place], uniforms[place])


def test_numbers_of_few_electrons_begin_where_the_distribution_function_says(device: wp.Device) -> None:
    means, order = np.meshgrid(np.float32([0.0, 0.001, 0.1, 0.5, 1.0, 2.0, 3.3, 3.9999]), np.arange(19))
    logarithms = order * np.log(np.maximum(means, 1e-30)) - means - np.vectorize(math.lgamma)(order + 1.0)
    ends = np.cumsum(np.exp(logarithms.astype(np.float64)), axis=0)  # chances of at most so many
    for shift in (-1e-6, 1e-6):
        uniforms = np.clip(ends + shift, 0.0, 1.0 - 2.0**-24)
        numbers = [wp.array(values.ravel(), dtype=float, device=device) for values in (means, uniforms)]
        counts = wp.zeros(order.size, dtype=float, device=device)
        wp.launch(count_few, order.size, [*numbers, counts], device=device)
        found, is_sure = counts.numpy().reshape(order.shape), ends + abs(shift) < 1.0 - 4e-7
        expected = np.array([[(ends[:, m] <= uniforms[n, m]).sum() for m in range(ends.shape[1])] for n in range(19)])
        assert (found == expected)[is_sure].all() and is_sure.sum() > 60


def test_dark_channels_are_independent_of_bright_ones(device: wp.Device) -> None:
    light = np.broadcast_to(np.float32([2.0, 50.0, 3.0]) / 5000.0, (1, SIDE, SIDE, 3))
    counts = np.rint(measured(sensors.ShotNoise(5000.0), light, device) * 5000.0).reshape(-1, 3)
    assert np.abs(counts.mean(axis=0) / [2.0, 50.0, 3.0] - 1.0).max() < 0.01
    assert np.abs(counts.var(axis=0) / [2.0, 50.0, 3.0] - 1.0).max() < 0.02
    assert np.abs(np.corrcoef(counts.T) - np.eye(3)).max() < 0.01
    squares = (counts - counts.mean(axis=0)) ** 2
    assert np.abs(np.corrcoef(squares.T) - np.eye(3)).max() < 0.01


def test_no_light_gives_no_electrons(device: wp.Device) -> None:
    assert (measured(sensors.ShotNoise(1000.0), flat([0.0, -1.0], 8), device) == 0.0).all()


def test_the_camera_has_the_gain_that_was_put_in(device: wp.Device) -> None:
    """EMVA 1288's photon transfer: temporal variance over mean, both without the dark's, is a line of slope K."""
    for gain, black in ((0.35, 64.0), (0.2, 16.0)):
        light = np.linspace(0.0, 0.55, 12)
        bench = Bench(sensors.Emva1288(**{**CAMERA, "gain": gain, "black_level": black}), flat(light, 170), device)
        pair = [numbers(bench(), gain=gain, black_level=black) for _ in range(2)]
        mean = (0.5 * (pair[0] + pair[1])).mean(axis=(1, 2, 3))
        variance = 0.5 * ((pair[0] - pair[1]) ** 2).mean(axis=(1, 2, 3))
        x, y = mean - mean[0], variance - variance[0]
        slope = (x * y).sum() / (x * x).sum()
        assert abs(slope / gain - 1.0) < 0.02
        efficiency = np.polyfit(light * CAMERA["photons_at_white"], mean, 1)[0] / slope
        assert abs(efficiency / CAMERA["quantum_efficiency"] - 1.0) < 0.02
        dark_variance = gain**2 * (CAMERA["dark_noise"] ** 2 + 5.0) + 1.0 / 12.0
        assert abs(variance[0] / dark_variance - 1.0) < 0.03
        assert abs(mean[0] - black - gain * 5.0) < 0.03


def test_a_full_well_and_the_converter_saturate(device: wp.Device) -> None:
    full = numbers(measured(sensors.Emva1288(**CAMERA), flat(2.0, 64), device))
    assert abs(full.mean() - (0.35 * 11000.0 + 64.0)) < 0.2 and abs(full.std() - 0.35 * 4.0) < 0.1
    converted = numbers(measured(sensors.Emva1288(**{**CAMERA, "bits": 8.0}), flat(2.0, 64), device))
    assert np.abs(converted - 255.0).max() < 0.01
    deep = {**CAMERA, "black_level": 0.0}
    dark = numbers(measured(sensors.Emva1288(**deep), flat(0.0, 64), device), black_level=0.0)
    assert abs(dark.min()) < 0.01


def test_digital_numbers_are_whole(device: wp.Device) -> None:
    found = numbers(measured(sensors.Emva1288(**CAMERA), flat([0.1, 0.4], 64), device))
    assert np.abs(found - np.rint(found)).max() < 0.01 and len(np.unique(np.rint(found))) > 50


def test_read_noise_is_normal(device: wp.Device) -> None:
    found = (measured(sensors.ReadNoise(0.02), flat(0.3), device) - 0.3).ravel() / 0.02
    assert abs(found.mean()) < 0.005 and abs(found.std() - 1.0) < 0.005
    assert abs((found**3).mean()) < 0.02 and abs((found**4).mean() - 3.0) < 0.05
    channels = found.reshape(-1, 3)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        assert abs(np.corrcoef(channels[:, one], channels[:, other])[0, 1]) < 0.01


@pytest.mark.parametrize("effect", [sensors.ShotNoise(800.0), sensors.ReadNoise(0.1), sensors.Emva1288(**CAMERA)])
def test_noise_is_new_in_each_frame_and_world(effect: sensors.Effect, device: wp.Device) -> None:
    bench = Bench(effect, flat([0.3, 0.3], 64), device)
    first, second = bench(), bench()
    for one, other in ((first[0], first[1]), (first, second)):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.05
    again = Bench(effect, flat([0.3, 0.3, 0.3], 64), device)
    assert (again()[:2] == first).all() and (again()[:2] == second).all()
    assert not (measured(effect, flat([0.3, 0.3], 64), device, seed=1) == first).all()
