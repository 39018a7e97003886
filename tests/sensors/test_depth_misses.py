"""Pixels that hit nothing, in cameras that show a number there: they are infinitely far for effects on depth."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
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
