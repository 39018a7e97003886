"""All effects on colours: worlds that are left alone, parameters in place, seeds, chains in a rig."""

import importlib
import inspect
import pkgutil
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from color_effects import EFFECTS, EMVA
from measured_colors import Bench, measured, picture
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.kernels.types import View
from warpcam.sensors import color
from warpcam.sensors.effect import parameters_of

# Effects that look at neighbours have another image, but for these; those on a pixel by itself, wherever it is.
PLACED = (sensors.JpegArtifacts, sensors.NaturalVignetting, sensors.Ppisp, sensors.Vignetting)
POINTWISE = [effect for effect in EFFECTS if effect.in_place and not isinstance(effect, PLACED)]
# Values to which parameters do react, where half of those above are no change to see.
OTHERS = {"bits": 2.0, "full_well": 1000.0, "black_level": 60.0}


def bench_of(effect: sensors.Effect, images: np.ndarray, device: wp.Device, **options: Any) -> Bench:
    view = View()
    view.scale, view.center = wp.vec2(0.05, 0.05), wp.vec2(13.0, 10.0)
    depth = np.linspace(1.0, 2.0, images.shape[2])
    return Bench(effect, images, device, views=[view] * len(images), depth=depth, **options)


def name_of(value: Any) -> str:
    return type(value).__name__


def test_every_effect_is_here() -> None:
    """Effects that modules of the colour room define are exported and tested."""
    found = set()
    for module in pkgutil.iter_modules(color.__path__, f"{color.__name__}."):
        members = vars(importlib.import_module(module.name)).values()
        found |= {each for each in members if inspect.isclass(each) and each.__module__ == module.name}
    assert {each for each in found if issubclass(each, sensors.Effect)} == {type(effect) for effect in EFFECTS}
    assert {each.__name__ for each in found} <= set(sensors.__all__)


@pytest.mark.parametrize("effect", EFFECTS, ids=name_of)
def test_worlds_that_are_not_measured_stay(effect: sensors.Effect, device: wp.Device) -> None:
    images = np.repeat(picture(worlds=1), 3, axis=0)
    bench = bench_of(effect, images, device)
    before = bench()
    bench.mask.assign(np.array([1, 0, 1], np.uint8))
    bench.frames.fill_(5)
    after = bench()
    assert (after[1] == (images if effect.in_place else before)[1]).all()
    assert not (after[0] == images[0]).all() and not (after[2] == images[2]).all()


@pytest.mark.parametrize("effect", EFFECTS, ids=name_of)
def test_each_parameter_counts_in_its_world(effect: sensors.Effect, device: wp.Device) -> None:
    """What is written to an array of a parameter changes its world, and that alone, in the next frame."""
    images = np.repeat(picture(worlds=1), 2, axis=0)
    for entry in parameters_of(effect):
        bench = bench_of(effect, images, device)
        before = bench()
        bench.frames.zero_()  # the same random numbers again
        array = getattr(bench.params, entry.name)
        values = array.numpy()
        values[1] = OTHERS.get(entry.name, 0.5 * values[1] - 0.1 * (values[1] <= 0.0))
        array.assign(values)
        after = bench()
        assert (after[0] == before[0]).all(), entry.name
        assert np.abs(after[1] - before[1]).max() > 1e-4, entry.name


@pytest.mark.parametrize("effect", EFFECTS, ids=name_of)
def test_what_is_measured_follows_seed_world_and_frame(effect: sensors.Effect, device: wp.Device) -> None:
    few, many = (bench_of(effect, picture(worlds=count), device) for count in (2, 4))
    for _ in range(2):
        assert (few() == many()[:2]).all()


@pytest.mark.parametrize(
    "effect", [each for each in EFFECTS if each.in_place and type(each) not in PLACED], ids=name_of
)
def test_images_of_one_row_or_column_have_the_same_pixels(effect: sensors.Effect, device: wp.Device) -> None:
    """Strips, which end within images, have all pixels, each under its number."""
    light = picture(21, 37)
    found = bench_of(effect, light, device)().reshape(2, -1, 3)
    assert not (found == light.reshape(found.shape)).all(axis=(0, 2)).all()
    for shape in ((1, 777), (777, 1)):
        assert (bench_of(effect, light.reshape(2, *shape, 3), device)().reshape(found.shape) == found).all()


@pytest.mark.parametrize("effect", EFFECTS, ids=name_of)
def test_light_far_from_white_stays_finite(effect: sensors.Effect, device: wp.Device) -> None:
    for light in (0.0, -1.0, 1e-30, 1e6):
        assert np.isfinite(bench_of(effect, np.full((1, 8, 8, 3), light), device)()).all(), light


