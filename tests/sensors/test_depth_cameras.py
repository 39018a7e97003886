"""Models of depth cameras that one can buy: images, ranges, and the noise of each at its own depth."""

import dataclasses
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from depth_frames import FOCAL, DepthBench
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.sensors import depth_cameras

Preset = Callable[[], sensors.CameraModel]

# Size, fields of view [degrees], frame rate [Hz] and range [m]; standard deviation of depth [m] at a depth [m].
PRESETS: dict[str, tuple[Preset, tuple[int, int], tuple[float, float], float, tuple[float, float], float, float]] = {
    "realsense_d405": (sensors.realsense_d405, (848, 480), (87.0, 56.5), 90, (0.07, 0.5), 0.0009, 0.3),
    "realsense_d415": (sensors.realsense_d415, (1280, 720), (69.6, 42.7), 30, (0.5, 3.0), 0.00633, 2.0),
    "realsense_d435": (sensors.realsense_d435, (848, 480), (89.2, 58.3), 90, (0.3, 3.0), 0.01488, 2.0),
    "realsense_d455": (sensors.realsense_d455, (848, 480), (87.0, 56.5), 90, (0.6, 6.0), 0.03016, 4.0),
    "azure_kinect": (sensors.azure_kinect, (640, 576), (75.0, 65.0), 30, (0.5, 3.86), 0.003, 3.0),
    "zed_2": (sensors.zed_2, (1280, 720), (100.5, 68.2), 60, (0.3, 20.0), 0.0296, 3.0),
    "oak_d": (sensors.oak_d, (1280, 800), (71.9, 48.8), 120, (0.7, 12.0), 0.0340, 3.0),
    "kinect_v1": (sensors.kinect_v1, (640, 480), (57.4, 44.6), 30, (0.8, 4.0), 0.0069, 2.0),
    "vl53l5cx": (sensors.vl53l5cx, (8, 8), (45.0, 45.0), 15, (0.2, 4.0), 0.00531, 2.0),
}
DOCS = Path(__file__).parents[2] / "docs" / "sensors_depth.md"
every = pytest.mark.parametrize("name", PRESETS)


def without_holes(model: sensors.CameraModel) -> list[sensors.Effect]:
    return [effect for effect in model if not isinstance(effect, sensors.StereoShadow | sensors.LateralNoise)]


@every
def test_presets_are_what_their_sources_say(name: str) -> None:
    make, size, fields, rate, limits, _, _ = PRESETS[name]
    model = make()
    assert (model.width, model.height) == size and model.frame_rate == rate and (model.near, model.far) == limits
    assert (round(model.fovx, 1), round(model.fovy, 1)) == fields
    assert isinstance(model[-1], sensors.DepthRange) and (model[-1].min, model[-1].max) == limits
    assert make.__doc__ and getattr(sensors, name) is make
    assert (make().effects is not model.effects) and len(model) == len(list(model)) == len(model[:])


def test_the_docs_have_the_numbers_of_every_preset() -> None:
    rows = re.findall(
        r"^\| `(\w+)\((.*)\)` \| (.+) \| (.+) \| (.+) \| (.+) \| (.+) \| .+ \|$", DOCS.read_text(), re.MULTILINE
    )
    for name, mode, size, fields, rate, limits, baseline in rows:
        model = getattr(sensors, name)(*([mode.strip('"')] if mode else []))
        shadows = [effect for effect in model if isinstance(effect, sensors.StereoShadow)]
        assert size == f"{model.width}x{model.height}" and float(rate) == model.frame_rate, name
        assert [float(each) for each in fields.split(" x ")] == [round(model.fovx, 1), round(model.fovy, 1)], name
        assert [float(each) for each in limits.split(" to ")] == [model.near, model.far], name
        assert baseline == (f"{shadows[0].baseline:.3f}" if shadows else "-"), name
    assert {row[0] for row in rows} == set(PRESETS)


def test_every_preset_is_here() -> None:
    made = {
        name for name in sensors.__all__ if getattr(getattr(sensors, name), "__module__", "") == depth_cameras.__name__
    }
    assert made == set(PRESETS)


@every
def test_a_preset_has_the_noise_of_its_formula(device: wp.Device, name: str) -> None:
    make, _, _, _, _, sigma, at = PRESETS[name]
    depth = np.full((4, 250, 250), at)
    for effect in without_holes(make()):
        depth = DepthBench(effect, device).measure(depth)
    assert (depth > 0.0).all()
    assert abs((depth.astype(np.float64) - at).std() / sigma - 1.0) < 0.05  # steps make it a little more or less


@every
def test_a_model_makes_its_camera(device: wp.Device, name: str) -> None:
    model = PRESETS[name][0]()
    own = model.camera("eye", position=(0.0, 0.0, 3.2), width=40, height=30, shadows=False)
    assert {"depth", *model.outputs} == set(own.outputs) and own.outputs[0] == "depth"
    renderer = wc.Renderer(scene_of(device, 2), [own])
    rig = sensors.Rig(renderer, {"eye": model})
    measured = rig.read()["eye"]["depth"].cpu().numpy()
    truth = renderer.images["eye"]["depth"].cpu().numpy()
    outside = (measured != 0.0) & ((measured < model.near) | (measured > model.far))
    assert measured.shape == (2, 30, 40, 1) and not outside.any() and np.isfinite(measured).all()
    if model.far > 3.0:
        assert 0.1 < (measured > 0.0).mean() and (measured != truth)[measured > 0.0].mean() > 0.5
    view = renderer.views("eye").numpy()[0]
    assert np.allclose(view["scale"], (model.width / 40 / model.fx, model.height / 30 / model.fy))


