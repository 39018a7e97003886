"""Automatic exposure and bloom, beside their formulas in float64 of the light of a camera that has neither."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp
from scipy import ndimage
from tone_curves import CURVES

import warpcam as wc
from warpcam.core.color import linear_to_srgb
from warpcam.render import scratch_memory

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, add_ball, add_sun
from pxr import Usd

LOOKS = ("pbr", "path")
OUTPUTS = ("rgb", "rgba", "hdr")
WIDTH, HEIGHT = 14, 10
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
BACKGROUNDS = np.array([[0.2, 0.3, 0.1], [0.9, 0.8, 1.0], [0.0, 0.0, 0.0]])


def camera(name: str = "c", **more: Any) -> wc.Camera:
    size = {"width": WIDTH, "height": HEIGHT, "lens": wc.Pinhole(fovy=FOVY), "position": (0, 0, 0)}
    return wc.Camera(name, **{"outputs": OUTPUTS, "background": BACKGROUNDS} | size | more)


@pytest.fixture
def scene(stage: Usd.Stage, device: wp.Device) -> wc.Scene:
    """A ball in the sun, in three worlds; the last one's background is black."""
    add_ball(stage, diffuseColor=(0.9, 0.4, 0.05), roughness=0.3)
    add_sun(stage, (0.5, 0.3, 1.0))
    return wc.from_usd(stage, num_worlds=len(BACKGROUNDS), device=device, exposure=0.0)


def rendered(scene: wc.Scene, look: str, *cameras: wc.Camera) -> wc.Renderer:
    renderer = wc.Renderer(scene, cameras, look=look, path=wc.PathOptions(samples=4) if look == "path" else None)
    renderer.render()
    return renderer


def seen(renderer: wc.Renderer, name: str, output: str = "hdr") -> np.ndarray:
    return renderer.images[name][output].cpu().numpy().astype(np.float64)


def stops_of(light: np.ndarray, key: float = 0.18) -> np.ndarray:
    """The exposure of each world, from pixels that show light."""
    luminance = light @ LUMINANCE
    return np.array([np.log2(key) - np.log2(each[each > 0.0]).mean() for each in luminance])


@pytest.mark.parametrize("look", LOOKS)
def test_exposure_of_each_world(scene: wc.Scene, look: str, device: wp.Device) -> None:
    """Pixels in the dark do not count; the manual exposure and the gain come on top, the curve after."""
    auto = camera("auto", auto_exposure=wc.AutoExposure(key=0.3), exposure=[0.0, 1.0, -1.0], gain=(1.0, 0.5, 2.0),
                  tone_mapping="aces")  # fmt: skip
    renderer = rendered(scene, look, camera("plain"), auto, camera("alone", auto_exposure=wc.AutoExposure(),
                                                                   outputs=("rgb",)))  # fmt: skip
    plain = seen(renderer, "plain")
    stops = stops_of(plain, 0.3)
    assert np.ptp(stops) > 1.0
    assert (plain[2] == 0.0).any()
    np.testing.assert_allclose(renderer.camera("auto").auto_exposure.cpu(), stops, atol=1e-4)
    own = stops + np.array((0.0, 1.0, -1.0))
    factor = 2.0 ** own[:, None, None, None] * np.array((1.0, 0.5, 2.0))
    np.testing.assert_allclose(seen(renderer, "auto"), plain * factor, rtol=1e-4)
    wanted = 255.0 * linear_to_srgb(CURVES["aces"](plain * factor))
    assert np.abs(seen(renderer, "auto", "rgb") - wanted).max() < 0.51
    np.testing.assert_array_equal(seen(renderer, "auto", "rgb"), seen(renderer, "auto", "rgba")[..., :3])
    np.testing.assert_array_equal(seen(renderer, "plain", "rgba")[..., 3], seen(renderer, "auto", "rgba")[..., 3])
    own = plain * 2.0 ** stops_of(plain)[:, None, None, None]
    assert np.abs(seen(renderer, "alone", "rgb") - 255.0 * linear_to_srgb(np.minimum(own, 1.0))).max() < 0.51


def test_limits_and_darkness(stage: Usd.Stage, device: wp.Device) -> None:
    add_ball(stage, diffuseColor=(0.0, 0.0, 0.0), ior=1.0)
    add_sun(stage, (0.5, 0.3, 1.0))
    scene = wc.from_usd(stage, num_worlds=3, device=device, exposure=0.0)
    grey = np.array([[0.2] * 3, [1.0] * 3, [0.0] * 3])
    renderer = rendered(scene, "pbr", camera(background=grey, auto_exposure=wc.AutoExposure(limits=(-2.0, 1.5))))
    np.testing.assert_allclose(renderer.camera("c").auto_exposure.cpu(), (1.5, -2.0, 1.5))
    assert np.isfinite(seen(renderer, "c")).all()


