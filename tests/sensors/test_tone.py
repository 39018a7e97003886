"""Tone curves and quantisation against their formulas."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from measured_colors import measured, picture
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.core.color import linear_to_srgb, srgb_to_linear

LIGHT = 1.6 * picture() - 0.1  # below black and above white, too


def softplus(raw: Any) -> np.ndarray:
    return np.log1p(np.exp(raw))


def response(light: np.ndarray, toe: Any, shoulder: Any, gamma: Any, center: Any) -> np.ndarray:
    """PPISP's response: c is where the parts meet, a how high."""
    x = np.clip(light, 0.0, 1.0)
    p, q, g, c = 0.3 + softplus(toe), 0.3 + softplus(shoulder), 0.1 + softplus(gamma), 1.0 / (1.0 + np.exp(-center))
    a = q * c / ((q - p) * c + p)
    low = a * (np.minimum(x, c) / c) ** p
    high = 1.0 - (1.0 - a) * ((1.0 - np.maximum(x, c)) / (1.0 - c)) ** q
    return np.where(x <= c, low, high) ** g


def test_a_curve_without_points_is_that_of_srgb(device: wp.Device) -> None:
    assert np.allclose(measured(sensors.ToneCurve(), LIGHT, device), linear_to_srgb(LIGHT), atol=2e-6)


@pytest.mark.parametrize("count", [2, 3, 9])
def test_points_are_joined_by_lines(count: int, device: wp.Device) -> None:
    x = np.linspace(0.0, 1.2, count) ** 1.5
    points = np.stack([x, np.sqrt(x) / 1.2], axis=-1)
    found = measured(sensors.ToneCurve(points), LIGHT, device)
    assert np.allclose(found, np.interp(LIGHT, points[:, 0], points[:, 1]), atol=1e-5)


def test_points_of_each_world(device: wp.Device) -> None:
    light = np.array([0.0, 0.3, 1.0])
    points = np.stack([np.stack([light**power, light], axis=-1) for power in (1.0, 2.0)])
    found = measured(sensors.ToneCurve(points), LIGHT, device)
    for world in range(2):
        expected = np.interp(LIGHT[world], points[world, :, 0], points[world, :, 1])
        assert np.allclose(found[world], expected, atol=1e-5)


def test_points_are_written_in_place_and_drawn(device: wp.Device) -> None:
    points = torch.tensor([[(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)]] * 3, device=wp.device_to_torch(device))
    renderer = wc.Renderer(scene_of(device, 3), [camera(outputs=("rgb",))])
    rig = sensors.Rig(renderer, {"top": [sensors.ToneCurve(points)]})
    parameters = rig.parameters("top")
    assert parameters.tone_curve_points.data_ptr() == points.data_ptr()
    points[1, :, 1] = 0.25
    colors = rig.read()["top"]["rgb"].cpu().numpy()
    assert (colors[1] == 64).all() and (colors[[0, 2]] != 64).any()
    low, high = ((0.0, 0.0), (0.5, 0.2), (1.0, 0.6)), ((0.0, 0.0), (0.5, 0.4), (1.0, 0.9))
    wc.randomize(parameters, tone_curve_points=(low, high), seed=1)
    drawn = points.cpu().numpy()
    assert (drawn[:, :, 0] == (0.0, 0.5, 1.0)).all() and len(np.unique(drawn[:, 1, 1])) == 3
    assert (drawn >= np.float32(low)).all() and (drawn <= np.float32(high)).all()
    light = srgb_to_linear(renderer.images["top"]["rgb"].cpu().numpy() / 255.0)
    for world, colors in enumerate(rig.read()["top"]["rgb"].cpu().numpy()):
        expected = 255.0 * np.interp(light[world], *drawn[world].T)
        np.testing.assert_allclose(colors, expected, atol=0.51)


def test_gamma_is_a_power(device: wp.Device) -> None:
    found = measured(sensors.GammaCurve([2.2, 1.0]), LIGHT, device)
    expected = np.clip(LIGHT, 0.0, 1.0) ** np.array([1.0 / 2.2, 1.0]).reshape(2, 1, 1, 1)
    assert np.allclose(found, expected, atol=1e-5)


def test_a_response_has_a_toe_and_a_shoulder(device: wp.Device) -> None:
    rows = {
        "toe": [(0.5, -1.0, 2.0), (0.0, 0.1, 0.2)],
        "shoulder": [(1.0, 0.0, -2.0), (0.3, 0.3, 0.3)],
        "gamma": [(-0.3, 0.4, 0.0), (0.1, 0.2, 0.9)],
        "center": [(0.0, 1.0, -1.5), (2.0, -2.0, 0.0)],
    }
    found = measured(sensors.ResponseCurve(**rows), LIGHT, device)
    for world in range(2):
        expected = response(
            LIGHT[world].astype(np.float64), **{name: np.array(row[world]) for name, row in rows.items()}
        )
        assert np.allclose(found[world], expected, atol=1e-5)


def test_a_response_changes_nothing_by_default(device: wp.Device) -> None:
    assert np.allclose(measured(sensors.ResponseCurve(), LIGHT, device), np.clip(LIGHT, 0.0, 1.0), atol=1e-5)


def test_extreme_responses_are_finite(device: wp.Device) -> None:
    for value in (-200.0, 200.0):
        curve = sensors.ResponseCurve(*(((value,) * 3,) * 4))
        assert np.isfinite(measured(curve, LIGHT, device)).all()


def test_display_colors_have_steps(device: wp.Device) -> None:
    found = measured(sensors.Quantization([2.6, 8.0]), LIGHT, device)
    for world, steps in enumerate((7.0, 255.0)):
        expected = np.floor(np.clip(LIGHT[world], 0.0, 1.0) * steps + 0.5) / steps
        assert (np.abs(found[world] - expected) < 1e-6).mean() > 0.999
        assert np.abs(found[world] - np.clip(LIGHT[world], 0.0, 1.0)).max() <= 0.5 / steps + 1e-6


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            [(0.0, 0.0)],
            r"points must have shape \(point, 2\) or \(world, point, 2\), two points at least, got \(1, 2\)",
        ),
        ([0.0, 1.0], r"points must have shape \(point, 2\)"),
        ([(0.0, 0.0), (0.0, 1.0)], "points must be finite, their light growing"),
        ([(0.0, 0.0), (float("nan"), 1.0)], "points must be finite"),
        ("filmic", "points must be numbers"),
        (np.zeros((2, 3, 3)), r"points must have shape \(point, 2\) or \(world, point, 2\), .* got \(2, 3, 3\)"),
        (
            np.linspace((0.0, 0.0), (1.0, 1.0), 4) + np.zeros((3, 1, 1)),
            r"points must have shape \(4, 2\) or \(2, 4, 2\), got \(3, 4, 2\)",
        ),
        ([[(0.0, 0.0), (1.0, 1.0)], [(1.0, 0.0), (0.0, 1.0)]], "points must be finite, their light growing"),
    ],
)
def test_bad_points_are_refused(points: Any, message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        measured(sensors.ToneCurve(points), LIGHT, wp.get_device("cpu"))
