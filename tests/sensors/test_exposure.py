"""Exposure, gain and white balance against their formulas."""

import numpy as np
import pytest
import warp as wp
from measured_colors import measured, picture

import warpcam as wc
from warpcam import sensors


def test_exposure_multiplies_light(device: wp.Device) -> None:
    light = picture()
    effect = sensors.Exposure(stops=[1.5, -2.0], time=0.01, reference_time=[0.02, 0.005])
    factors = np.array([2.0**1.5 / 2.0, 0.25 * 2.0]).reshape(2, 1, 1, 1)
    assert np.allclose(measured(effect, light, device), factors * light, rtol=1e-5)


def test_gain_multiplies_light(device: wp.Device) -> None:
    light = picture()
    factors = np.array([0.3, 7.0])
    assert np.allclose(measured(sensors.Gain(factors), light, device), factors.reshape(2, 1, 1, 1) * light, rtol=1e-6)


def test_white_balance_multiplies_channels(device: wp.Device) -> None:
    light = picture()
    gains = np.array([[2.0, 1.0, 0.5], [0.1, 0.2, 0.3]])
    found = measured(sensors.WhiteBalance(gains), light, device)
    assert np.allclose(found, gains[:, None, None] * light, rtol=1e-6)


def test_temperatures_become_gains() -> None:
    """A 6,500 K body is nearly the white of sRGB; a cool one is red, a hot one blue."""
    gains = np.asarray(sensors.WhiteBalance.from_temperature([2856.0, 6500.0, 12000.0]).gains)
    assert (gains[:, 1] == 1.0).all()
    assert np.abs(gains[1] - 1.0).max() < 0.06
    assert gains[0, 0] < 0.7 and gains[0, 2] > 2.0
    assert gains[2, 0] > 1.15 and gains[2, 2] < 0.85
    # CIE standard illuminant A is a body of 2,856 K, at x = 0.44758 and y = 0.40745.
    light = np.linalg.inv(np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]))
    xyz = light @ (1.0 / gains[0])
    assert np.abs(xyz[:2] / xyz.sum() - (0.44758, 0.40745)).max() < 1e-3
    assert np.shape(sensors.WhiteBalance.from_temperature(5000.0).gains) == (3,)


@pytest.mark.parametrize("kelvin", [1000.0, 1800.0, 30000.0, float("nan"), [5000.0, 100.0], "warm"])
def test_temperatures_out_of_range_are_refused(kelvin: object) -> None:
    with pytest.raises(wc.WarpcamError, match=r"WhiteBalance.from_temperature: kelvin must be"):
        sensors.WhiteBalance.from_temperature(kelvin)