@pytest.mark.parametrize("rate", [1.0, 0.25])
def test_adaptation(scene: wc.Scene, rate: float, device: wp.Device) -> None:
    """Each frame goes on from the last; worlds that are not drawn stay, and NaN begins anew."""
    renderer = rendered(scene, "pbr", camera("plain"), camera("auto", auto_exposure=wc.AutoExposure(rate=rate)))
    first = stops_of(seen(renderer, "plain"))
    automatic = renderer.camera("auto").auto_exposure
    np.testing.assert_allclose(automatic.cpu(), first, atol=1e-4)
    for name in ("plain", "auto"):
        renderer.camera(name).background[:] = 0.5
    renderer.render(worlds=[0, 1])
    changed = stops_of(seen(renderer, "plain"))
    once = first + rate * (changed - first)
    assert abs(changed[0] - first[0]) > 0.5
    np.testing.assert_allclose(automatic.cpu(), (once[0], once[1], first[2]), atol=1e-4)
    automatic[1] = torch.nan
    renderer.render()
    changed = stops_of(seen(renderer, "plain"))
    last = np.array((once[0], changed[1], first[2]))
    np.testing.assert_allclose(automatic.cpu(), last + rate * (changed - last), atol=1e-4)


@pytest.mark.parametrize("worlds", [None, [0, 2], [False, True, False]])
@pytest.mark.parametrize("outputs", [("hdr",), ("hdr", "flow")])
def test_reset_begins_adaptation_anew(scene: wc.Scene, worlds: Any, outputs: tuple[str, ...]) -> None:
    """Of the worlds that it is given alone, whether there is flow to be forgotten or not."""
    auto = camera("auto", auto_exposure=wc.AutoExposure(rate=0.25), outputs=outputs)
    renderer = rendered(scene, "pbr", camera("plain"), auto)
    automatic = renderer.camera("auto").auto_exposure
    automatic[:] = 5.0
    is_mask = worlds is not None and isinstance(worlds[0], bool)
    renderer.reset(torch.tensor(worlds, device=automatic.device) if is_mask else worlds)
    anew = np.zeros(len(BACKGROUNDS), bool)
    anew[slice(None) if worlds is None else worlds] = True
    np.testing.assert_array_equal(automatic.cpu(), np.where(anew, np.nan, 5.0))
    renderer.render()
    frame = stops_of(seen(renderer, "plain"))
    np.testing.assert_allclose(automatic.cpu(), np.where(anew, frame, 0.75 * 5.0 + 0.25 * frame), atol=1e-4)


