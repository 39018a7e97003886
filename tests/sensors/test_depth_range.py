"""Limits of a depth camera's range."""

import numpy as np
import pytest
import warp as wp
from depth_frames import DepthBench
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors


def test_depth_out_of_range_is_no_measurement(device: wp.Device) -> None:
    renderer = wc.Renderer(scene_of(device, 2), [camera(outputs=("depth",))])
    limits = sensors.DepthRange(min=np.array([0.0, 4.5]), max=5.45, invalid=-1.0)
    measured = sensors.Rig(renderer, {"top": [limits]}).read()["top"]["depth"].cpu().numpy()
    truth = renderer.images["top"]["depth"].cpu().numpy()
    for world, least in enumerate((0.0, 4.5)):
        outside = ~np.isfinite(truth[world]) | (truth[world] < least) | (truth[world] > 5.45)
        assert outside.any() and not outside.all()
        assert (measured[world] == np.where(outside, -1.0, truth[world])).all()


@pytest.mark.parametrize("unit", [0.001, 0.002, 0.01])
def test_depth_at_either_limit_is_measured_when_it_is_rounded_to_units(device: wp.Device, unit: float) -> None:
    """Units of a millimetre add up to a little more or less than the limit; the next unit is beyond it."""
    limits = np.round(np.arange(0.2, 20.0, 0.1), 1)
    depths = np.stack((limits, limits - unit, limits + unit))[:, None]
    rounded = DepthBench(sensors.DepthQuantization(unit=unit), device).measure(depths)
    for name, beyond in (("max", 2), ("min", 1)):
        inside = [row for row in range(3) if row != beyond]
        for k, limit in enumerate(np.float32(limits)):
            effect = sensors.DepthRange(**{"min": 0.0, "max": 100.0, name: limit})
            measured = DepthBench(effect, device).measure(rounded[..., k : k + 1])[:, 0, 0]
            assert measured[beyond] == 0.0 and (measured <= limit).all() == (name == "max")
            np.testing.assert_allclose(measured[inside], depths[inside, 0, k], rtol=1e-6)
