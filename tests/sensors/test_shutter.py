"""Rolling shutters and motion blur, against scenes drawn at each moment by themselves."""

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from moving_scene import MovingScene, linear
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors

STEP = 0.05  # between two frames [s]
LEFT_OUT = 0.75  # of the error without an effect, the least that it must take away
MOTIONS: dict[str, dict[str, Any]] = {
    "camera turns": {"turn": lambda t: 2.0 * t},
    "camera slides": {"camera": lambda t: (8.0 * t, 0.0, 0.0)},
    "camera rises": {"camera": lambda t: (0.0, 8.0 * t, 0.0)},
    "ball flies across": {"ball": lambda t: (12.0 * t, 0.0, 0.0)},
    "ball rises": {"ball": lambda t: (0.0, 12.0 * t, 0.0)},
    "ball falls": {"ball": lambda t: (0.0, -12.0 * t, 0.0)},
    "ball is fast": {"ball": lambda t: (30.0 * t, 0.0, 0.0)},
    "camera follows the ball": {"ball": lambda t: (8.0 * t, 0.0, 0.0), "camera": lambda t: (8.0 * t, 0.0, 0.0)},
    "all move": {
        "ball": lambda t: (12.0 * t, 3.0 * t, 0.0),
        "camera": lambda t: (0.0, -2.0 * t, -2.0 * t),
        "turn": lambda t: 1.2 * t,
    },
}


def measured(scene: MovingScene, *effects: sensors.Effect, output: str = "rgb") -> tuple[np.ndarray, np.ndarray]:
    """What is measured at the time 0, after a frame a step earlier, and the truth."""
    rig = sensors.Rig(scene.renderer, {"eye": effects})
    for time in (-STEP, 0.0):
        scene.set(time)
        rig.read()
    return linear(rig.images["eye"][output]), linear(scene.renderer.images["eye"][output])


def lines(scene: MovingScene, readout: float, direction: str, output: str = "rgb") -> np.ndarray:
    """An image of which each line is drawn at its own time."""
    across = direction in ("right", "left")
    image = scene.truth(0.0, output).copy()
    count = image.shape[1 if across else 0]
    for k in range(count):
        number = k if direction in ("down", "right") else count - 1 - k
        place = (slice(None), number) if across else number
        image[place] = scene.truth(-readout * (count - 1 - k) / (count - 1), output)[place]
    return image


def remaining(image: np.ndarray, truth: np.ndarray, before: np.ndarray) -> float:
    """Mean error, as a share of what it was without the effect."""
    return float(np.abs(image - truth).mean() / np.abs(before - truth).mean())


@pytest.mark.parametrize("motion", MOTIONS)
def test_each_line_shows_its_own_time(motion: str, device: wp.Device) -> None:
    scene = MovingScene(**MOTIONS[motion])
    image, before = measured(scene, sensors.RollingShutter(readout=STEP))
    assert remaining(image, lines(scene, STEP, "down"), before) < 1.0 - LEFT_OUT


@pytest.mark.parametrize("direction", ["down", "up", "right", "left"])
@pytest.mark.parametrize("readout", [0.02, 0.08])
def test_lines_are_read_in_a_direction(direction: Any, readout: float, device: wp.Device) -> None:
    scene = MovingScene(ball=lambda t: (15.0 * t, 9.0 * t, 0.0))
    image, before = measured(scene, sensors.RollingShutter(readout=readout, direction=direction))
    assert remaining(image, lines(scene, readout, direction), before) < 1.0 - LEFT_OUT
    assert (np.abs(image - before).max(axis=2) > 0.1).mean() > 0.01


@pytest.mark.parametrize("motion", ["camera turns", "all move"])
def test_the_sky_moves_as_the_camera_turns(motion: str, device: wp.Device) -> None:
    """Its lines are read, and its motion blurs, as those of surfaces do."""
    scene = MovingScene(**MOTIONS[motion], sky=True)
    image, before = measured(scene, sensors.RollingShutter(readout=STEP))
    assert remaining(image, lines(scene, STEP, "down"), before) < 1.0 - LEFT_OUT
    scene = MovingScene(**MOTIONS[motion], sky=True)
    image, before = measured(scene, sensors.MotionBlur(exposure=0.03, samples=12))
    truth = np.mean([scene.truth(-0.03 * (k + 0.5) / 24) for k in range(24)], axis=0)
    assert remaining(image, truth, before) < 1.0 - LEFT_OUT


