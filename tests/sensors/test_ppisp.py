"""PPISP against its formula, and its inputs by Isaac Lab's names."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import warp as wp
from measured_colors import measured, picture

import warpcam as wc
from warpcam import sensors

# Inputs that Isaac Lab's isaaclab_ppisp has, with its defaults.
DEFAULTS: Mapping[str, Any] = {
    "responsivity": 1.0,
    "exposureOffset": 0.0,
    **{f"vignettingCenter{channel}": (0.0, 0.0) for channel in "RGB"},
    **{f"vignettingAlpha{power}{channel}": 0.0 for channel in "RGB" for power in (1, 2, 3)},
    **{f"colorLatent{color}": (0.0, 0.0) for color in ("Blue", "Red", "Green", "Neutral")},
    **{f"crfToe{channel}": 0.013659 for channel in "RGB"},
    **{f"crfShoulder{channel}": 0.013659 for channel in "RGB"},
    **{f"crfGamma{channel}": 0.378165 for channel in "RGB"},
    **{f"crfCenter{channel}": 0.0 for channel in "RGB"},
}
SOME: Mapping[str, Any] = {
    **DEFAULTS,
    "responsivity": 1.3,
    "exposureOffset": -0.6,
    "vignettingCenterR": (0.1, -0.05),
    "vignettingCenterB": (0.0, 0.2),
    "vignettingAlpha1R": -0.8,
    "vignettingAlpha2R": 0.3,
    "vignettingAlpha3G": -1.5,
    "vignettingAlpha1B": -2.0,
    "colorLatentBlue": (1.0, -2.0),
    "colorLatentRed": (-1.5, 0.5),
    "colorLatentGreen": (0.7, 1.1),
    "colorLatentNeutral": (3.0, -2.0),
    "crfToeG": 0.8,
    "crfShoulderB": -1.0,
    "crfGammaR": 1.0,
    "crfCenterG": -0.7,
}
SPREADS = {
    "Blue": [[0.0480542, -0.0043631], [-0.0043631, 0.0481283]],
    "Red": [[0.0580570, -0.0179872], [-0.0179872, 0.0431061]],
    "Green": [[0.0433336, -0.0180537], [-0.0180537, 0.0580500]],
    "Neutral": [[0.0128369, -0.0034654], [-0.0034654, 0.0128158]],
}
PLACES = {"Blue": (0.0, 0.0), "Red": (1.0, 0.0), "Green": (0.0, 1.0), "Neutral": (1 / 3, 1 / 3)}


def homography(inputs: Mapping[str, Any]) -> np.ndarray:
    """Matrix of (red, green, sum), up to its scale, that moves four chromaticities."""
    moved = {name: np.add(PLACES[name], np.dot(SPREADS[name], inputs[f"colorLatent{name}"])) for name in PLACES}
    corners = [np.array([*moved[name], 1.0]) for name in ("Blue", "Red", "Green")]
    before = np.array([[*PLACES[name], 1.0] for name in ("Blue", "Red", "Green")]).T
    weights = np.linalg.solve(np.array(corners).T, [*moved["Neutral"], 1.0])
    return (np.array(corners).T * weights) @ np.linalg.inv(before)


def processed(light: np.ndarray, inputs: Mapping[str, Any]) -> np.ndarray:
    """One image (height, width, 3)."""
    height, width = light.shape[:2]
    value = light.astype(np.float64) * inputs["responsivity"] * 2.0 ** inputs["exposureOffset"]
    y, x = (np.mgrid[:height, :width] + 0.5 - np.reshape([height / 2, width / 2], (2, 1, 1))) / max(width, height)
    for k, channel in enumerate("RGB"):
        cx, cy = inputs[f"vignettingCenter{channel}"]
        square = (x - cx) ** 2 + (y - cy) ** 2
        powers = [inputs[f"vignettingAlpha{power}{channel}"] for power in (3, 2, 1)]
        value[..., k] *= np.clip(np.polyval([*powers, 1.0], square), 0.0, 1.0)
    total = value.sum(axis=-1, keepdims=True)
    image = np.concatenate([value[..., :2], total], axis=-1) @ homography(inputs).T
    image *= total / image[..., 2:]
    value = np.concatenate([image[..., :2], image[..., 2:] - image[..., :1] - image[..., 1:2]], axis=-1)
    for k, channel in enumerate("RGB"):
        raw = [inputs[f"crf{name}{channel}"] for name in ("Toe", "Shoulder", "Gamma", "Center")]
        p, q, g = np.array([0.3, 0.3, 0.1]) + np.log1p(np.exp(raw[:3]))
        c = 1.0 / (1.0 + np.exp(-raw[3]))
        a, bounded = q * c / ((q - p) * c + p), np.clip(value[..., k], 0.0, 1.0)
        low = a * (np.minimum(bounded, c) / c) ** p
        high = 1.0 - (1.0 - a) * ((1.0 - np.maximum(bounded, c)) / (1.0 - c)) ** q
        value[..., k] = np.where(bounded <= c, low, high) ** g
    return value


@pytest.mark.parametrize("inputs", [DEFAULTS, SOME], ids=["defaults", "some"])
def test_images_are_those_of_the_formula(inputs: Mapping[str, Any], device: wp.Device) -> None:
    light = 1.5 * picture()
    found = measured(sensors.Ppisp.from_inputs(inputs), light, device)
    for world in range(2):
        assert np.abs(found[world] - processed(light[world], inputs)).max() < 1e-3
        assert np.abs(found[world] - processed(light[world], inputs)).mean() < 5e-5


def test_each_input_has_its_place(device: wp.Device) -> None:
    light = picture(worlds=1)
    base = {
        f"{name}{channel}": value for channel in "RGB" for name, value in (("vignettingAlpha1", -0.5), ("crfToe", 1.0))
    }
    before = measured(sensors.Ppisp.from_inputs(base), light, device)[0]
    for name, default in DEFAULTS.items():
        value = (1.0, -2.0) if isinstance(default, tuple) else default + 0.7
        inputs = {**base, name: value}
        found = measured(sensors.Ppisp.from_inputs(inputs), light, device)[0]
        assert np.abs(found - processed(light[0], {**DEFAULTS, **inputs})).max() < 1e-3, name
        assert np.abs(found - before).max() > 0.01, name


def test_nothing_changes_by_default(device: wp.Device) -> None:
    light = picture()
    assert np.abs(measured(sensors.Ppisp(), light, device) - light).max() < 1e-4
    assert vars(sensors.Ppisp.from_inputs({})) == vars(sensors.Ppisp())
    assert vars(sensors.Ppisp.from_inputs(DEFAULTS)) == vars(sensors.Ppisp())


def test_black_stays_black(device: wp.Device) -> None:
    assert (measured(sensors.Ppisp.from_inputs(SOME), np.zeros((1, 4, 4, 3)), device) == 0.0).all()


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"crfToe": 0.1}, "input 'crfToe' came, allowed are responsivity, exposureOffset, vignettingCenterR"),
        ({"colorLatentBlue": 0.1}, "colorLatentBlue must be two numbers, got 0.1"),
        ({"colorLatentBlue": (0.1, 0.2, 0.3)}, "colorLatentBlue must be two numbers"),
        ({"responsivity": "high"}, "responsivity must be a number, got 'high'"),
    ],
)
def test_bad_inputs_are_refused(inputs: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        sensors.Ppisp.from_inputs(inputs)
