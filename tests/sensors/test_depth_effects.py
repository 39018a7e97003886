"""Habits of all effects on depth: pixels without a measurement, random numbers, parameters, lenses."""

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from depth_frames import DepthBench
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.sensors.effect import parameters_of

EFFECTS: dict[str, sensors.Effect] = {
    "axial": sensors.AxialNoise(),
    "azure": sensors.AzureKinectNoise(),
    "bias": sensors.DepthBias(offset=0.1),
    "dark": sensors.DarkDropout(threshold=0.3),
    "disparity": sensors.DisparityNoise(baseline=0.05, sigma=0.1),
    "drift": sensors.DepthDrift(sigma=0.1),
    "edges": sensors.EdgeDropout(threshold=0.3),
    "fixed": sensors.DepthFixedPattern(constant=0.1),
    "flying": sensors.FlyingPixels(threshold=0.3, probability=0.5),
    "grazing": sensors.GrazingDropout(start=10.0, end=60.0),
    "lateral": sensors.LateralNoise(),
    "polynomial": sensors.PolynomialNoise(linear=0.01),
    "random": sensors.RandomDropout(probability=0.3),
    "range": sensors.DepthRange(min=0.1, max=9.0),
    "shadow": sensors.StereoShadow(baseline=0.5),
    "shifted": sensors.ShiftedLookup(),
    "steps": sensors.DisparityQuantization(baseline=0.05),
    "units": sensors.DepthQuantization(unit=0.01),
    "window": sensors.MatchingWindow(baseline=0.05),
}
# The value that a parameter is changed to, if not twice the one before and 1.
OTHERS = {
    "baseline": 0.01,
    "start": 50.0,
    "end": 15.0,
    "threshold": 5.0,
    "relaxation": 0.9,
    "max": 2.0,
    "invalid": -1.0,
}
OTHERS |= {"focal_length": 60.0, "share": 0.01, "tolerance": 5.0, "probability": 0.0, "dark threshold": 0.1}
OTHERS |= {"window baseline": 0.0005}
LOOKUPS = ("lateral", "shifted")  # which may bring a measurement to a pixel without one
OUTPUTS = ("depth", "normals", "rgb")

every = pytest.mark.parametrize("name", EFFECTS)


def rig_of(device: Any, name: str, num_worlds: int = 3, **options: Any) -> sensors.Rig:
    options = {"width": 32, "outputs": OUTPUTS, **options}
    renderer = wc.Renderer(scene_of(device, num_worlds), [camera(**options)])
    return sensors.Rig(renderer, {"top": [EFFECTS[name]]}, seed=5)


def depth_of(rig: sensors.Rig, **options: Any) -> np.ndarray:
    return rig.read(**options)["top"]["depth"].cpu().numpy().copy()


def test_every_effect_on_depth_is_here() -> None:
    public = [getattr(sensors, name) for name in sensors.__all__]
    kinds = {each for each in public if isinstance(each, type) and getattr(each, "kind", None) == "depth"}
    assert kinds == {type(effect) for effect in EFFECTS.values()}


@every
def test_pixels_without_a_measurement_stay_so(device: wp.Device, name: str) -> None:
    image = np.full((2, 12, 16), 2.0, np.float32)
    image[:, 3:6, 4:9], image[:, 7:9, 2:12], image[:, 10, 5] = 0.0, np.inf, np.nan
    missing = ~(np.isfinite(image) & (image > 0.0))
    measured = DepthBench(EFFECTS[name], device).measure(image)
    if name == "range":
        assert (measured[missing] == 0.0).all()
    elif name in LOOKUPS:
        assert np.isin(measured[~np.isnan(measured)], (0.0, 2.0, np.inf)).all()
    else:
        assert np.array_equal(measured[missing], image[missing], equal_nan=True)
    assert name in LOOKUPS or (measured[~missing] >= 0.0).all()
    for nothing in (0.0, np.inf):
        empty = np.full((2, 12, 16), nothing, np.float32)
        assert (DepthBench(EFFECTS[name], device).measure(empty) == (0.0 if name == "range" else empty)).all()


@every
def test_a_world_measures_alike_among_any_number_of_worlds(device: wp.Device, name: str) -> None:
    image = np.random.default_rng(0).uniform(1.0, 3.0, (5, 12, 16)).astype(np.float32)
    few, many = DepthBench(EFFECTS[name], device), DepthBench(EFFECTS[name], device)
    for _ in range(2):
        assert (few.measure(image[:2]) == many.measure(image)[:2]).all()