def test_the_sky_of_a_camera_that_does_not_turn_stays(device: wp.Device) -> None:
    scene = MovingScene(camera=lambda t: (8.0 * t, 0.0, 0.0), ball=lambda t: (99.0, 0.0, 0.0), sky=True)
    image, before = measured(scene, sensors.RollingShutter(readout=STEP), sensors.MotionBlur(exposure=0.02))
    assert (image == before).all()


def test_depth_is_read_line_by_line(device: wp.Device) -> None:
    nearer = {"camera": lambda t: (0.0, 0.0, -4.0 * t)}
    for motion, share in ((nearer, 0.97), (MOTIONS["ball falls"], 0.97), (MOTIONS["all move"], 0.9)):
        scene = MovingScene(**motion)
        shutter = sensors.RollingShutter(readout=STEP, changes="depth")
        image, before = measured(scene, shutter, output="depth")
        truth = lines(scene, STEP, "down", "depth")
        assert remaining(image, truth, before) < 1.0 - LEFT_OUT
        assert (np.abs(image - truth) < 0.03).mean() > share


@pytest.mark.parametrize("motion", MOTIONS)
def test_blur_is_the_mean_over_the_exposure(motion: str, device: wp.Device) -> None:
    exposure, moments = 0.03, 24
    scene = MovingScene(**MOTIONS[motion])
    image, before = measured(scene, sensors.MotionBlur(exposure=exposure, samples=12))
    truth = np.mean([scene.truth(-exposure * (k + 0.5) / moments) for k in range(moments)], axis=0)
    assert remaining(image, truth, before) < 1.0 - LEFT_OUT


def test_a_moving_ball_gives_its_light_to_where_it_was(device: wp.Device) -> None:
    scene = MovingScene(ball=lambda t: (12.0 * t, 0.0, 0.0), squares=False)
    image, before = measured(scene, sensors.MotionBlur(exposure=STEP, samples=32))
    truth = np.mean([scene.truth(-STEP * (k + 0.5) / 32) for k in range(32)], axis=0)
    wall = MovingScene(ball=lambda t: (99.0, 0.0, 0.0), squares=False).truth(0.0)
    across = [(part - wall)[..., 0].sum(axis=0) for part in (image, truth, before)]
    assert abs(across[0].sum() / across[1].sum() - 1.0) < 0.05
    middle = [float((part * np.arange(64)).sum() / part.sum()) for part in across]
    assert abs(middle[0] - middle[1]) < 0.3 and middle[2] - middle[0] > 5.0


def test_an_image_at_rest_stays(device: wp.Device) -> None:
    effects = (sensors.RollingShutter(readout=0.03), sensors.MotionBlur(exposure=0.02))
    scene = MovingScene()
    image, before = measured(scene, *effects)
    assert (image == before).all()


def test_there_is_no_motion_without_a_frame_before(device: wp.Device) -> None:
    scene = MovingScene(**MOTIONS["all move"], num_worlds=2)
    rig = sensors.Rig(scene.renderer, {"eye": [sensors.RollingShutter(readout=STEP)]})
    same = []
    for time, reset in ((0.0, None), (STEP, None), (2 * STEP, [1]), (2 * STEP, None)):
        if reset:
            rig.reset(reset)
        scene.set(time)
        image, truth = rig.read()["eye"]["rgb"], scene.renderer.images["eye"]["rgb"]
        same.append([bool((image[world] == truth[world]).all()) for world in range(2)])
    assert same == [[True, True], [False, False], [False, True], [True, True]]


def turning_rig() -> tuple[MovingScene, sensors.Rig]:
    """A camera that turns below a skybox, of which flow says nothing."""
    scene = MovingScene(turn=lambda t: 4.0 * t, sky=True, num_worlds=2)
    return scene, sensors.Rig(scene.renderer, {"eye": [sensors.RollingShutter(readout=STEP)]})


def unchanged(scene: MovingScene, rig: sensors.Rig, time: float, worlds: Any = None) -> list[bool]:
    """Which worlds' images of a moment are as they were drawn."""
    scene.set(time)
    image, truth = rig.read(worlds)["eye"]["rgb"], scene.renderer.images["eye"]["rgb"]
    return [bool((image[world] == truth[world]).all()) for world in range(2)]


