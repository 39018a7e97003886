"""Tone mapping: display colours beside curves in float64, of the light that the same images have."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from tone_curves import CURVES

import warpcam as wc
from warpcam import sensors
from warpcam.core.color import linear_to_srgb

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, add_ball, add_sun
from pxr import Usd, UsdLux

LOOKS = ("pbr", "path")
SIZE = 12
GREYS = 40  # worlds whose background is grey, each 0.6 stops brighter than the one before
COLORS = 40  # and of any colour; in the last one light is brighter than a number of 32 bits can be
OUTPUTS = ("rgb", "rgba", "hdr")


def camera(**more: Any) -> wc.Camera:
    return wc.Camera(
        "c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0, 0, 0), outputs=OUTPUTS, **more
    )


def seen(scene: wc.Scene, look: str | None, **more: Any) -> dict[str, np.ndarray]:
    path = wc.PathOptions(samples=4) if look == "path" else None
    images = wc.Renderer(scene, [camera(**more)], look=look, path=path).render()["c"]
    return {name: image.cpu().numpy() for name, image in images.items()}


def wanted(curve: str, light: np.ndarray) -> np.ndarray:
    """Display colours, in levels of 255, not rounded."""
    return 255.0 * linear_to_srgb(CURVES[curve](np.minimum(light.astype(np.float64), 1e15)))


def check(curve: str, images: dict[str, np.ndarray]) -> None:
    error = np.abs(images["rgb"] - wanted(curve, images["hdr"]))
    assert error.max() < 0.51
    np.testing.assert_array_equal(images["rgb"], images["rgba"][..., :3])


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("curve", CURVES)
def test_colours_are_the_curve_of_the_light(stage: Usd.Stage, curve: str, look: str, device: wp.Device) -> None:
    """On a ball and beside it, over 24 stops: greys become no darker with light, and black stays black."""
    add_ball(stage, diffuseColor=(0.9, 0.4, 0.05), roughness=0.4)
    add_sun(stage, (0.5, 0.3, 1.0))
    count = GREYS + COLORS
    scene = wc.from_usd(stage, num_worlds=count, device=device, exposure=0.0)
    background = np.random.default_rng(0).uniform(0.0, 1.0, (count, 3)).astype(np.float32)
    background[:GREYS] = 0.5
    background[0] = 0.0
    exposure = np.concatenate((np.arange(GREYS) * 0.6 - 12.0, np.linspace(-12.0, 12.0, COLORS))).astype(np.float32)
    exposure[-1] = 127.0
    images = seen(scene, look, tone_mapping=curve, background=background, exposure=exposure)
    check(curve, images)
    grey = images["rgb"][:GREYS, 0, 0].astype(int)
    assert (grey[0] == 0).all() and (np.diff(grey, axis=0) >= 0).all() and (grey[-1] > 250).all()
    assert np.ptp(grey, axis=-1).max() <= 1
    assert len(np.unique(images["rgb"][:, SIZE // 2, SIZE // 2], axis=0)) > GREYS // 2  # the ball's


@pytest.mark.parametrize("curve", ["khronos_neutral", "agx"])
def test_what_is_seen_through_others_and_the_sky(stage: Usd.Stage, curve: str, device: wp.Device) -> None:
    """Layers of light are laid over each other before the curve, under a sky or a plain background without exposure."""
    add_ball(stage, diffuseColor=(0.9, 0.4, 0.05), opacity=0.6, emissiveColor=(3.0, 0.5, 0.0))
    plain = seen(wc.from_usd(stage, device=device, exposure=0.0), "pbr", tone_mapping=curve, background=(0.9, 0.5, 0.1))
    check(curve, plain)
    sky = UsdLux.DomeLight.Define(stage, "/sky")
    sky.CreateIntensityAttr(4.0)
    sky.CreateColorAttr((0.3, 0.6, 1.0))
    check(curve, seen(wc.from_usd(stage, device=device, exposure=0.0), "pbr", tone_mapping=curve))


def test_light_itself_has_no_curve(stage: Usd.Stage, device: wp.Device) -> None:
    add_ball(stage, diffuseColor=(0.9, 0.4, 0.05))
    add_sun(stage, (0.5, 0.3, 1.0))
    scene = wc.from_usd(stage, device=device, exposure=2.0)
    plain, mapped = seen(scene, "pbr"), seen(scene, "pbr", tone_mapping="agx")
    np.testing.assert_array_equal(plain["hdr"], mapped["hdr"])
    assert (plain["rgb"] != mapped["rgb"]).any()


def test_means_at_edges_are_of_colours(stage: Usd.Stage, device: wp.Device) -> None:
    """Smooth edges show no other colours than those of both sides and between them."""
    add_ball(stage, diffuseColor=(0.0, 0.0, 0.0), emissiveColor=(40.0, 40.0, 40.0))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    images = seen(scene, "pbr", tone_mapping="reinhard", antialiasing=4)
    levels = 255.0 * linear_to_srgb(40.0 / 41.0) * np.arange(5) / 4.0
    assert np.abs(images["rgb"][..., :1] - levels).min(axis=-1).max() <= 1.0
    assert len(np.unique(images["rgb"])) > 2


def test_refusals(stage: Usd.Stage, device: wp.Device) -> None:
    allowed = "allowed are 'clip', 'reinhard', 'aces', 'khronos_neutral', 'agx'"
    for bad in ("filmic", None, 1, ["agx"], np.array(["agx"]), np.array(["agx", "clip"])):
        with pytest.raises(wc.WarpcamError, match=re.escape(f"Camera('c'): tone_mapping is {bad!r}; {allowed}")):
            camera(tone_mapping=bad)
    mjm = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    text = "Camera('c'): tone_mapping is 'agx', and the look is 'mujoco', which has 'clip' alone"
    for make in (wc.Renderer, wc.estimate_memory):
        with pytest.raises(wc.WarpcamError, match=re.escape(text)):
            make(scene, [camera(tone_mapping="agx")])
    add_ball(stage)
    renderer = wc.Renderer(wc.from_usd(stage, device=device), [camera(tone_mapping="agx")])
    with pytest.raises(wc.WarpcamError, match=r"Gain makes colours of light by sRGB alone, .* got 'agx'"):
        sensors.Rig(renderer, {"c": [sensors.Gain(2.0)]})
