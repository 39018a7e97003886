"""Errors about ``worlds`` and ``forward`` of what a user has called: a sensor names itself, and nothing is changed."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

WRONG = {
    "worlds has id 3; allowed are 0 to 2": [3],
    "worlds as a mask must have shape \\(3,\\), got \\(2,\\)": np.array([True, False]),
    "worlds must be ids \\(n,\\), or a mask \\(3,\\) of bool or uint8, got 'all'": "all",
    "worlds must be ids \\(n,\\) of int32 or int64, .* got float32 \\(3,\\)": torch.ones(3),
}


def calls_of(device: wp.Device) -> dict[str, Any]:
    scene = scene_of(device, 3)
    rig = sensors.Rig(wc.Renderer(scene, [camera(outputs=("depth", "flow"))]), {"top": [sensors.DepthBias(0.1)]})
    lidar = sensors.Lidar(scene, sensors.patterns.spinning([0.0], columns=8), sweep="moving")
    clouds = sensors.PointClouds(rig, num_points=4)
    named = {"Rig": rig, "Lidar": lidar, "PointClouds": clouds}
    rig.read()
    return {f"{name}.{call}": getattr(of, call) for name, of in named.items() for call in ("read", "reset")}


@pytest.mark.parametrize("text", WRONG)
def test_worlds_that_are_not_there(device: wp.Device, text: str) -> None:
    wrong = WRONG[text]
    if isinstance(wrong, torch.Tensor):
        wrong = wrong.to(wp.device_to_torch(device))
    for name, call in calls_of(device).items():
        with pytest.raises(wc.WarpcamError, match=f"^{name}: {text}"):
            call(worlds=wrong)


@pytest.mark.parametrize("name", ["Rig.read", "Lidar.read"])
def test_forward_that_is_no_truth(device: wp.Device, name: str) -> None:
    with pytest.raises(wc.WarpcamError, match=f"^{name}: forward must be True or False, got 1"):
        calls_of(device)[name](forward=1)


def test_a_reset_that_fails_forgets_nothing(device: wp.Device) -> None:
    renderer = wc.Renderer(scene_of(device, 3), [camera(outputs=("depth", "flow_valid"))])
    rig = sensors.Rig(renderer, {"top": [sensors.DepthBias(0.1)]})
    rig.read()
    with pytest.raises(wc.WarpcamError, match=r"Rig\.reset: worlds has id 5"):
        rig.reset([0, 5])
    assert rig.read()["top"]["flow_valid"].amax(dim=(1, 2, 3)).tolist() == [1, 1, 1]