def test_a_background_has_no_motion_after_a_reset(device: wp.Device) -> None:
    scene, rig = turning_rig()
    assert unchanged(scene, rig, 0.0) == [True, True]
    assert unchanged(scene, rig, STEP) == [False, False]
    rig.reset([1])
    assert unchanged(scene, rig, 2 * STEP) == [False, True]
    assert unchanged(scene, rig, 3 * STEP) == [False, False]


def test_a_frame_that_others_have_drawn_is_no_frame_before(device: wp.Device) -> None:
    scene, rig = turning_rig()
    unchanged(scene, rig, 0.0)
    scene.set(STEP)
    scene.renderer.render(worlds=[0])
    assert unchanged(scene, rig, 2 * STEP) == [True, False]
    other = sensors.Rig(scene.renderer, {"eye": [sensors.MotionBlur(exposure=STEP)]})
    assert unchanged(scene, other, 3 * STEP, [0]) == [True, False]
    assert unchanged(scene, rig, 4 * STEP) == [True, False]
    assert unchanged(scene, rig, 5 * STEP) == [False, False]


def test_worlds_have_shutters_of_their_own(device: wp.Device) -> None:
    readout = torch.tensor([0.0, STEP, 0.5 * STEP], device=wp.device_to_torch(device))
    scene = MovingScene(**MOTIONS["camera slides"], num_worlds=3)
    rig = sensors.Rig(scene.renderer, {"eye": [sensors.RollingShutter(readout=readout)]})
    alone = [measured(MovingScene(**MOTIONS["camera slides"]), sensors.RollingShutter(readout=STEP))[0]]
    for time in (-STEP, 0.0):
        scene.set(time)
        rig.read()
    images = rig.images["eye"]["rgb"]
    assert (images[0] == scene.renderer.images["eye"]["rgb"][0]).all()
    assert (linear(images[1:]) == alone[0]).all() and not (images[1] == images[2]).all()
    readout[0] = STEP
    for time in (-STEP, 0.0):
        scene.set(time)
        rig.read()
    assert (rig.images["eye"]["rgb"][0] == rig.images["eye"]["rgb"][1]).all()


def test_shutters_may_be_captured(device: wp.Device) -> None:
    effects = [sensors.RollingShutter(readout=STEP), sensors.MotionBlur(exposure=0.02)]
    scene = MovingScene(**MOTIONS["camera slides"])
    expected, _ = measured(scene, *effects)
    rig = sensors.Rig(scene.renderer, {"eye": effects})
    rig.read()
    with wp.ScopedCapture(device) as capture:
        rig.read()
    for time in (-STEP, 0.0):
        scene.set(time)
        wp.capture_launch(capture.graph)
    assert (linear(rig.images["eye"]["rgb"]) == expected).all()


@pytest.mark.parametrize(
    ("effect", "outputs", "message"),
    [
        (sensors.RollingShutter(readout=-1.0), ("rgb", "depth", "flow"), "readout must be from 0 to inf, got -1"),
        (
            sensors.RollingShutter(readout=0.1, direction="across"),  # type: ignore[arg-type]
            ("rgb", "depth", "flow"),
            "direction must be one of 'down', 'up', 'right', 'left', got 'across'",
        ),
        (
            sensors.RollingShutter(readout=0.1, changes="rgb"),  # type: ignore[arg-type]
            ("rgb", "depth", "flow"),
            "changes must be one of 'colors', 'depth', got 'rgb'",
        ),
        (sensors.RollingShutter(readout=0.1), ("rgb", "depth"), "RollingShutter needs 'flow' among"),
        (
            sensors.RollingShutter(readout=0.1, changes="depth"),
            ("depth", "flow"),
            "RollingShutter needs 'flow_valid' among",
        ),
        (sensors.MotionBlur(exposure=0.1), ("rgb",), "MotionBlur needs 'depth' and 'flow' among"),
        (sensors.MotionBlur(exposure=0.1, samples=0), ("rgb",), "samples must be a whole number of at least 1, got 0"),
    ],
)
def test_bad_input_is_refused(effect: Any, outputs: tuple[str, ...], message: str) -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=outputs)])
    with pytest.raises(wc.WarpcamError, match=message):
        sensors.Rig(renderer, {"top": [effect]})
