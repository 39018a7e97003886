"""Parameters of effects, lidars and stereo cameras: tensors that are used where they lie."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from depth_pictures import DEPTH_EFFECTS, scene_renderer
from lidar_scenes import downward, floor, host
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

WORLDS = 3


def columns(device: wp.Device, num_worlds: int, value: float) -> torch.Tensor:
    """A column of a table, whose numbers do not lie side by side."""
    return torch.full((num_worlds, 4), value, device=wp.device_to_torch(device))[:, 1]


def use_in_rig(scene: wc.Scene, numbers: Any) -> Any:
    return sensors.Rig(wc.Renderer(scene, [camera(outputs=("depth",))]), {"top": [sensors.DepthBias(numbers)]})


def use_in_lidar(scene: wc.Scene, numbers: Any) -> Any:
    pattern = sensors.patterns.spinning([0.0], columns=4)
    return sensors.Lidar(scene, pattern, noise=sensors.LidarNoise(offset=numbers))


def use_in_stereo(scene: wc.Scene, numbers: Any) -> Any:
    eye = camera("eye", lens=wc.Pinhole(fovy=60.0), position=(0.0, 0.0, 5.0))
    matching = sensors.StereoMatching(max_disparity=16)
    return sensors.StereoCamera(scene, eye, baseline=0.05, ambient=numbers, matching=matching)


@pytest.mark.parametrize("use", [use_in_rig, use_in_lidar, use_in_stereo])
def test_a_tensor_that_would_have_to_be_copied_is_refused(use: Any, device: wp.Device) -> None:
    scene = scene_of(device, WORLDS)
    with pytest.raises(wc.WarpcamError, match=r"must be contiguous, got strides of \(16,\) bytes; give a copy of it"):
        use(scene, columns(device, WORLDS, 0.5))
    with pytest.raises(wc.WarpcamError, match=r"must be contiguous, got strides of \(0,\) bytes"):
        use(scene, torch.full((1,), 0.5, device=wp.device_to_torch(device)).expand(WORLDS))


def test_rows_that_would_have_to_be_copied_are_refused(device: wp.Device) -> None:
    gains = torch.ones(3, WORLDS, device=wp.device_to_torch(device)).T
    renderer = wc.Renderer(scene_of(device, WORLDS), [camera()])
    with pytest.raises(wc.WarpcamError, match=r"gains must be contiguous, got strides of \(4, 12\) bytes"):
        sensors.Rig(renderer, {"top": [sensors.WhiteBalance(gains)]})


def test_a_column_of_one_world_is_used_where_it_lies(device: wp.Device) -> None:
    numbers = columns(device, 1, 0.5)
    rig = use_in_rig(scene_of(device, 1), numbers)
    numbers[:] = 0.25
    depth, truth = (each["top"]["depth"].cpu().numpy() for each in (rig.read(), rig.renderer.images))
    np.testing.assert_allclose(depth, truth + 0.25, rtol=1e-6)
    assert rig.parameters("top").depth_bias_offset.data_ptr() == numbers.data_ptr()


@pytest.mark.parametrize(
    ("effect", "text"),
    [
        (sensors.DepthRange(min=2.0, max=1.0), "DepthRange: min must be at most max, got 2 and 1"),
        (
            sensors.DepthRange(min=[0.1, 3.0, 0.1], max=torch.tensor([2.0, 2.0, 2.0])),
            "DepthRange: min must be at most max, got 3 and 2",
        ),
        (
            sensors.DepthRange(min=[0.1, 3.0], max=[1.0, 1.0, 1.0]),
            r"DepthRange: min must have shape a number or \(3,\)",
        ),
        (sensors.DeadPixels(dead=0.7, hot=0.7), "DeadPixels: dead and hot must be at most 1 together, got 1.4"),
        (
            sensors.DeadPixels(dead=[0.0, 0.5, 0.9], hot=0.2),
            "DeadPixels: dead and hot must be at most 1 together, got 1.1",
        ),
    ],
)
def test_parameters_that_do_not_go_together(effect: sensors.Effect, text: str) -> None:
    renderer = wc.Renderer(scene_of("cpu", WORLDS), [camera(outputs=("depth", "rgb"))])
    with pytest.raises(wc.WarpcamError, match=text):
        sensors.Rig(renderer, {"top": [effect]})


def test_limits_that_go_together(device: wp.Device) -> None:
    renderer = wc.Renderer(scene_of(device, WORLDS), [camera(outputs=("depth", "rgb"))])
    sensors.Rig(renderer, {"top": [sensors.DepthRange(min=1.0, max=1.0), sensors.DeadPixels(dead=0.3, hot=0.7)]})


# Parameters of effects that change some pixels alone, and of these all.
OF_SOME = ("dark_dropout_probability", "edge_dropout_probability", "grazing_dropout_end")
OF_EDGES = ("flying_pixels_threshold", "flying_pixels_probability")


@pytest.mark.parametrize("effect", DEPTH_EFFECTS)
def test_nan_measures_no_depth(device: wp.Device, effect: str) -> None:
    rig = sensors.Rig(scene_renderer(device.alias), {"eye": [DEPTH_EFFECTS[effect]]})
    parameters = rig.parameters("eye")
    for name in parameters:
        if name == "depth_range_invalid":  # itself the depth of what is not measured
            continue
        tensor = getattr(parameters, name)
        before = tensor.clone()
        tensor.fill_(torch.nan)
        rig.reset()
        depth, truth = (each["eye"]["depth"].cpu().numpy() for each in (rig.read(), rig.renderer.images))
        tensor.copy_(before)
        none = depth[np.isfinite(truth)] == 0.0
        assert none.all() or name in OF_SOME + OF_EDGES, name
        assert none.any() and ((depth == 0.0) | (depth == truth)).all(), name


LIDAR_NUMBERS = {
    "noise": sensors.LidarNoise(constant=0.01, linear=0.01, quadratic=0.01, offset=0.01, resolution=0.01),
    "dropout": sensors.LidarDropout(rate=0.1, intensity_limit=1.0, zero_intensity=0.1, attenuation=0.01),
}


@pytest.mark.parametrize("given", [LIDAR_NUMBERS, {}], ids=["with noise", "without"])
def test_nan_measures_no_range(device: wp.Device, given: dict[str, Any]) -> None:
    lidar = sensors.Lidar(floor(2, device), downward(6), position=(0.0, 0.0, 2.0), **given)
    for name in lidar.parameters:
        if name in ("position", "rotation"):
            continue
        if not given and name == "dropout_zero_intensity":  # nothing is asked of it without a limit
            continue
        tensor = getattr(lidar.parameters, name)
        before = tensor.clone()
        tensor[1] = torch.nan
        scan = host(lidar.read())
        tensor.copy_(before)
        assert np.isfinite(scan["ranges"][0]).any(), name
        assert np.isinf(scan["ranges"][1]).all() and (scan["ids"][1] == -1).all(), name
        assert (scan["intensities"][1] == 0.0).all(), name
