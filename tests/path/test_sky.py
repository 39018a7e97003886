"""Skies with an image, whose bright parts are drawn as lights."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from path_scenes import inside, traced
from PIL import Image

import warpcam as wc
from warpcam.core.color import linear_to_srgb, srgb_to_linear
from warpcam.render import paths

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, SIZE, add_ball, ball_normals
from pxr import Usd, UsdGeom, UsdLux

CAMERA = wc.Camera("c", width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=(0.0, 0.0, 0.0), outputs=("hdr",))


def add_sky(stage: Usd.Stage, folder: Path, pixels: np.ndarray, intensity: float) -> None:
    """A dome whose image's top is +z."""
    Image.fromarray(pixels.astype(np.uint8)).save(folder / "sky.png")
    dome = UsdLux.DomeLight.Define(stage, "/sky")
    dome.CreateTextureFileAttr("./sky.png")
    dome.CreateIntensityAttr(intensity)
    UsdGeom.Xformable(dome).AddRotateXOp().Set(90.0)


def test_a_sky_of_one_colour(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """A matt surface shows it times its own colour; it is behind the ball, as bright."""
    add_sky(stage, tmp_path, np.full((8, 16, 3), (188, 137, 99)), 2.0)
    color = np.array((0.5, 0.25, 1.0))
    add_ball(stage, diffuseColor=tuple(color), ior=1.0)
    seen = traced(wc.from_usd(stage, device=device, exposure=0.0), CAMERA, 64)["hdr"]
    radiance = 2.0 * srgb_to_linear(np.array((188, 137, 99)) / 255.0)
    np.testing.assert_allclose(seen[inside(ball_normals()[0])].mean(axis=0), color * radiance, rtol=0.01)
    np.testing.assert_allclose(seen[0, 0], radiance, rtol=5e-3)


def test_a_sky_lights_from_where_it_is_bright(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Radiance 1 + z is 1 + 2/3 n.z on a matt surface."""
    up = np.sin(np.pi * (0.5 - (np.arange(64) + 0.5) / 64))
    pixels = np.rint(255.0 * linear_to_srgb(0.5 * (1.0 + up)))[:, None, None].repeat(128, 1).repeat(3, 2)
    add_sky(stage, tmp_path, pixels, 2.0)
    add_ball(stage, diffuseColor=(1.0, 1.0, 1.0), ior=1.0)
    hit, normals, _ = ball_normals()
    seen, normal = traced(wc.from_usd(stage, device=device, exposure=0.0), CAMERA, 256)["hdr"][hit], normals[:, 2]
    for low in (0.4, 0.6, 0.8):
        some = inside(hit)[hit] & (normal > low) & (normal < low + 0.2)
        assert seen[some].mean() == pytest.approx(1.0 + 2.0 / 3.0 * normal[some].mean(), rel=0.02)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
def test_bright_parts_are_drawn(
    stage: Usd.Stage, tmp_path: Path, metallic: float, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small bright window in a dark sky: the same light as where it is met by chance, with a third of the noise."""
    pixels = np.full((64, 128, 3), 30)
    pixels[8:14, 20:30] = 255
    add_sky(stage, tmp_path, pixels, 5.0)
    add_ball(stage, diffuseColor=(0.8, 0.8, 0.8), metallic=metallic, roughness=0.4)
    scene, hit = wc.from_usd(stage, device=device, exposure=0.0), ball_normals()[0]
    drawn = traced(scene, CAMERA, 64)["hdr"][hit]
    few = traced(scene, CAMERA, 8, seed=1)["hdr"][hit]
    monkeypatch.setattr(paths, "sky_sums", lambda tables: (np.zeros(0, np.float32), 0))
    met = traced(scene, CAMERA, 256)["hdr"][hit]
    few_met = traced(scene, CAMERA, 8, seed=1)["hdr"][hit]
    assert drawn.mean() == pytest.approx(met.mean(), rel=0.02)
    assert np.abs(few - drawn).mean() < 0.5 * np.abs(few_met - drawn).mean()
