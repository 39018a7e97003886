"""Limits of a depth camera's range."""

import numpy as np
import warp as wp
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
