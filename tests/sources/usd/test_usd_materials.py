"""Materials and textures of stages made here."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils
from usd_stages import (
    QUARTERS,
    above,
    add_material,
    add_mesh,
    add_square,
    albedo,
    bind,
    image,
    save_image,
    textured_square,
)


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
        """Return which half of the image is shown, from the left or from below."""
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
    (look,) = wc.from_usd(stage, device=device)._graph_source.graph.materials
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
    (look,) = wc.from_usd(stage, device=device)._graph_source.graph.materials
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