def test_more_paths_are_no_more_frames(scene: wc.Scene, device: wp.Device) -> None:
    """They measure the same frame better, and start from the exposure that it started from."""
    auto = camera("auto", auto_exposure=wc.AutoExposure(rate=0.5), bloom=wc.Bloom())
    renderer = rendered(scene, "path", camera("plain"), auto)
    renderer.camera("auto").auto_exposure[:] = 3.0
    renderer.render()
    renderer.accumulate(4)
    renderer.accumulate(8)
    wanted = 0.5 * (3.0 + stops_of(seen(renderer, "plain")))
    np.testing.assert_allclose(renderer.camera("auto").auto_exposure.cpu(), wanted, atol=1e-4)
    light = 2.0**wanted * seen(renderer, "plain").sum(axis=(1, 2, 3))
    np.testing.assert_allclose(seen(renderer, "auto").sum(axis=(1, 2, 3)), light, rtol=1e-4)


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("radius", [0.02, 0.1, 0.25])
def test_bloom(scene: wc.Scene, look: str, radius: float, device: wp.Device) -> None:
    """A Gaussian of all light, reflected at the borders, which keeps the sum of each channel."""
    bloom = wc.Bloom(strength=0.4, radius=radius)
    renderer = rendered(scene, look, camera("plain"), camera("bloom", bloom=bloom, exposure=0.5),
                        camera("shown", bloom=bloom, outputs=("rgb", "depth")))  # fmt: skip
    plain = seen(renderer, "plain")
    sigma = radius * HEIGHT
    reach = {"mode": "reflect", "radius": int(np.ceil(3.0 * sigma))}
    blurred = ndimage.gaussian_filter(plain, (0.0, sigma, sigma, 0.0), **reach)
    wanted = 0.6 * plain + 0.4 * blurred
    np.testing.assert_allclose(seen(renderer, "bloom"), 2.0**0.5 * wanted, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(wanted.sum(axis=(1, 2)), plain.sum(axis=(1, 2)), rtol=1e-6)
    shown = 255.0 * linear_to_srgb(np.minimum(wanted, 1.0))
    assert np.abs(seen(renderer, "shown", "rgb") - shown).max() < 0.51


@pytest.mark.parametrize("samples", [4, 16])
def test_smooth_edges(scene: wc.Scene, samples: int, device: wp.Device) -> None:
    """The light of a pixel is the mean of its samples, then comes the curve."""
    options = {"antialiasing": samples, "tone_mapping": "reinhard"}
    renderer = rendered(scene, "pbr", camera("plain", **options), camera("auto", auto_exposure=wc.AutoExposure(),
                                                                         **options))  # fmt: skip
    light = seen(renderer, "plain")
    light = light * 2.0 ** stops_of(light)[:, None, None, None]
    np.testing.assert_allclose(seen(renderer, "auto"), light, rtol=1e-3)
    wanted = 255.0 * linear_to_srgb(CURVES["reinhard"](light))
    assert np.abs(seen(renderer, "auto", "rgb") - wanted).max() < 0.6


def test_memory_and_frames_alike(scene: wc.Scene, device: wp.Device) -> None:
    """What is allocated is what was told, and frames are the same bit for bit."""
    one = camera(auto_exposure=wc.AutoExposure(), bloom=wc.Bloom(), outputs=("rgb",))
    renderer = rendered(scene, "pbr", one)
    assert renderer.memory == wc.estimate_memory(scene, [one])
    first = seen(renderer, "c", "rgb")
    for _ in range(3):
        renderer.render()
        np.testing.assert_array_equal(seen(renderer, "c", "rgb"), first)


def test_groups_of_worlds(scene: wc.Scene, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """With little memory between the stages worlds are drawn one after another, and no image is written over."""
    both = {"auto_exposure": wc.AutoExposure(), "bloom": wc.Bloom()}
    cameras = [camera("few", outputs=("rgb", "depth"), **both), camera("all", antialiasing=4, **both)]
    whole = rendered(scene, "pbr", *cameras)
    monkeypatch.setattr(scratch_memory, "ALWAYS_ALLOWED", WIDTH * HEIGHT)
    grouped = rendered(scene, "pbr", *cameras)
    assert grouped.memory.scratch < whole.memory.scratch / 2
    for key, images in whole.images.items():
        for name in images:
            np.testing.assert_array_equal(seen(grouped, str(key), name), seen(whole, str(key), name))


@pytest.mark.parametrize("radius", [5e-324, 1e-300, 1e-4])
def test_a_bloom_narrower_than_a_pixel_leaves_it_as_it_is(radius: float) -> None:
    np.testing.assert_array_equal(wc.Bloom(radius=radius).weights(64), (1.0, 0.0))


def test_refusals(device: wp.Device) -> None:
    for options, says in (
        ({"key": 0.0}, "AutoExposure: key must be a number in"),
        ({"key": "grey"}, "AutoExposure: key must be a number in"),
        ({"rate": 0.0}, "AutoExposure: rate must be a number in (0, 1], got 0.0"),
        ({"rate": 1.5}, "AutoExposure: rate must be a number in (0, 1], got 1.5"),
        (
            {"limits": (2.0, 1.0)},
            "AutoExposure: limits must be two numbers of stops, from -127 to 127, the lower first",
        ),
        ({"limits": 3.0}, "AutoExposure: limits must be two numbers of stops, from -127 to 127, got 3.0"),
        ({"limits": (0.0, np.nan)}, "AutoExposure: limits must be a number in [-127, 127], got nan"),
    ):
        with pytest.raises(wc.WarpcamError, match=re.escape(says)):
            wc.AutoExposure(**options)
    for options, says in (
        ({"strength": -0.1}, "Bloom: strength must be a number in [0, 1], got -0.1"),
        ({"strength": True}, "Bloom: strength must be a number in [0, 1], got True"),
        ({"radius": 0.0}, "Bloom: radius must be a number in (0, 0.25], got 0.0"),
        ({"radius": 1.0}, "Bloom: radius must be a number in (0, 0.25], got 1.0"),
    ):
        with pytest.raises(wc.WarpcamError, match=re.escape(says)):
            wc.Bloom(**options)
    with pytest.raises(
        wc.WarpcamError, match=re.escape("Camera('c'): auto_exposure must be AutoExposure(...) or None")
    ):
        camera(auto_exposure=True)
    with pytest.raises(wc.WarpcamError, match=re.escape("Camera('c'): bloom must be Bloom(...) or None, got 0.5")):
        camera(bloom=0.5)
    mjm = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    for more in ({"auto_exposure": wc.AutoExposure()}, {"bloom": wc.Bloom()}):
        text = "Camera('c'): {} is {}.*, and the look is 'mujoco', which has None alone"
        name, value = next(iter(more.items()))
        with pytest.raises(wc.WarpcamError, match=text.format(name, type(value).__name__).replace("('c')", r"\('c'\)")):
            wc.Renderer(scene, [camera(background=(0.0, 0.0, 0.0), **more)])
