"""Lights of stages made here. With an exposure of 0 a white surface shows what arrives, divided by pi."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Usd, UsdGeom, UsdLux
from usd_stages import above, add_material, add_square, bind, image, save_image


def shown(stage: Usd.Stage, device: wp.Device, at: tuple = (0.0, 0.0)) -> np.ndarray:
    """Radiance of a white floor at a place, (3,)."""
    square = add_square(stage, "/floor", half=0.01)
    square.CreateDisplayColorAttr([(1, 1, 1)])
    add_material(stage, "/Looks/white", diffuseColor=(1.0, 1.0, 1.0), ior=1.0)  # mirrors nothing
    bind(square, stage, "/Looks/white")
    camera = wc.Camera(
        "c", width=1, height=1, lens=wc.Orthographic(height=1e-3), position=(*at, 0.5), outputs=("hdr",),
        rotation=(1.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    return image(wc.from_usd(stage, device=device, exposure=0.0), "hdr", camera)


def test_a_distant_light(stage: Usd.Stage, device: wp.Device) -> None:
    light = UsdLux.DistantLight.Define(stage, "/light")
    light.CreateIntensityAttr(2.0)
    light.CreateExposureAttr(1.0)
    light.CreateColorAttr((1.0, 0.5, 0.25))
    light.CreateAngleAttr(60.0)  # a disk of this size: sin(30 degrees)^2 of its radiance
    UsdGeom.Xformable(light).AddRotateXOp().Set(60.0)
    np.testing.assert_allclose(shown(stage, device), 4.0 * 0.25 * 0.5 * np.array((1.0, 0.5, 0.25)), rtol=1e-4)
    light.CreateNormalizeAttr(True)
    np.testing.assert_allclose(shown(stage, device), 4.0 / np.pi * 0.5 * np.array((1.0, 0.5, 0.25)), rtol=1e-4)


def test_a_distant_lights_temperature(stage: Usd.Stage, device: wp.Device) -> None:
    light = UsdLux.DistantLight.Define(stage, "/light")
    light.CreateIntensityAttr(1.0)
    light.CreateNormalizeAttr(True)
    light.CreateColorTemperatureAttr(3000.0)
    np.testing.assert_allclose(shown(stage, device), 1.0 / np.pi, rtol=1e-4)
    light.CreateEnableColorTemperatureAttr(True)
    wanted = np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0)) / np.pi
    np.testing.assert_allclose(shown(stage, device), wanted, rtol=1e-4)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_disk_and_a_sphere_on_their_axis(stage: Usd.Stage, scale: float, device: wp.Device) -> None:
    """A disk of radius r gives L r^2 / (r^2 + d^2) under its middle, a sphere L r^2 / d^2; both over pi."""
    disk = UsdLux.DiskLight.Define(stage, "/light")
    disk.CreateIntensityAttr(3.0)
    disk.CreateRadiusAttr(0.5)
    UsdGeom.Xformable(disk).AddTranslateOp().Set((0, 0, 2))
    UsdGeom.Xformable(disk).AddScaleOp().Set((scale,) * 3)
    radius = 0.5 * scale
    np.testing.assert_allclose(shown(stage, device), 3.0 * radius**2 / (radius**2 + 4.0), rtol=1e-3)
    stage.RemovePrim("/light")
    sphere = UsdLux.SphereLight.Define(stage, "/light")
    sphere.CreateIntensityAttr(3.0)
    sphere.CreateRadiusAttr(radius)
    UsdGeom.Xformable(sphere).AddTranslateOp().Set((0, 0, 2))
    np.testing.assert_allclose(shown(stage, device), 3.0 * radius**2 / 4.0, rtol=1e-3)


def test_a_rectangle_shines_one_way_and_a_cone_is_kept(stage: Usd.Stage, device: wp.Device) -> None:
    light = UsdLux.RectLight.Define(stage, "/light")
    light.CreateIntensityAttr(3.0)
    light.CreateWidthAttr(0.1)
    light.CreateHeightAttr(0.2)
    move = UsdGeom.Xformable(light).AddTranslateOp()
    turn = UsdGeom.Xformable(light).AddRotateXOp()
    move.Set((0, 0, 2))
    np.testing.assert_allclose(shown(stage, device), 3.0 * 0.02 / np.pi / 4.0, rtol=5e-3)
    turn.Set(180.0)
    assert (shown(stage, device) == 0.0).all()
    turn.Set(45.0)
    assert (shown(stage, device) > 0.0).all()
    UsdLux.ShapingAPI.Apply(light.GetPrim()).CreateShapingConeAngleAttr(40.0)
    assert (shown(stage, device) == 0.0).all()
    stage.RemovePrim("/light")
    sphere = UsdLux.SphereLight.Define(stage, "/light")
    UsdLux.ShapingAPI.Apply(sphere.GetPrim())  # half of all around, unless it is told
    UsdGeom.Xformable(sphere).AddTranslateOp().Set((0, 0, 2))
    assert (shown(stage, device) > 0.0).all()
    UsdGeom.Xformable(sphere).AddRotateXOp().Set(180.0)
    assert (shown(stage, device) == 0.0).all()


def test_a_dome_is_everywhere(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    dome = UsdLux.DomeLight.Define(stage, "/dome")
    dome.CreateIntensityAttr(0.5)
    np.testing.assert_allclose(shown(stage, device), 0.5, rtol=1e-4)
    save_image(tmp_path / "sky.png", np.full((2, 4, 3), 188, np.uint8))
    dome.CreateTextureFileAttr("./sky.png")
    np.testing.assert_allclose(shown(stage, device), 0.25, rtol=0.01)


@pytest.mark.parametrize(("kind", "pole"), [("DomeLight", ""), ("DomeLight_1", "Y"), ("DomeLight_1", "scene")])
def test_the_sky_is_where_usd_says(kind: str, pole: str, stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """The image's middle lies along +z of the dome, its left quarter along +x, its top is +y; or turned to its pole."""
    pixels = np.zeros((8, 16, 3), np.uint8)
    pixels[4:] = 20
    pixels[:, 7:9] = (255, 0, 0)
    pixels[:, 3:5] = (0, 255, 0)
    pixels[:1] = (0, 0, 255)
    save_image(tmp_path / "sky.png", pixels, 32)
    dome = stage.DefinePrim("/dome", kind)
    dome.GetAttribute("inputs:texture:file").Set("./sky.png")
    if pole:
        dome.GetAttribute("poleAxis").Set(pole)
    turned = pole == "scene"
    UsdGeom.SetStageUpAxis(stage, "Z" if turned else "Y")
    UsdGeom.Cube.Define(stage, "/far").AddTranslateOp().Set((0, 0, -500))
    scene = wc.from_usd(stage, device=device, up_axis=None)
    half = np.sqrt(0.5)
    middle, left, top = (0.0, 0.0, 1.0, 0.0), (half, 0.0, -half, 0.0), (half, half, 0.0, 0.0)  # along +z, +x, +y
    if turned:
        middle, top = (half, -half, 0.0, 0.0), middle  # along -y, +z
    for turn, color in ((middle, [255, 0, 0]), (left, [0, 255, 0]), (top, [0, 0, 255])):
        camera = wc.Camera("c", width=3, height=3, lens=wc.Pinhole(fovy=5.0), rotation=turn, outputs=("rgb",))
        assert np.abs(image(scene, "rgb", camera)[1, 1].astype(int) - color).max() < 12


