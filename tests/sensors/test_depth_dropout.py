"""Pixels without a measurement, and those that mix two depths."""

import numpy as np
import pytest
import warp as wp
from depth_frames import FOCAL, DepthBench, tilted

from warpcam import sensors

SHAPE = (4, 500, 500)


def step_image(near: float = 1.0, far: float = 2.0) -> np.ndarray:
    """Worlds whose left half is near and whose right half is far."""
    image = np.full(SHAPE, near)
    image[..., 250:] = far
    return image


def test_random_dropout_has_its_rate(device: wp.Device) -> None:
    rates = np.array([0.0, 0.01, 0.3, 1.0])
    measured = DepthBench(sensors.RandomDropout(rates), device).measure(np.full(SHAPE, 2.0))
    assert np.isin(measured, (0.0, 2.0)).all()
    found = (measured == 0.0).mean(axis=(1, 2))
    assert (np.abs(found - rates) <= 5.0 * np.sqrt(rates * (1.0 - rates) / 250_000)).all()
    blocks = DepthBench(sensors.RandomDropout(0.3, cell=5.0), device).measure(np.full(SHAPE, 2.0))
    cells = blocks.reshape(4, 100, 5, 100, 5)
    assert (cells == cells[:, :, :1, :, :1]).all() and abs((blocks == 0.0).mean() - 0.3) < 0.012


def test_edges_are_dropped(device: wp.Device) -> None:
    dropped = DepthBench(sensors.EdgeDropout(threshold=0.8), device).measure(step_image()) == 0.0
    assert dropped[..., 249:251].all() and dropped.sum() == 2 * 500 * 4
    assert not (DepthBench(sensors.EdgeDropout(threshold=1.2), device).measure(step_image()) == 0.0).any()
    some = DepthBench(sensors.EdgeDropout(0.5, probability=0.25), device).measure(step_image()) == 0.0
    assert abs(some[..., 249:251].mean() - 0.25) < 0.04


def test_nothing_hit_is_an_edge_and_no_measurement_is_none(device: wp.Device) -> None:
    effect = sensors.EdgeDropout(threshold=0.8)
    sky = DepthBench(effect, device).measure(step_image(far=np.inf))
    assert (sky[..., 249] == 0.0).all() and (sky[..., :249] == 1.0).all() and np.isinf(sky[..., 250:]).all()
    hole = DepthBench(effect, device).measure(step_image(far=0.0))
    assert (hole[..., :250] == 1.0).all()


def test_flying_pixels_lie_between(device: wp.Device) -> None:
    image = np.tile([1.0, 1.0, 3.0, 3.0], (4, 500, 125))  # all but the outer columns are edges
    measured = DepthBench(sensors.FlyingPixels(threshold=0.5, probability=0.4), device).measure(image)
    changed = (measured != image)[..., 1:-1]
    flying = measured[..., 1:-1][changed]
    assert abs(changed.mean() - 0.4) < 0.003
    assert flying.min() >= 1.0 and flying.max() <= 3.0
    assert abs(flying.mean() - 2.0) < 0.01 and abs(flying.std() - 2.0 / 12.0**0.5) < 0.005
    for far in (np.inf, 0.0):
        image = step_image(far=far)
        kept = DepthBench(sensors.FlyingPixels(threshold=0.5, probability=1.0), device).measure(image)
        assert (kept == image).all()


@pytest.mark.parametrize(("angle", "rate"), [(50.0, 0.0), (65.0, 0.25), (75.0, 0.75), (85.0, 1.0)])
def test_grazing_angles_are_dropped(device: wp.Device, angle: float, rate: float) -> None:
    effect = sensors.GrazingDropout(start=60.0, end=80.0)
    measured = DepthBench(effect, device, normal=tilted(angle)).measure(np.full((200_000, 1, 5), 2.0))
    assert abs((measured == 0.0).mean() - rate) < 0.003
    hard = sensors.GrazingDropout(start=60.0, end=60.0)
    measured = DepthBench(hard, device, normal=tilted(angle)).measure(np.full((100, 1, 5), 2.0))
    assert (measured == 0.0).all() == (angle > 60.0) and (measured == 2.0).all() == (angle < 60.0)


@pytest.mark.parametrize(
    ("color", "dark"), [((14, 14, 14), True), ((16, 16, 16), False), ((50, 0, 0), True), ((0, 50, 0), False)]
)
def test_dark_surfaces_are_dropped(device: wp.Device, color: tuple[int, int, int], dark: bool) -> None:
    measured = DepthBench(sensors.DarkDropout(), device, color=color).measure(np.full((2, 20, 20), 2.0))
    assert (measured == (0.0 if dark else 2.0)).all()


def test_depth_comes_in_units(device: wp.Device) -> None:
    units = np.float32([0.001, 0.0001, 0.01, 0.0])
    depth = np.broadcast_to(np.linspace(0.1, 9.0, 250_000, dtype=np.float32).reshape(500, 500), SHAPE)
    measured = DepthBench(sensors.DepthQuantization(units), device).measure(depth)
    for world, unit in enumerate(units[:3]):
        counts = np.floor(depth[world] / unit + np.float32(0.5))
        expected = np.where(counts <= 65535.0, counts * unit, 0.0)
        assert (np.abs(measured[world] - expected) > 1e-5).mean() < 1e-4
        error = (measured[world] - depth[world])[expected > 0.0]
        assert np.abs(error).max() <= 0.5 * unit + 1e-6
    assert (measured[1] == 0.0).mean() > 0.2 and (measured[3] == depth[3]).all()


def test_windows_must_match(device: wp.Device) -> None:
    effect = sensors.MatchingWindow(baseline=0.075)
    flat = DepthBench(effect, device).measure(np.full((1, 40, 40), 1.0))
    assert (flat == 1.0).all()
    image = np.full((1, 40, 40), 1.0)
    image[..., 20:] = 3.0
    measured = DepthBench(effect, device).measure(image)[0]
    assert (measured[:, 19:21] == 0.0).all() and (measured[:, :14] == 1.0).all() and (measured[:, 26:] == 3.0).all()
    holes = np.where(np.indices((1, 40, 40)).sum(axis=0) % 2 == 0, 1.0, np.inf)
    kept = DepthBench(effect, device).measure(holes)
    assert (kept[holes == 1.0] == 0.0).all() and np.isinf(kept[np.isinf(holes)]).all()
    half = sensors.MatchingWindow(baseline=0.075, share=0.4)
    assert (DepthBench(half, device).measure(holes) == holes).all()


def test_the_second_imager_sees_no_shadow_behind_a_post(device: wp.Device) -> None:
    """A post of 10 pixels, 20 pixels of disparity in front of a wall: both edges of what it hides are known."""
    wall, post = FOCAL * 0.1 / 5.0, FOCAL * 0.1 / 25.0
    image = np.full((2, 3, 100), wall)
    image[..., 60:70] = post
    holes = DepthBench(sensors.StereoShadow(np.array([0.1, -0.1])), device).measure(image) == 0.0
    right, left = np.zeros(100, bool), np.zeros(100, bool)
    right[40:50] = True  # the post lies 20 pixels further left in the second image than the wall does
    right[:5] = True  # outside of it
    left[80:90] = True
    left[95:] = True
    assert (holes[0] == right).all() and (holes[1] == left).all()
    open_border = DepthBench(sensors.StereoShadow(0.1, border=False), device).measure(image) == 0.0
    assert not open_border[..., :5].any() and (open_border[..., 5:] == right[5:]).all()
