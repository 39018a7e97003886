"""Pixels that hit nothing, in cameras that show a number there: they are infinitely far for effects on depth."""

from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp
from moving_scene import SKY
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

FAR = 9.0
EFFECTS: dict[str, list[sensors.Effect]] = {
    "noise": [sensors.PolynomialNoise(constant=0.1)],
    "lookups": [sensors.LateralNoise(constant=1.0), sensors.AxialNoise(), sensors.ShiftedLookup(sigma=1.0)],
    "edges": [sensors.EdgeDropout(threshold=0.3), sensors.DepthBias(0.1)],
    "flying pixels": [sensors.FlyingPixels(threshold=0.1, probability=1.0), sensors.StereoShadow(baseline=0.3)],
    "range": [sensors.DepthBias(0.1), sensors.DepthRange(min=0.1, max=20.0, invalid=-1.0)],
}


def rig_of(device: Any, clipping: Any, effects: list[sensors.Effect]) -> sensors.Rig:
    eye = camera(outputs=("depth", "normals"), far=FAR, depth_clipping=clipping)
    return sensors.Rig(wc.Renderer(scene_of(device, 2), [eye]), {"top": effects}, seed=3)


def read(rig: sensors.Rig) -> np.ndarray:
    return rig.read()["top"]["depth"].cpu().numpy().copy()


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize(("clipping", "shown"), [("max", FAR), ("zero", 0.0)])
def test_they_are_measured_as_those_that_are_infinitely_far(
    name: str, clipping: Any, shown: float, device: wp.Device
) -> None:
    rig = rig_of(device, clipping, EFFECTS[name])
    expected = read(rig_of(device, "none", EFFECTS[name]))
    found, truth = read(rig), rig.renderer.images["top"]["depth"].cpu().numpy()
    assert (truth == shown).mean() > 0.02
    assert np.isinf(expected).any() == (name != "range")
    assert (found == np.where(np.isinf(expected), shown, expected)).all()


def test_clouds_have_none_of_them(device: wp.Device) -> None:
    counts = []
    for clipping in ("none", "max", "zero"):
        rig = rig_of(device, clipping, EFFECTS["noise"])
        rig.read()
        counts.append(sensors.PointClouds(rig, num_points=480, method="first").read()["count"].clone())
    assert torch.equal(counts[0], counts[1]) and torch.equal(counts[0], counts[2]) and int(counts[0].max()) < 480


def test_they_are_where_the_range_of_now_ends(device: wp.Device) -> None:
    rig = rig_of(device, "max", EFFECTS["noise"])
    rig.renderer.camera("top").far[:] = 7.0
    found, truth = read(rig), rig.renderer.images["top"]["depth"].cpu().numpy()
    assert ((found == 7.0) == (truth == 7.0)).all() and (truth == 7.0).any()


LOOKUPS: dict[str, sensors.Effect] = {
    "blur": sensors.MotionBlur(exposure=0.1),
    "shutter": sensors.RollingShutter(readout=0.1),
    "shutter of depth": sensors.RollingShutter(readout=0.1, changes="depth"),
}


def moved(device: wp.Device, clipping: Any, effect: sensors.Effect) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured colours and depth of a camera that moves and turns, and colours as they were drawn."""
    outputs = ("rgb", "depth", "flow", "flow_valid")
    placed = {"position": (0.0, 0.0, 5.0), "lens": wc.Pinhole(fovy=60.0), "far": FAR, "depth_clipping": clipping}
    renderer = wc.Renderer(scene_of(device, 2), [camera("eye", width=48, height=40, outputs=outputs, **placed)])
    rig, arrays = sensors.Rig(renderer, {"eye": [effect]}), renderer.camera("eye")
    for k in range(2):
        arrays.position[:, 0] = 0.4 * k
        arrays.rotation[:, 3] = 0.03 * k
        images = rig.read(time=0.1 * k)["eye"]
    images = {**images, "truth": renderer.images["eye"]["rgb"]}
    rgb, depth, truth = (images[name].cpu().numpy().copy() for name in ("rgb", "depth", "truth"))
    return rgb, depth, truth


@pytest.mark.parametrize("name", LOOKUPS)
@pytest.mark.parametrize(("clipping", "shown"), [("max", FAR), ("zero", 0.0)])
def test_effects_that_look_up_depth_take_them_to_be_infinitely_far(
    name: str, clipping: Any, shown: float, device: wp.Device
) -> None:
    expected, depth, drawn = moved(device, "none", LOOKUPS[name])
    found, found_depth, _ = moved(device, clipping, LOOKUPS[name])
    assert (found == expected).all()
    assert (found_depth == np.where(np.isinf(depth), shown, depth)).all()
    assert (expected != drawn).any() != (name == "shutter of depth")


def test_a_sky_is_blurred_as_what_is_infinitely_far(device: wp.Device) -> None:
    mjm = scenes.compile_xml('<light pos="0 0 3"/><geom size=".4" pos="0 0 -2"/>', assets=SKY)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    focus = sensors.DepthOfField(focus_distance=2.0, f_number=0.5, focal_length=0.1)
    found = []
    for clipping in ("none", "max", "zero"):
        placed = {"position": (0.0, 0.0, 0.0), "lens": wc.Pinhole(fovy=60.0), "far": 3.0, "depth_clipping": clipping}
        renderer = wc.Renderer(scene, [camera("eye", width=48, height=40, outputs=("rgb", "depth"), **placed)])
        found.append(sensors.Rig(renderer, {"eye": [focus]}).read()["eye"]["rgb"].clone())
        assert not torch.equal(found[-1], renderer.images["eye"]["rgb"])
    assert torch.equal(found[0], found[1]) and torch.equal(found[0], found[2])