def test_lights_are_exposed_together(stage: Usd.Stage, device: wp.Device) -> None:
    """Whatever their units: the middle of the scene is lit as a white surface should be."""
    square = add_square(stage, "/floor", half=0.01)
    add_material(stage, "/Looks/white", diffuseColor=(1.0, 1.0, 1.0), ior=1.0)  # mirrors nothing
    bind(square, stage, "/Looks/white")
    for name, intensity, x in (("a", 30000.0, 0.3), ("b", 10000.0, -0.3)):
        light = UsdLux.SphereLight.Define(stage, f"/{name}")
        light.CreateIntensityAttr(intensity)
        UsdGeom.Xformable(light).AddTranslateOp().Set((x, 0, 5))
    seen = image(wc.from_usd(stage, device=device), "hdr", above(3.0, 3, 0.01, "hdr"))[1, 1]
    np.testing.assert_allclose(seen, 1.0, atol=0.02)


def test_the_brightest_lights_shine(stage: Usd.Stage, caplog: pytest.LogCaptureFixture, device: wp.Device) -> None:
    """However many there are, and wherever in the file: and what is invisible does not."""
    for number in range(40):
        light = UsdLux.DistantLight.Define(stage, f"/l{number}")
        light.CreateNormalizeAttr(True)
        light.CreateIntensityAttr(np.pi if number == 39 else 1e-4)
        light.CreateColorAttr((1.0, 0.0, 0.0) if number == 39 else (0.0, 1.0, 0.0))
    hidden = UsdLux.DistantLight.Define(stage, "/hidden")
    hidden.CreateIntensityAttr(1e6)
    UsdGeom.Imageable(hidden).MakeInvisible()
    square = add_square(stage, "/floor", half=0.01)
    add_material(stage, "/Looks/white", diffuseColor=(1.0, 1.0, 1.0), ior=1.0)  # mirrors nothing
    bind(square, stage, "/Looks/white")
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    camera = above(3.0, 3, 0.01, "hdr", shadows=True)
    np.testing.assert_allclose(image(scene, "hdr", camera)[1, 1], (1.0, 0.0, 0.0), atol=1e-3)
    assert "has 40 lights, of which the 8 that give the most light here shine" in caplog.text
