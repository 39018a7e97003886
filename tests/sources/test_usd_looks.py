"""Materials, textures and lights of stages made here."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils
from stages import above, add_material, add_mesh, add_square, image

QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [200, 100, 50]]], np.uint8)  # from the top


def save_image(path: Path, pixels: np.ndarray = QUARTERS, times: int = 16) -> Path:
    Image.fromarray(pixels.repeat(times, axis=0).repeat(times, axis=1)).save(path)
    return path


def bind(prim: Any, stage: Usd.Stage, path: str) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, path))


def textured_square(stage: Usd.Stage, file: str, *, uvs: Any = None, how: str = "vertex", **inputs: Any) -> Any:
    """A square 2 m wide, seen from above, with an image on it; returns its surface and the texture's reader."""
    square = add_square(stage, "/it")
    uvs = [(0, 0), (1, 0), (1, 1), (0, 1)] if uvs is None else uvs
    primvar = UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, how)
    primvar.Set([tuple(map(float, uv)) for uv in uvs])
    surface = add_material(stage, "/Looks/m", diffuseColor=(0.5, 0.5, 0.5))
    reader = UsdShade.Shader.Define(stage, "/Looks/m/uv")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, "/Looks/m/tex")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Float4 if isinstance(value, tuple) else Sdf.ValueTypeNames.Token
        texture.CreateInput(name, kind).Set(Gf.Vec4f(*value) if isinstance(value, tuple) else value)
    surface.GetInput("diffuseColor").ConnectToSource(texture.ConnectableAPI(), "rgb")
    bind(square, stage, "/Looks/m")
    return surface, texture


def albedo(scene: wc.Scene, span: float = 2.0, world: int = 0) -> np.ndarray:
    return image(scene, "albedo", above(3.0, 32, span, "albedo"), world)


def corners(picture: np.ndarray) -> list:
    """Colours in the middle of the four quarters, from the top left, row by row."""
    return [picture[row, column].tolist() for row in (8, 24) for column in (8, 24)]


PLAIN = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [200, 100, 50]]


