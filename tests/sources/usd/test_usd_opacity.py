"""Opacity of USD and glTF: numbers, maps, cut-outs. A square of four quarters hovers over a floor."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp
from PIL import Image

import warpcam as wc

pytest.importorskip("pxr.Usd")
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from usd_stages import above, add_material, add_mesh, add_square

OUTPUTS = ("depth", "segmentation", "hdr", "rgba", "albedo", "normals", "points", "distance")
ALPHA = np.array([[0, 255], [102, 204]], np.uint8)  # of the quarters, from the top


def picture(path: Path, alpha: np.ndarray = ALPHA) -> Path:
    pixels = np.full((*alpha.shape, 4), (200, 100, 50, 0), np.uint8)
    pixels[..., 3] = alpha
    Image.fromarray(pixels.repeat(16, axis=0).repeat(16, axis=1)).save(path)
    return path


def hover(stage: Usd.Stage, path: str, material: str, height: float = 1.0, half: float = 1.0) -> Any:
    square = add_square(stage, path, z=height, half=half)
    st = UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    UsdShade.MaterialBindingAPI.Apply(square.GetPrim()).Bind(UsdShade.Material.Get(stage, material))
    return square


def mapped(stage: Usd.Stage, file: Path, path: str = "/Looks/m", channel: str = "a", **inputs: Any) -> Any:
    """A material whose opacity is a channel of an image."""
    surface = add_material(stage, path, diffuseColor=(0.6, 0.3, 0.1), **inputs)
    texture = UsdShade.Shader.Define(stage, f"{path}/tex")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(str(file))
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), channel)
    return surface


def floor(stage: Usd.Stage) -> None:
    add_square(stage, "/floor", half=2.0).CreateDisplayColorAttr([(0.1, 0.4, 0.7)])


def look(scene: wc.Scene, world: int = 0, **more: Any) -> dict[str, np.ndarray]:
    (images,) = wc.Renderer(scene, [above(3.0, 32, 2.0, *OUTPUTS, **more)]).render().values()
    return {name: value[world].cpu().numpy().squeeze().copy() for name, value in images.items()}


def of(name: str, stage: Usd.Stage, device: wp.Device, opacity: float) -> dict[str, np.ndarray]:
    """Build the stage with one opacity for all of a material."""
    given = UsdShade.Shader.Get(stage, f"{name}/surface").GetInput("opacity")
    sources = given.GetConnectedSources()[0]
    given.DisconnectSource()
    given.Set(opacity)
    images = look(wc.from_usd(stage, device=device))
    for source in sources:
        given.ConnectToSource(source)
    return images


QUARTERS = [(slice(1, 15), slice(1, 15)), (slice(1, 15), slice(17, 31)),
            (slice(17, 31), slice(1, 15)), (slice(17, 31), slice(17, 31))]  # fmt: skip


@pytest.mark.parametrize(("cutoff", "there"), [(0.3, (0, 1, 1, 1)), (0.5, (0, 1, 0, 1)), (0.9, (0, 1, 0, 0))])
def test_what_is_cut_out_is_not_there(
    stage: Usd.Stage, tmp_path: Path, cutoff: float, there: tuple, device: wp.Device
) -> None:
    floor(stage)
    mapped(stage, picture(tmp_path / "tex.png"), opacityThreshold=cutoff)
    hover(stage, "/it", "/Looks/m")
    seen, solid, nothing = (
        look(wc.from_usd(stage, device=device)), of("/Looks/m", stage, device, 1.0), of("/Looks/m", stage, device, 0.0),
    )  # fmt: skip
    assert set(np.unique(solid["depth"])) == {2.0}
    assert set(np.unique(nothing["depth"])) == {3.0}
    for name in OUTPUTS:
        for quarter, whole in zip(QUARTERS, there, strict=True):
            np.testing.assert_allclose(seen[name][quarter], (solid if whole else nothing)[name][quarter], atol=1e-6)


def test_a_map_of_opacity_is_seen_through_and_what_has_none_is_not_there(
    stage: Usd.Stage, tmp_path: Path, device: wp.Device
) -> None:
    floor(stage)
    mapped(stage, picture(tmp_path / "tex.png"))
    hover(stage, "/it", "/Looks/m")
    seen, solid, nothing = (
        look(wc.from_usd(stage, device=device)), of("/Looks/m", stage, device, 1.0), of("/Looks/m", stage, device, 0.0),
    )  # fmt: skip
    for quarter, alpha in zip(QUARTERS, ALPHA.reshape(-1) / 255.0, strict=True):
        mixed = alpha * solid["hdr"][quarter] + (1.0 - alpha) * nothing["hdr"][quarter]
        np.testing.assert_allclose(seen["hdr"][quarter], mixed, atol=1e-5)
        expected = solid if alpha > 0.0 else nothing
        for name in ("depth", "segmentation", "normals", "albedo", "points", "distance"):
            np.testing.assert_allclose(seen[name][quarter], expected[name][quarter], atol=1e-6)
    drawn_solid = look(wc.from_usd(stage, device=device, transparency=False))
    for quarter, alpha in zip(QUARTERS, ALPHA.reshape(-1), strict=True):
        np.testing.assert_allclose(
            drawn_solid["hdr"][quarter], (solid if alpha else nothing)["hdr"][quarter], atol=1e-6
        )


def test_masks_lie_on_stretched_meshes_in_perspective(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    """A mesh of many faces, turned and stretched: each pixel against the image where its ray meets the plane."""
    random = np.random.default_rng(3)
    alpha = (random.random((8, 8)) < 0.5).astype(np.uint8) * 255
    mapped(stage, picture(tmp_path / "tex.png", alpha), opacityThreshold=0.5)
    line = np.linspace(-1.0, 1.0, 6)
    grid = np.array([(x, y, 0.0) for x in line for y in line])
    faces = [(6 * i + j, 6 * i + j + 6, 6 * i + j + 7, 6 * i + j + 1) for i in range(5) for j in range(5)]
    mesh = add_mesh(stage, "/it", grid, faces)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(float(0.5 * x + 0.5), float(0.5 * y + 0.5)) for x, y, _ in grid])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/m"))
    matrix = Gf.Matrix4d().SetScale(Gf.Vec3d(1.5, 0.7, 1.0)) * Gf.Matrix4d().SetRotate(Gf.Rotation((1, 2, 3), 35.0))
    UsdGeom.Xformable(mesh).AddTransformOp().Set(matrix)
    eye = wc.Camera(
        "eye", width=64, height=48, lens=wc.Pinhole(fovy=40.0), position=(0.2, 0.1, 4.0), outputs=("depth",)
    )
    (images,) = wc.Renderer(wc.from_usd(stage, device=device), [eye]).render().values()
    frame = np.array(matrix)[:3, :3].T
    rays = scenes.pixel_rays(64, 48, 40.0).reshape(48, 64, 3) @ np.linalg.inv(frame).T
    start = np.linalg.inv(frame) @ (0.2, 0.1, 4.0)
    place = start + (-start[2] / rays[..., 2:]) * rays
    inside = (np.abs(place[..., :2]) < 1.0).all(axis=-1)
    cell = np.clip(4.0 * place[..., :2] + 4.0, 0, 7.999)
    wanted = inside & (alpha[7 - cell[..., 1].astype(int), cell[..., 0].astype(int)] > 0)
    sure = (np.abs(cell - np.rint(cell)) > 0.1).all(axis=-1)  # not where one texel passes into another
    seen = np.isfinite(images["depth"][0, ..., 0].cpu().numpy())
    assert 300 < (wanted & sure).sum() < (inside & sure).sum() - 300
    np.testing.assert_array_equal(seen[sure], wanted[sure])


@pytest.mark.parametrize("threshold", [0.0, 0.5])
def test_shadows_have_the_holes_of_the_map(
    stage: Usd.Stage, tmp_path: Path, threshold: float, device: wp.Device
) -> None:
    floor(stage)
    alpha = np.array([[0, 255], [255, 0]], np.uint8)
    mapped(stage, picture(tmp_path / "tex.png", alpha), opacityThreshold=threshold)
    hover(stage, "/it", "/Looks/m", height=1.5, half=0.5).CreateDoubleSidedAttr(True)
    sun = UsdLux.DistantLight.Define(stage, "/sun")
    sun.CreateIntensityAttr(1.0)
    move = UsdGeom.Xformable(sun).AddRotateXYZOp()
    move.Set((0, 45, 0))  # shines along -x and down: the shadow lies 1.5 m further along -x
    scene = wc.from_usd(stage, device=device)
    eye = wc.Camera(
        "eye", width=32, height=32, lens=wc.Orthographic(height=1.0), position=(-1.5, 0.0, 1.0), shadows=True,
        outputs=("hdr",),
    )  # fmt: skip
    (images,) = wc.Renderer(scene, [eye]).render().values()
    dark = images["hdr"][0].cpu().numpy().max(axis=-1) == 0.0
    for quarter, value in zip(QUARTERS, alpha.reshape(-1), strict=True):
        assert (dark[quarter] == (value > 0)).all()


def test_instances_of_one_mesh_are_cut_by_their_own_materials(
    stage: Usd.Stage, tmp_path: Path, device: wp.Device
) -> None:
    add_material(stage, "/Looks/whole", diffuseColor=(0.5, 0.5, 0.5))
    square = hover(stage, "/thing/square", "/Looks/whole", height=0.0)
    square.GetPrim().GetRelationship("material:binding").SetTargets([])
    square.GetPrim().RemoveProperty("material:binding")
    for place, (name, alpha) in enumerate((("one", (0, 255)), ("other", (255, 0)), ("whole", None))):
        if alpha:
            file = picture(tmp_path / f"{name}.png", np.array([alpha], np.uint8))
            mapped(stage, file, f"/Looks/{name}", opacityThreshold=0.5)
        copy = UsdGeom.Xform.Define(stage, f"/{name}")
        copy.GetPrim().GetReferences().AddInternalReference("/thing")
        copy.GetPrim().SetInstanceable(True)
        copy.AddTranslateOp().Set((0, 0, 0.5 * (place + 1)))
        UsdShade.MaterialBindingAPI.Apply(copy.GetPrim()).Bind(UsdShade.Material.Get(stage, f"/Looks/{name}"))
    scene = wc.from_usd(stage, device=device)
    assert (look(scene)["depth"] == 1.5).all()
    scene.set_visible(["/whole"], np.zeros((1, 1), bool))
    depth = look(scene)["depth"]
    assert (depth[1:31, 1:15] == 2.0).all()
    assert (depth[1:31, 17:31] == 2.5).all()


@pytest.mark.parametrize(("opacity", "cutoff", "shown"), [(0.8, 0.5, 1.0), (0.3, 0.5, 0.0), (0.3, 0.0, 0.3)])
def test_one_opacity_for_all(stage: Usd.Stage, opacity: float, cutoff: float, shown: float, device: wp.Device) -> None:
    floor(stage)
    add_material(stage, "/Looks/m", diffuseColor=(0.6, 0.3, 0.1), opacity=1.0)
    hover(stage, "/it", "/Looks/m")
    solid = look(wc.from_usd(stage, device=device))
    surface = UsdShade.Shader.Get(stage, "/Looks/m/surface")
    surface.GetInput("opacity").Set(0.0)
    nothing = look(wc.from_usd(stage, device=device))
    surface.GetInput("opacity").Set(opacity)
    surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(cutoff)
    seen = look(wc.from_usd(stage, device=device))
    np.testing.assert_allclose(seen["hdr"], shown * solid["hdr"] + (1.0 - shown) * nothing["hdr"], atol=1e-5)
    np.testing.assert_array_equal(seen["depth"], (solid if shown > 0.0 else nothing)["depth"])


def test_display_opacity_counts_without_a_material_or_where_one_asks_for_it(
    stage: Usd.Stage, device: wp.Device
) -> None:
    floor(stage)
    square = add_square(stage, "/it", z=1.0)
    square.CreateDisplayColorAttr([(0.6, 0.3, 0.1)])
    images = {}
    for opacity in (0.0, 0.25, 1.0):
        square.CreateDisplayOpacityAttr([opacity])
        images[opacity] = look(wc.from_usd(stage, device=device))["hdr"]
    np.testing.assert_allclose(images[0.25], 0.25 * images[1.0] + 0.75 * images[0.0], atol=1e-5)
    surface = add_material(stage, "/Looks/m", diffuseColor=(0.6, 0.3, 0.1))
    UsdShade.MaterialBindingAPI.Apply(square.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/m"))

    def opacities() -> list[float]:
        square.CreateDisplayOpacityAttr([0.25])
        scene = wc.from_usd(stage, device=device)
        return [float(scene.array("shape_colors").numpy()[0, k, 3]) for k in (scene.shapes.index("/it"),)]

    assert opacities() == [1.0]
    reader = UsdShade.Shader.Define(stage, "/Looks/m/reader")
    reader.CreateIdAttr("UsdPrimvarReader_float")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayOpacity")
    opacity = surface.CreateInput("opacity", Sdf.ValueTypeNames.Float)
    opacity.ConnectToSource(reader.ConnectableAPI(), "result")
    assert opacities() == [0.25]
    surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(0.2)
    assert opacities() == [1.0]


def test_opacity_by_the_world(stage: Usd.Stage, device: wp.Device) -> None:
    floor(stage)
    add_square(stage, "/it", z=1.0).CreateDisplayColorAttr([(0.6, 0.3, 0.1)])
    scene = wc.from_usd(stage, num_worlds=3, device=device, transparency=True)
    renderer = wc.Renderer(scene, [above(3.0, 32, 2.0, "hdr", "depth")])
    colors = np.array((0.8, 0.6, 0.3, 1.0), np.float32) * np.ones((3, 1, 1), np.float32)
    colors[:, 0, 3] = 1.0, 0.4, 0.0
    scene.set_colors(["/it"], colors)
    (images,) = renderer.render().values()
    solid, pane, nothing = images["hdr"].cpu().numpy()
    np.testing.assert_allclose(pane, 0.4 * solid + 0.6 * nothing, atol=1e-5)
    assert [float(depth[16, 16]) for depth in images["depth"].cpu()] == [2.0, 2.0, 3.0]


def test_a_missing_map_is_named_and_the_surface_is_solid(
    stage: Usd.Stage, tmp_path: Path, caplog: pytest.LogCaptureFixture, device: wp.Device
) -> None:
    mapped(stage, tmp_path / "gone.png", channel="r")
    hover(stage, "/it", "/Looks/m")
    assert (look(wc.from_usd(stage, device=device))["depth"] == 2.0).all()
    assert "gone.png of /Looks/m" in caplog.text


def test_an_image_without_alpha_is_solid(stage: Usd.Stage, tmp_path: Path, device: wp.Device) -> None:
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(tmp_path / "tex.png")
    mapped(stage, tmp_path / "tex.png")
    hover(stage, "/it", "/Looks/m")
    assert (look(wc.from_usd(stage, device=device))["depth"] == 2.0).all()


@pytest.mark.parametrize("on", [True, False])
def test_omnipbr_says_whether_its_opacity_counts(stage: Usd.Stage, on: bool, device: wp.Device) -> None:
    material = UsdShade.Material.Define(stage, "/Looks/m")
    shader = UsdShade.Shader.Define(stage, "/Looks/m/surface")
    shader.SetSourceAsset("OmniPBR.mdl", "mdl")
    shader.SetSourceAssetSubIdentifier("OmniPBR", "mdl")
    shader.CreateInput("opacity_constant", Sdf.ValueTypeNames.Float).Set(0.5)
    shader.CreateInput("enable_opacity", Sdf.ValueTypeNames.Bool).Set(on)
    material.CreateSurfaceOutput("mdl").ConnectToSource(shader.ConnectableAPI(), "out")
    hover(stage, "/it", "/Looks/m")
    scene = wc.from_usd(stage, device=device)
    assert scene.array("shape_colors").numpy()[0, 0, 3] == (0.5 if on else 1.0)


@pytest.mark.parametrize(
    ("mode", "there"), [("OPAQUE", (1, 1, 1, 1)), ("MASK", (0, 1, 0, 1)), ("BLEND", (0, 1, 0.4, 0.8))]
)
def test_gltf(mode: str, there: tuple, tmp_path: Path, device: wp.Device) -> None:
    trimesh = pytest.importorskip("trimesh")
    corners = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)), float)
    with Image.open(picture(tmp_path / "tex.png")) as file:
        image = file.copy()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, alphaMode=mode, alphaCutoff=0.5)
    uvs = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), float)
    visual = trimesh.visual.TextureVisuals(uv=uvs, material=material)
    mesh = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], visual=visual, process=False)
    mesh.export(tmp_path / "scene.glb")
    seen = look(wc.load(tmp_path / "scene.glb", device=device, up_axis=None))
    for quarter, alpha in zip(QUARTERS, there, strict=True):
        assert (np.isfinite(seen["depth"][quarter]) == (alpha > 0)).all()
        assert (seen["rgba"][quarter][..., 3] == round(255 * alpha)).all()
    solid = look(wc.load(tmp_path / "scene.glb", device=device, up_axis=None, transparency=False))
    assert (solid["rgba"][..., 3] == 255 * np.isfinite(solid["depth"])).all()