def chain() -> list[sensors.Effect]:
    return [
        sensors.NaturalVignetting(),
        sensors.ChromaticAberration(1.002, 0.998),
        sensors.Blur(0.5),
        sensors.Exposure(0.5),
        sensors.Prnu(0.01),
        sensors.Dsnu(0.002),
        sensors.Emva1288(**{**EMVA, "gain": 0.9, "bits": 12.0, "dark_noise": 3.0, "dark_current": 10.0}),
        sensors.DeadPixels(0.001, 0.001),
        sensors.BayerMosaic(),
        sensors.WhiteBalance.from_temperature(5000.0),
        sensors.GammaCurve(2.2),
        sensors.Sharpening(0.5),
        sensors.JpegArtifacts(80.0),
        sensors.Quantization(8.0),
    ]


@pytest.mark.parametrize("outputs", [("rgb",), ("rgba", "hdr")])
def test_effects_make_a_camera(outputs: tuple[str, ...], device: wp.Device) -> None:
    rigs = [
        sensors.Rig(wc.Renderer(scene_of(device, 3), [camera(outputs=outputs)]), {"top": chain()}, seed=4) for _ in "ab"
    ]
    first, again = ([rig.read()["top"][outputs[0]].cpu().numpy().copy() for _ in range(2)] for rig in rigs)
    assert (first[0] == again[0]).all() and (first[1] == again[1]).all()
    truth = rigs[0].renderer.images["top"][outputs[0]].cpu().numpy()
    assert not (first[0] == first[1]).all()
    assert np.corrcoef(first[0].ravel(), truth.ravel())[0, 1] > 0.8
    assert len({name for name in rigs[0].parameters("top") if name.startswith("emva1288_")}) == 9
    before = rigs[0].images["top"][outputs[0]].clone()
    rigs[0].parameters("top").exposure_stops[1] = -4.0
    after = rigs[0].read()["top"][outputs[0]].to(torch.int32)
    assert (after[1].float().mean() < 0.7 * before[1].float().mean()) and after[0].float().mean() > 10.0


@pytest.mark.parametrize("output", ["rgb", "rgba"])
@pytest.mark.parametrize(
    "before", [[], [sensors.Gain(1.5)], [sensors.GammaCurve(1.8)]], ids=["none", "light", "display"]
)
def test_coding_begins_with_the_bytes_before_it(before: list[sensors.Effect], output: str, device: wp.Device) -> None:
    """JPEG of what the effect before it would give as the last is JPEG of numbers, byte for byte."""
    scene, jpeg = scene_of(device, 2), sensors.JpegArtifacts(60.0)

    def last(effects: list[sensors.Effect]) -> np.ndarray:
        rig = sensors.Rig(wc.Renderer(scene, [camera(outputs=(output,))]), {"top": effects})
        return rig.read()["top"][output].cpu().numpy().copy()

    given, found = last([*before, sensors.Quantization(8.0)]), last([*before, jpeg])
    expected = bench_of(jpeg, given[..., :3] / 255.0, device)()
    assert (found[..., :3] == np.rint(255.0 * expected)).all()
    assert (found[..., 3:] == given[..., 3:]).all() and (found != given).any()
    again = last([*before, jpeg, sensors.Quantization(8.0)])
    assert (again == found).all()


def test_curves_end_linear_light() -> None:
    renderer = wc.Renderer(scene_of("cpu", 1), [camera(outputs=("rgb",))])
    for curve in (sensors.ToneCurve(), sensors.GammaCurve(2.2), sensors.ResponseCurve(), sensors.Ppisp()):
        with pytest.raises(wc.WarpcamError, match=f"Gain changes linear light and must come before {name_of(curve)}"):
            sensors.Rig(renderer, {"top": [curve, sensors.Gain(2.0)]})


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (sensors.ShotNoise(0.0), "ShotNoise: electrons must be from 0.001 to"),
        (sensors.ReadNoise(-0.1), "ReadNoise: sigma must be from 0 to inf, got -0.1"),
        (
            sensors.Emva1288(**{**EMVA, "quantum_efficiency": 1.2}),
            "quantum_efficiency must be from 0.001 to 1, got 1.2",
        ),
        (
            sensors.Emva1288(**{**EMVA, "black_level": [12.0, 255.0]}),
            "black_level must be below the greatest number of the bits, 255, got 255",
        ),
        (sensors.Blur(14.0), "Blur: sigma must be from 0 to 10, got 14"),
        (sensors.JpegArtifacts(0.0), "JpegArtifacts: quality must be from 1 to 100, got 0"),
        (sensors.WhiteBalance((1.0, 1.0)), r"WhiteBalance: gains must have shape \(3,\) or \(2, 3\), got \(2,\)"),
        (sensors.Quantization(17), "Quantization: bits must be from 1 to 16, got 17"),
        (sensors.DeadPixels(dead=float("nan")), "DeadPixels: dead must be finite"),
    ],
    ids=name_of,
)
def test_bad_parameters_are_refused(effect: sensors.Effect, message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        measured(effect, picture(), wp.get_device("cpu"))