@pytest.mark.parametrize("how", ["vertex", "varying", "faceVarying"])
def test_an_image_lies_as_usd_says(stage: Usd.Stage, tmp_path: Path, how: str, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png")
    textured_square(stage, "./tex.png", how=how)
    assert corners(albedo(wc.from_usd(stage, device=device))) == PLAIN


def test_indexed_coordinates_and_constants(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png")
    textured_square(stage, "./tex.png")
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/it")).GetPrimvar("st")
    primvar.Set([(1, 1), (0, 1), (0, 0), (1, 0)])
    primvar.SetIndices([2, 3, 0, 1])
    assert corners(albedo(wc.from_usd(stage, device=device))) == PLAIN
    primvar.BlockIndices()
    primvar.SetInterpolation("constant")
    primvar.Set([(0.25, 0.25)])
    assert corners(albedo(wc.from_usd(stage, device=device))) == [PLAIN[2]] * 4


def test_coordinates_are_transformed(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """Scaled, then turned by 90 degrees, then shifted."""
    save_image(tmp_path / "tex.png")
    _, texture = textured_square(stage, "./tex.png")
    turn = UsdShade.Shader.Define(stage, "/Looks/m/turn")
    turn.CreateIdAttr("UsdTransform2d")
    turn.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(90.0)
    turn.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set((2.0, 1.0))
    turn.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set((1.0, 0.5))
    reader = UsdShade.Shader.Get(stage, "/Looks/m/uv")
    turn.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    texture.GetInput("st").ConnectToSource(turn.ConnectableAPI(), "result")
    seen = albedo(wc.from_usd(stage, device=device))
    for row, column in ((8, 4), (24, 20), (3, 13), (28, 28)):
        u, v = (column + 0.5) / 32, 1.0 - (row + 0.5) / 32
        u, v = 1.0 - v, 0.5 + 2.0 * u
        wanted = QUARTERS[int((1.0 - v % 1.0) * 2), int(u % 1.0 * 2)]
        assert seen[row, column].tolist() == wanted.tolist()


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black", "useMetadata"])
def test_wrap_modes(stage: Usd.Stage, tmp_path: Path, wrap: str, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png")
    span = [(-1, -1), (2, -1), (2, 2), (-1, 2)]
    textured_square(stage, "./tex.png", uvs=span, wrapS=wrap, wrapT=wrap)
    seen = albedo(wc.from_usd(stage, device=device))

    def place(x: float) -> int | None:
        """Which half of the image, from the left or from below."""
        if wrap == "mirror":
            x = x % 2.0
            x = 2.0 - x if x > 1.0 else x
        elif wrap == "clamp":
            x = min(max(x, 0.0), 0.999)
        elif wrap == "black" and not 0.0 <= x < 1.0:
            return None
        return int(x % 1.0 * 2)

    for row in (2, 7, 13, 18, 24, 29):
        for column in (2, 7, 13, 18, 24, 29):
            left, below = place(-1 + 3 * (column + 0.5) / 32), place(2 - 3 * (row + 0.5) / 32)
            wanted = [0, 0, 0] if left is None or below is None else QUARTERS[1 - below, left].tolist()
            assert seen[row, column].tolist() == wanted, (row, column)


@pytest.mark.parametrize("space", ["auto", "sRGB", "raw"])
def test_colour_spaces(stage: Usd.Stage, tmp_path: Path, space: str, device: wp.Device) -> None:
    """Display colours: what is raw is encoded."""
    save_image(tmp_path / "tex.png", np.full((1, 1, 3), 55, np.uint8))
    textured_square(stage, "./tex.png", sourceColorSpace=space)
    wanted = 128 if space == "raw" else 55
    assert albedo(wc.from_usd(stage, device=device))[16, 16].tolist() == [wanted] * 3


def test_scale_and_bias(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png", np.full((1, 1, 3), 51, np.uint8))
    textured_square(stage, "./tex.png", sourceColorSpace="raw", scale=(2.0, 1.0, 0.0, 1.0), bias=(0.0, 0.3, 1.0, 0.0))
    wanted = [round(255 * (1.055 * x ** (1 / 2.4) - 0.055)) for x in (0.4, 0.5, 1.0)]
    assert albedo(wc.from_usd(stage, device=device))[16, 16].tolist() == wanted


def test_textures_inside_of_a_package(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png")
    textured_square(stage, "./tex.png")
    stage.Save()
    package = str(tmp_path / "scene.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "scene.usda"), package)
    (tmp_path / "tex.png").unlink()
    assert corners(albedo(wc.from_usd(package, device=device))) == PLAIN


@pytest.mark.parametrize("broken", [True, False])
def test_missing_and_broken_textures_are_named(
    stage: Usd.Stage, tmp_path: Path, caplog: pytest.LogCaptureFixture, broken: bool, device: wp.Device
) -> None:
    if broken:
        (tmp_path / "gone.png").write_bytes(b"no picture at all")
    textured_square(stage, "./gone.png")
    seen = albedo(wc.from_usd(stage, device=device))[16, 16]
    assert seen.tolist() == [188] * 3  # the base colour, encoded
    assert "gone.png of /Looks/m" in caplog.text
    assert ("its format is not known" if broken else "a texture is not found") in caplog.text


def test_a_missing_map_has_the_fallback_of_its_channel(stage: Usd.Stage, device: wp.Device) -> None:
    surface, texture = textured_square(stage, "gone.png", fallback=(0.1, 0.7, 0.3, 1.0))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "g")
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "b")
    (look,) = wc.from_usd(stage, device=device)._graph_source.graph.looks
    assert (look.roughness, look.metallic) == pytest.approx((0.7, 0.3))


def test_inputs_of_another_kind_are_named(
    stage: Usd.Stage, tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device
) -> None:
    surface, texture = textured_square(stage, str(save_image(tmp_path / "tex.png")))
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float).Set(2.0)
    turn = UsdShade.Shader.Define(stage, "/Looks/m/turn")
    turn.CreateIdAttr("UsdTransform2d")
    turn.CreateInput("rotation", Sdf.ValueTypeNames.String).Set("left")
    texture.GetInput("st").ConnectToSource(turn.ConnectableAPI(), "result")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(float("nan"))
    surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Float).Set(1.0)
    assert corners(albedo(wc.from_usd(stage, device=device))) == PLAIN
    for text in (
        "has scale that is not 4 finite numbers, and is left out: /Looks/m/tex",
        "has rotation that is not a finite number, and is left out: /Looks/m/turn",
        "has roughness that is not a finite number, and is left out: /Looks/m",
        "has emissiveColor that is not 3 finite numbers, and is left out: /Looks/m",
    ):
        assert text in caplog.text


def test_colours_are_encoded(stage: Usd.Stage, device: wp.Device) -> None:
    square = add_square(stage, "/it")
    assert albedo(wc.from_usd(stage, device=device))[16, 16].tolist() == [118] * 3
    square.CreateDisplayColorAttr([(0.2, 1.0, 0.0)])
    assert albedo(wc.from_usd(stage, device=device))[16, 16].tolist() == [124, 255, 0]
    add_material(stage, "/Looks/m", diffuseColor=(0.5, 0.0, 1.0))
    bind(square, stage, "/Looks/m")
    assert albedo(wc.from_usd(stage, device=device))[16, 16].tolist() == [188, 0, 255]


def test_display_colours_of_faces_and_points(stage: Usd.Stage, device: wp.Device) -> None:
    points = [(-1, -1, 0), (0, -1, 0), (1, -1, 0), (1, 1, 0), (0, 1, 0), (-1, 1, 0)]
    mesh = add_mesh(stage, "/it", points, [(0, 1, 4, 5), (1, 2, 3, 4)])
    mesh.CreateDisplayColorPrimvar("uniform").Set([(1, 0, 0), (0, 0, 1)])
    seen = albedo(wc.from_usd(stage, device=device))
    assert seen[16, 8].tolist() == [255, 0, 0]
    assert seen[16, 24].tolist() == [0, 0, 255]
    mesh.CreateDisplayColorPrimvar("vertex").Set([(0, 0, 0), (0, 0, 0), (1, 1, 1), (1, 1, 1), (0, 0, 0), (0, 0, 0)])
    seen = albedo(wc.from_usd(stage, device=device))
    assert seen[16, 8].tolist() == [0, 0, 0]
    ramp = 255 * (np.arange(16) + 0.5) / 16
    assert np.abs(seen[16, 16:, 0] - ramp).max() < 6


def test_opacity_of_nothing_is_left_out(stage: Usd.Stage, device: wp.Device) -> None:
    square = add_square(stage, "/it")
    square.CreateDisplayOpacityAttr([0.0])
    assert not np.isfinite(image(wc.from_usd(stage, device=device))).any()
    square.CreateDisplayOpacityAttr([0.4])
    assert np.isfinite(image(wc.from_usd(stage, device=device))).any()


def test_materials_keep_what_the_kernels_lack(stage: Usd.Stage, device: wp.Device) -> None:
    add_material(stage, "/Looks/m", diffuseColor=(0.5, 0.5, 0.5), roughness=0.25, metallic=1.0, opacity=0.8)
    bind(add_square(stage, "/it"), stage, "/Looks/m")
    (look,) = wc.from_usd(stage, device=device)._graph_source.graph.looks
    assert (look.roughness, look.metallic, look.opacity) == (0.25, 1.0, pytest.approx(0.8))


def test_what_emits_shines_by_itself(stage: Usd.Stage, device: wp.Device) -> None:
    add_material(stage, "/Looks/m", diffuseColor=(0.0, 0.0, 0.0), emissiveColor=(1.0, 0.5, 0.0))
    bind(add_square(stage, "/it"), stage, "/Looks/m")
    light = UsdLux.DistantLight.Define(stage, "/sun")
    light.CreateIntensityAttr(0.0)
    seen = image(wc.from_usd(stage, device=device), "rgb", above(3.0, 8, 2.0, "rgb"))
    assert seen[4, 4].tolist() == [255, 188, 0]


def test_what_emits_is_lit_as_well_as_what_it_reflects(stage: Usd.Stage, device: wp.Device) -> None:
    add_material(stage, "/Looks/m", diffuseColor=(0.1, 0.1, 0.1), emissiveColor=(0.05, 0.05, 0.05), ior=1.0)
    bind(add_square(stage, "/it", half=0.01), stage, "/Looks/m")
    light = UsdLux.DistantLight.Define(stage, "/sun")
    light.CreateIntensityAttr(0.5 * np.pi)
    light.CreateNormalizeAttr(True)
    seen = image(wc.from_usd(stage, device=device, exposure=0.0), "hdr", above(3.0, 3, 0.01, "hdr"))[1, 1]
    np.testing.assert_allclose(seen, 0.5 * 0.1 + 0.05, rtol=1e-4)


def test_images_by_the_world(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    save_image(tmp_path / "tex.png")
    textured_square(stage, "./tex.png")
    pool = {"blue": np.full((4, 4, 3), (0, 0, 255), np.uint8), "quarters": save_image(tmp_path / "again.png")}
    scene = wc.from_usd(stage, num_worlds=3, device=device, textures=pool)
    assert scene.textures == ("./tex.png", "blue", "quarters")
    assert scene.materials == ("/Looks/m",)
    scene.set_textures(["/Looks/m"], np.array([[0], [1], [-1]]))
    assert corners(albedo(scene)) == PLAIN
    assert corners(albedo(scene, world=1)) == [[0, 0, 255]] * 4
    assert corners(albedo(scene, world=2)) == [[255] * 3] * 4
    for place in (3, -2):
        with pytest.raises(wc.WarpcamError, match=f"set_textures: textures has {place}; allowed are -1 for none and 0"):
            scene.set_textures(["/Looks/m"], [[place]])
    if device.is_cuda:  # where nobody waits to look at them
        scene.set_textures(["/Looks/m"], wp.array([[3]], dtype=wp.int32, device=device))
        assert corners(albedo(scene)) == [[255] * 3] * 4


# Lights. With an exposure of 0 a white surface shows what arrives, divided by pi.


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


def omni_look(stage: Usd.Stage, device: wp.Device, **inputs: Any) -> tuple[wc.Scene, Any]:
    """A square with OmniPBR on it, and its look."""
    textured_square(stage, "")
    stage.RemovePrim("/Looks/m/omni")
    shader = UsdShade.Shader.Define(stage, "/Looks/m/omni")
    shader.SetSourceAsset("OmniPBR.mdl", "mdl")
    shader.SetSourceAssetSubIdentifier("OmniPBR", "mdl")
    types = Sdf.ValueTypeNames
    for name, value in inputs.items():
        kinds = {str: types.Asset, bool: types.Bool, float: types.Float}
        kind = kinds.get(type(value)) or (types.Color3f if len(value) == 3 else types.Float2)
        shader.CreateInput(name, kind).Set(value)
    material = UsdShade.Material.Get(stage, "/Looks/m")
    material.GetSurfaceOutput().ClearSources()
    material.CreateSurfaceOutput("mdl").ConnectToSource(shader.ConnectableAPI(), "out")
    scene = wc.from_usd(stage, device=device)
    return scene, scene._graph_source.graph.looks[0]


def test_omnipbr_packs_occlusion_roughness_and_metalness(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """As far as the influences let them; 0 unless they are given."""
    file = str(save_image(tmp_path / "orm.png", np.array([[[51, 102, 255]]], np.uint8)))
    inputs: dict[str, Any] = {"ORM_texture": file, "enable_ORM_texture": True, "reflection_roughness_constant": 0.9}
    scene, look = omni_look(stage, device, **inputs)
    assert (look.packed, look.roughness, look.metallic) == (-1, pytest.approx(0.9), 0.0)
    shares = {"reflection_roughness_texture_influence": 0.5, "metallic_texture_influence": 1.0, "ao_to_diffuse": 0.25}
    scene, look = omni_look(stage, device, **inputs, **shares)
    pixel = scene._parts.textures[look.packed].pixels[0, 0] / 255.0
    assert (look.roughness, look.metallic) == (1.0, 1.0)
    np.testing.assert_allclose(pixel, (0.75 + 0.25 * 0.2, 0.5 * 0.9 + 0.5 * 0.4, 1.0), atol=0.003)


def test_omnipbr_tints_brightens_and_tiles(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    file = str(save_image(tmp_path / "tex.png"))
    tile = {"texture_scale": (2.0, 1.0), "texture_translate": (0.5, 0.5)}
    scene, _ = omni_look(stage, device, diffuse_texture=file, diffuse_tint=(1.0, 0.0, 1.0), **tile)
    columns = [albedo(scene)[8, column].tolist() for column in (4, 12, 20, 28)]  # of the lower half, moved up
    assert columns == [[200, 0, 50], [0, 0, 255]] * 2
    scene, look = omni_look(stage, device, diffuse_color_constant=(0.5, 0.5, 0.5), diffuse_tint=(1.0, 0.0, 0.5))
    assert look.color == pytest.approx((0.5, 0.0, 0.25))
    scene, _ = omni_look(stage, device, diffuse_texture=file, albedo_brightness=0.5, albedo_add=0.1)
    assert albedo(scene)[8, 8].tolist() == pytest.approx([203, 89, 89], abs=1)  # 0.6 and 0.1, encoded


def test_what_omnipbr_has_that_is_not_drawn(
    stage: Usd.Stage, tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device
) -> None:
    file = str(save_image(tmp_path / "tex.png"))
    others = {"project_uvw": True, "texture_rotate": 30.0, "albedo_desaturation": 0.5, "emissive_mask_texture": file}
    omni_look(stage, device, diffuse_texture=file, **others)
    for name in others:
        assert f"has {name}, which is not drawn: /Looks/m" in caplog.text
