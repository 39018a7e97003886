"""Holes of a stereo camera against a second camera that is rendered where its second imager is."""

import numpy as np
import pytest
import warp as wp
from small_scene import scene_of

import warpcam as wc
from warpcam import sensors

WIDTH, HEIGHT, FOVY = 240, 160, 50.0
POSTS = "".join(f'<geom type="capsule" size=".03 .6" pos="{x} -1.2 {1.4 + 0.3 * x}"/>' for x in (-1.2, 0.4, 1.3))
POSTS += '<geom type="box" size=".5 .3 .02" pos="-.6 -.4 2" euler="0 50 0"/>'


def views(device: wp.Device, baseline: float) -> tuple[sensors.Rig, np.ndarray, np.ndarray]:
    """A rig with holes, its camera's depth, and that of a camera at the second imager."""
    options = {"width": WIDTH, "height": HEIGHT, "outputs": ("depth",), "lens": wc.Pinhole(fovy=FOVY)}
    first = wc.Camera("first", position=(0.0, 0.0, 5.0), **options)
    second = wc.Camera("second", position=(baseline, 0.0, 5.0), **options)
    renderer = wc.Renderer(scene_of(device, 2, POSTS), [first, second])
    rig = sensors.Rig(renderer, {"first": [sensors.StereoShadow(baseline)]})
    rig.read()
    return rig, *(renderer.images[name]["depth"].cpu().numpy()[..., 0] for name in ("first", "second"))


def hidden(first: np.ndarray, second: np.ndarray, baseline: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that the second camera does not see, and those for which it is not a matter of a pixel's width."""
    focal = 0.5 * HEIGHT / np.tan(np.radians(0.5 * FOVY))
    place = np.arange(WIDTH) - focal * baseline / first
    outside = (place < -0.5) | (place > WIDTH - 0.5)
    worlds, rows = np.indices(first.shape)[:2]
    answers = []
    for beside in (-1, 0, 1):
        column = np.clip(np.floor(place + 0.5).astype(int) + beside, 0, WIDTH - 1)
        answers.append(outside | (second[worlds, rows, column] < first * 0.98))
    sure = (answers[0] == answers[1]) & (answers[1] == answers[2]) & (np.abs(place) > 1.0)
    return answers[1], sure & (np.abs(place - WIDTH + 1.0) > 1.0)


@pytest.mark.parametrize("baseline", [0.3, -0.3, 0.05])
def test_holes_are_what_a_second_camera_does_not_see(device: wp.Device, baseline: float) -> None:
    rig, first, second = views(device, baseline)
    holes = rig.images["first"]["depth"].cpu().numpy()[..., 0] == 0.0
    seen = np.isfinite(first)
    expected, sure = hidden(np.where(seen, first, 1e6), second, baseline)
    assert not holes[~seen].any()
    assert expected[seen].mean() > 0.06 * abs(baseline)
    assert (holes == expected)[seen & sure].mean() > 0.9997
    assert (holes == expected)[seen].mean() > 0.993