@every
def test_what_is_measured_differs_from_the_truth(device: wp.Device, name: str) -> None:
    rig = rig_of(device, name)
    first = depth_of(rig)
    truth = rig.renderer.images["top"]["depth"].cpu().numpy()
    assert (first != truth).any() and np.isfinite(first).any()
    kept = depth_of(rig, worlds=[1])
    assert (kept[[0, 2]] == first[[0, 2]]).all()


@pytest.mark.parametrize(
    ("name", "entry"),
    [(name, entry.name) for name, effect in EFFECTS.items() for entry in parameters_of(effect)],
)
def test_each_parameter_is_written_in_place_per_world(device: wp.Device, name: str, entry: str) -> None:
    """A rig with the parameter changed in one world before the first frame, against one that was not changed."""
    plain, changed = benches(name, device, entry)
    image = np.random.default_rng(0).uniform(0.5, 3.0, (3, 24, 32)).astype(np.float32)
    image[:, :, 16:], image[:, :2] = np.linspace(0.4, 0.9, 16), np.inf
    for _ in range(3):
        expected, measured = plain.measure(image), changed.measure(image)
    assert (measured[[0, 2]] == expected[[0, 2]]).all()
    assert (measured[1] != expected[1]).any()


def test_drift_ends_at_a_reset(device: wp.Device) -> None:
    rig = rig_of(device, "drift")
    first = depth_of(rig)
    truth = rig.renderer.images["top"]["depth"].cpu().numpy()
    rig.parameters("top").depth_drift_sigma[:] = 0.0
    rig.reset([1])
    second = depth_of(rig)
    seen = np.isfinite(truth)
    assert (second[1] == truth[1]).all() and (second[[0, 2]] == first[[0, 2]]).all()
    assert (first != truth)[seen].all()


def benches(name: str, device: wp.Device, entry: str) -> tuple[DepthBench, DepthBench]:
    effect = EFFECTS[name]
    value = float(np.asarray(getattr(effect, entry)))
    tensor = torch.full((3,), value, device=wp.device_to_torch(device))
    bench = functools.partial(DepthBench, device=device, normal=(0.0, 0.5, 0.75**0.5), color=(60, 60, 60))
    changed = bench(dataclasses.replace(effect, **{entry: tensor}))
    tensor[1] = OTHERS.get(f"{name} {entry}", OTHERS.get(entry, 2.0 * value + 1.0))
    return bench(effect), changed


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.needs_pinhole])
def test_lenses_without_focal_length_are_refused(name: str) -> None:
    for lens in (wc.Orthographic(height=3.0), wc.Fisheye(fovy=120.0)):
        with pytest.raises(wc.WarpcamError, match="needs a camera with a pinhole lens"):
            rig_of("cpu", name, lens=lens)


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.reads])
def test_outputs_that_are_missing_are_named(name: str) -> None:
    (output,) = EFFECTS[name].reads
    with pytest.raises(wc.WarpcamError, match=f"needs '{output}' among the camera's outputs"):
        rig_of("cpu", name, outputs=("depth",))


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (sensors.MatchingWindow(baseline=0.1, radius=0), "radius must be a whole number from 1 to 15, got 0"),
        (sensors.MatchingWindow(baseline=0.1, radius=2.0), "radius must be a whole number from 1 to 15, got 2.0"),
        (sensors.StereoShadow(baseline=0.1, border=1), "border must be True or False, got 1"),
        (sensors.RandomDropout(probability=1.5), "RandomDropout: probability must be from 0 to 1, got 1.5"),
        (sensors.DisparityNoise(baseline=0.0, sigma=0.1), "DisparityNoise: baseline must be from 1e-06 to inf, got 0"),
        (sensors.GrazingDropout(start=100.0, end=20.0), "GrazingDropout: start must be from 0 to 90, got 100"),
        (sensors.DepthDrift(sigma=[0.1, 0.2]), "DepthDrift: sigma must have shape"),
        (sensors.EdgeDropout(threshold=float("nan")), "EdgeDropout: threshold must be finite"),
    ],
)
def test_bad_settings_are_refused(effect: sensors.Effect, message: str) -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=OUTPUTS)])
    with pytest.raises(wc.WarpcamError, match=message):
        sensors.Rig(renderer, {"top": [effect]})