def test_a_camera_of_the_scene_gets_the_models_lens() -> None:
    model = sensors.realsense_d435()
    top = model.camera("top", outputs=("depth", "rgb"))
    assert not top.is_own and (top.width, top.height) == (848, 480) and top.outputs == ("depth", "rgb")
    assert (top.lens.fx, top.lens.fy) == (430.14, 430.14)
    assert sensors.azure_kinect().camera("top", outputs=()).outputs == ("depth", "rgb")
    assert sensors.kinect_v1().outputs == ("depth", "normals")


def test_noise_stays_that_of_the_sensor_in_small_images(device: wp.Device) -> None:
    model = sensors.realsense_d435()
    noise = [effect for effect in model if isinstance(effect, sensors.DisparityNoise)]
    assert model.fx != FOCAL
    measured = DepthBench(noise[0], device).measure(np.full((4, 100, 100), 2.0)) - 2.0
    assert abs(measured.std() / (4.0 * 0.08 / (430.14 * 0.05)) - 1.0) < 0.02


def test_models_are_lists_of_effects() -> None:
    model = sensors.oak_d()
    changed = model.with_effects(*model, sensors.DepthBias(0.01))
    assert len(changed) == len(model) + 1 and changed.width == model.width and changed.name == "OAK-D"
    assert changed[:-1] == model.effects and isinstance(changed[-1], sensors.DepthBias)
    assert isinstance(sensors.zed_2(0.5)[1].sigma, float)


@pytest.mark.parametrize(
    ("mode", "size", "near", "far"),
    [
        ("nfov_2x2binned", (320, 288), 0.5, 5.46),
        ("wfov_2x2binned", (512, 512), 0.25, 2.88),
        ("wfov_unbinned", (1024, 1024), 0.25, 2.21),
    ],
)
def test_modes_of_the_azure_kinect(mode: Any, size: tuple[int, int], near: float, far: float) -> None:
    model = sensors.azure_kinect(mode)
    assert (model.width, model.height, model.near, model.far) == (*size, near, far)
    assert math.isclose(model.fovx, 120.0 if mode.startswith("w") else 75.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": ""}, "CameraModel: name must be the name of a product, got ''"),
        (
            {"effects": ("noise",)},
            r"CameraModel\('RealSense D435'\): effects of warpcam.sensors are allowed, got 'noise'",
        ),
        ({"effects": sensors.DepthBias()}, None),
        ({"width": 0}, "width must be a whole number of pixels, at least 1, got 0"),
        ({"height": 480.0}, "height must be a whole number of pixels, at least 1, got 480.0"),
        ({"fx": -1.0}, "fx must be a positive number, got -1.0"),
        ({"fy": "430"}, "fy must be a positive number, got '430'"),
        ({"frame_rate": float("nan")}, "frame_rate must be a positive number, got nan"),
        ({"near": 4.0}, "near must be below far, got near 4.0 and far 3.0"),
        ({"far": float("inf")}, "far must be a positive number, got inf"),
    ],
)
def test_models_that_cannot_be_are_refused(changes: dict[str, Any], message: str | None) -> None:
    model = sensors.realsense_d435()
    if message is None:
        assert len(dataclasses.replace(model, **changes)) == 1
        return
    with pytest.raises(wc.WarpcamError, match=message):
        dataclasses.replace(model, **changes)


def test_a_model_takes_numbers_of_numpy() -> None:
    model = sensors.realsense_d435()
    given: dict[str, Any] = {
        "width": np.int64(848),
        "height": np.int32(480),
        "fx": np.float32(430.0),
        "near": np.float64(0.3),
    }
    top = dataclasses.replace(model, **given).camera("top")
    assert (top.width, top.height) == (848, 480)
    effects = (sensors.StereoShadow(0.05, border=np.bool_(True)), sensors.MatchingWindow(0.05, radius=np.int64(2)))  # type: ignore[arg-type]
    images = []
    for chain in (effects, (sensors.StereoShadow(0.05), sensors.MatchingWindow(0.05, radius=2))):
        renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("depth",))])
        images.append(sensors.Rig(renderer, {"top": chain}).read()["top"]["depth"])
    assert (images[0] == images[1]).all()


def test_a_delivery_needs_no_output() -> None:
    model = sensors.realsense_d435()
    assert model.with_effects(*model.effects, sensors.Delivery(rate=30.0)).outputs == ("depth",)


def test_mistakes_are_named() -> None:
    with pytest.raises(wc.WarpcamError, match="azure_kinect: mode is 'wide'; allowed are 'nfov_2x2binned'"):
        sensors.azure_kinect("wide")  # type: ignore[arg-type]
    with pytest.raises(wc.WarpcamError, match="azure_kinect: mode is array"):
        sensors.azure_kinect(np.array(["nfov_unbinned", "wfov_unbinned"]))  # type: ignore[arg-type]
    model = sensors.realsense_d435()
    with pytest.raises(wc.WarpcamError, match="RealSense D435: camera 'top': lens is the model's own"):
        model.camera("top", lens=wc.Pinhole(fovy=50.0))
    with pytest.raises(wc.WarpcamError, match="outputs must be a list of names, got 'depth'"):
        model.camera("top", outputs="depth")
    for options in ({"width": 0}, {"height": 2.5}, {"outputs": ("deep",)}):
        with pytest.raises(wc.WarpcamError, match="Camera\\('top'\\)"):
            model.camera("top", **options)  # type: ignore[arg-type]
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("depth",))])
    with pytest.raises(wc.WarpcamError, match="DarkDropout needs 'rgb' among"):
        sensors.Rig(renderer, {"top": sensors.azure_kinect()})
