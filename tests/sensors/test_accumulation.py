"""Exposures over several reads: the mean of their light."""

import numpy as np
import pytest
import warp as wp
from moving_scene import MovingScene, linear
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.core.color import linear_to_srgb

EXPOSURE = 0.03


def test_an_image_is_the_mean_of_the_light_of_its_reads(device: wp.Device) -> None:
    scene = MovingScene(ball=lambda t: (12.0 * t, 0.0, 0.0), outputs=("rgb",))
    rig = sensors.Rig(scene.renderer, {"eye": [sensors.Accumulation(samples=4)]})
    for _ in range(2):
        seen = []
        for k in range(4):
            scene.set(0.01 * k)
            rig.read()
            seen.append(linear(scene.renderer.images["eye"]["rgb"]))
            expected = 255.0 * linear_to_srgb(np.mean(seen, axis=0))
            assert np.abs(rig.images["eye"]["rgb"][0].cpu().numpy() - expected).max() < 0.51
    assert np.abs(linear(rig.images["eye"]["rgb"]) - seen[-1]).max() > 0.1


def test_a_reset_begins_another_image(device: wp.Device) -> None:
    scene = MovingScene(ball=lambda t: (12.0 * t, 0.0, 0.0), outputs=("rgb",), num_worlds=3)
    rig = sensors.Rig(scene.renderer, {"eye": [sensors.Accumulation(samples=4)]})
    for k, worlds in ((0, None), (1, [0, 2])):
        scene.set(0.02 * k)
        rig.read(worlds)
    rig.reset([2])
    scene.set(0.04)
    images, truth = rig.read([2])["eye"]["rgb"], scene.renderer.images["eye"]["rgb"]
    assert (images[2] == truth[2]).all() and (images[1] == truth[1]).all() and not (images[0] == truth[0]).all()


def test_motion_blur_is_like_an_accumulation(device: wp.Device) -> None:
    path = {"ball": lambda t: (12.0 * t, 0.0, 0.0)}
    many, blurred = MovingScene(**path, outputs=("rgb",)), MovingScene(**path)
    rig = sensors.Rig(many.renderer, {"eye": [sensors.Accumulation(samples=12)]})
    for k in reversed(range(12)):
        many.set(-EXPOSURE * (k + 0.5) / 12)
        rig.read()
    other = sensors.Rig(blurred.renderer, {"eye": [sensors.MotionBlur(exposure=EXPOSURE, samples=12)]})
    for time in (-0.05, 0.0):
        blurred.set(time)
        other.read()
    images = [linear(each.images["eye"]["rgb"]) for each in (rig, other)]
    assert np.abs(images[0] - images[1]).mean() < 0.002
    assert np.abs(images[0] - linear(blurred.renderer.images["eye"]["rgb"])).mean() > 0.008


@pytest.mark.parametrize("samples", [0, 1.5, True])
def test_bad_input_is_refused(samples: int) -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("rgb",))])
    with pytest.raises(wc.WarpcamError, match="Accumulation: samples must be a whole number of at least 1, got"):
        sensors.Rig(renderer, {"top": [sensors.Accumulation(samples=samples)]})
