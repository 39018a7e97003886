"""Rays that each begin at a place of their own: how things look to them.

Against lenses that have formulas, and cameras of one pixel.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from custom_ray_tables import WIDTH
from offset_ray_lenses import COLUMN, SPAN, assert_alike, parallel, pinholes
from PIL import Image
from ray_table_scenes import ASSETS, SCENE, WORLDS, camera, rendered

import warpcam as wc

SETTINGS = {
    "outputs": ("depth", "distance", "segmentation", "rgb", "normals", "points", "albedo", "bodies"),
    "shadows": True,
    "position": (0.2, -0.3, 2.0),
    "rotation": (0.97, 0.2, 0.05, 0.1),
}


@pytest.fixture(scope="module")
def model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = scenes.compile_xml(SCENE, assets=ASSETS, more='<visual><headlight active="0"/></visual>')
    return mjm, scenes.forward(mjm)


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_parallel_rays_give_the_orthographic_images(antialiasing: int, device: wp.Device) -> None:
    """But for highlights, which MuJoCo's parallel rays see as from the camera's position."""
    mjm = scenes.compile_xml(
        SCENE.replace("<light ", '<light specular="0 0 0" '),
        assets=ASSETS,
        more='<visual><headlight active="0"/></visual>',
    )
    settings = SETTINGS | {"antialiasing": antialiasing}
    expected, seen = rendered(
        wc.from_mujoco(mjm, scenes.forward(mjm), device=device),
        camera(wc.Orthographic(height=SPAN), "flat", **settings),
        camera(parallel(), "table", **settings),
    )
    assert_alike(seen, expected)


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_a_pinholes_rays_may_begin_anywhere_on_them(
    model: tuple[Any, Any], antialiasing: int, device: wp.Device
) -> None:
    settings = SETTINGS | {"antialiasing": antialiasing}
    expected, seen = rendered(
        wc.from_mujoco(*model, device=device),
        camera(wc.Pinhole(fovy=70.0), "pinhole", **settings),
        camera(pinholes(0.1, 0.3), "table", **settings),
    )
    ahead = (0.1 + 0.3 * COLUMN / WIDTH)[..., None]
    seen["distance"] += ahead
    assert_alike(seen, expected)


@pytest.mark.parametrize("name", WORLDS)
def test_scenes_of_all_kinds(name: str, device: wp.Device) -> None:
    """Haze, what is transparent, hills, many shapes: as the pinhole that stands where the rays begin."""
    assets, world, more = WORLDS[name]
    mjm = scenes.compile_xml(world, assets=assets, more=more)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    rotation = np.array((0.8, 0.5, 0.1, 0.2) if name == "haze" else (0.95, 0.2, 0.1, 0.0))
    settings = {"outputs": ("depth", "segmentation", "rgb"), "shadows": True, "rotation": rotation}
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, rotation / np.linalg.norm(rotation))
    rays, aside = pinholes(0.0, 0.0).directions, np.array((0.3, -0.2, 0.25))
    place = np.array((0.2, -0.3, 2.0))
    expected, seen = rendered(
        scene,
        camera(wc.Pinhole(fovy=70.0), "pinhole", position=place, **settings),
        camera(
            wc.Rays(rays, origins=np.broadcast_to(aside, rays.shape)),
            "table",
            position=place - turn.reshape(3, 3) @ aside,
            **settings,
        ),
    )
    seen["depth"] += aside[2]
    assert_alike(seen, expected, 0.99)
    assert expected["rgb"].std() > 5.0


SMALL = (12, 9)  # pixels


def small_lens(seed: int) -> wc.Rays:
    """About ahead, from places about the camera."""
    random = np.random.default_rng(seed)
    column, row = np.meshgrid(np.linspace(-0.8, 0.8, SMALL[0]), np.linspace(-0.6, 0.6, SMALL[1]))
    rays = np.stack([column, row, -np.ones_like(row)], -1) + 0.1 * random.normal(size=(*SMALL[::-1], 3))
    return wc.Rays(rays, origins=random.uniform(-0.3, 0.3, rays.shape))


def from_each_place(scene: wc.Scene, lens: wc.Rays, **settings: Any) -> dict[str, np.ndarray]:
    """The images of cameras of one pixel, each in a world of its own, that stand where the rays begin."""
    count = scene.num_worlds
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, settings["rotation"] / np.linalg.norm(settings["rotation"]))
    starts = np.asarray(lens.origins).reshape(count, 3)
    settings["position"] = np.asarray(settings["position"]) + starts @ turn.reshape(3, 3).T
    rays = np.asarray(lens.directions).reshape(count, 1, 1, 3)
    pixel = camera(wc.Rays(rays), "pixel", width=1, height=1, **settings)
    images = wc.Renderer(scene, [pixel]).render()["pixel"]
    found = {name: image.cpu().numpy().reshape(*SMALL[::-1], -1) for name, image in images.items()}
    if "depth" in found:
        found["depth"] = found["depth"] - np.asarray(lens.origins)[..., 2:]
    return found


def assert_as_from_each_place(scene: wc.Scene, **settings: Any) -> dict[str, np.ndarray]:
    """Compare with a scene that has a world for each pixel."""
    lens = small_lens(7)
    settings = {"width": SMALL[0], "height": SMALL[1]} | settings
    seen = rendered(scene, camera(lens, **settings))[0]
    del settings["width"], settings["height"]
    expected = from_each_place(scene, lens, **settings)
    if scene.tables().ids_by_world:
        seen["segmentation"], expected["segmentation"] = (-1 * (one["segmentation"] == -1) for one in (seen, expected))
    ids = expected["segmentation"]
    assert (seen["segmentation"] == ids).mean() > 0.98 and len(np.unique(ids)) > 1
    same = (seen["segmentation"] == ids)[..., 0]
    for name, image in expected.items():
        if name in ("rgba", "hdr", "albedo"):  # half a level of 255, and more where an image of the sky is filtered
            off = np.abs(seen[name][same].astype(float) - image[same])
            assert np.percentile(off, 99) <= (5e-3 if name == "hdr" else 1.0), name
        else:
            np.testing.assert_allclose(seen[name][same], image[same], rtol=1e-3, atol=1e-4, err_msg=name)
    return expected


ALL = ("rgba", "hdr", "depth", "distance", "normals", "points", "segmentation", "bodies", "albedo")
SHINY = '<material name="shiny" specular="1" shininess=".2" rgba=".3 .5 .8 1"/>'
SHOWN = {
    "shiny": (
        SHINY + ASSETS,
        SCENE.replace('material="boards"', 'material="shiny"').replace('size=".3"', 'size=".3" material="shiny"')
        + '<light pos="0 0 2" cutoff="40" exponent="3" attenuation=".5 .2 .1"/>',
        "",
    ),
    "haze": WORLDS["haze"],
    "glass": (
        SHINY,
        '<light pos="1 1 3"/><geom size=".6" material="shiny" pos="0 0 -1"/>'
        '<geom type="box" size=".3 .3 .1" rgba="1 .8 0 .4"/><geom type="plane" size="4 4 1" pos="0 0 -2"/>',
        "",
    ),
    "hills": WORLDS["hills"],
    "many": WORLDS["many"],
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_pixel_is_a_camera_where_its_ray_begins(name: str, device: wp.Device) -> None:
    assets, world, more = SHOWN[name]
    mjm = scenes.compile_xml(world, assets=assets, more=more)
    mjd = scenes.forward(mjm)
    scene = wc.from_mujoco(mjm, [mjd] * (SMALL[0] * SMALL[1]), device=device)
    rotation = (0.8, 0.5, 0.1, 0.2) if name == "haze" else (0.95, 0.2, 0.1, 0.0)
    found = assert_as_from_each_place(
        scene, outputs=ALL, shadows=True, position=(0.2, -0.3, 2.0), rotation=np.array(rotation)
    )
    assert found["rgba"].std() > 5.0


def test_physically_lit_surfaces(device: wp.Device) -> None:
    """Their highlights and what metals mirror of the sky are seen from where the rays begin."""
    pytest.importorskip("pxr.Usd", reason="pip install 'warpcam[usd]'")
    from pbr_scenes import add_ball, add_sun
    from pxr import Gf, Usd, UsdGeom, UsdLux

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    add_ball(stage, roughness=0.25, metallic=1.0, diffuseColor=(0.9, 0.5, 0.3))
    add_sun(stage, (0.3, 0.5, 1.0))
    floor = UsdGeom.Cube.Define(stage, "/floor")
    UsdGeom.XformCommonAPI(floor).SetTranslate(Gf.Vec3d(0.0, -3.0, -4.0))
    UsdGeom.XformCommonAPI(floor).SetScale(Gf.Vec3f(4.0, 1.0, 4.0))
    lamp = UsdLux.SphereLight.Define(stage, "/lamp")
    lamp.CreateIntensityAttr(300.0)
    lamp.CreateRadiusAttr(0.2)
    UsdGeom.XformCommonAPI(lamp).SetTranslate(Gf.Vec3d(1.0, 1.5, -2.0))
    scene = wc.from_usd(stage, num_worlds=SMALL[0] * SMALL[1], device=device, exposure=0.0)
    found = assert_as_from_each_place(
        scene, outputs=ALL, shadows=True, position=(0.0, 0.0, 0.0), rotation=np.array((1.0, 0.02, 0.03, 0.0))
    )
    assert found["hdr"].max() > 0.2


def test_gaussians(device: wp.Device) -> None:
    newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
    import newton_scenes
    import splat_scenes

    builder = newton.ModelBuilder()
    world = newton.ModelBuilder()
    world.add_shape_gaussian(body=-1, gaussian=splat_scenes.random_gaussians(200, 0))
    builder.replicate(world, SMALL[0] * SMALL[1])
    scene = wc.from_newton(*newton_scenes.finalize(builder, device))
    found = assert_as_from_each_place(
        scene,
        outputs=("rgba", "hdr", "depth", "distance", "points", "segmentation"),
        position=(0.0, -2.0, 0.0),
        rotation=scenes.looking((0.0, -2.0, 0.0), (0.0, 0.0, 0.0)),
    )
    assert found["rgba"].std() > 5.0


def test_cloth_that_is_seen_from_both_sides(device: wp.Device) -> None:
    """The side that a ray sees decides which light falls on it."""
    newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
    import newton_scenes

    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.cloth(), SMALL[0] * SMALL[1])
    scene = wc.from_newton(*newton_scenes.finalize(builder, device))
    low, high = (np.asarray(corner.cpu() if hasattr(corner, "cpu") else corner, float) for corner in scene.bounds())
    middle = 0.5 * (low + high).reshape(-1, 3)[0]
    for side in (-1.0, 1.0):
        place = middle + np.array((0.1, -0.3, 1.5 * side))
        assert_as_from_each_place(
            scene,
            outputs=("rgba", "depth", "distance", "normals", "points", "segmentation", "hdr"),
            shadows=True,
            position=tuple(place),
            rotation=scenes.looking(tuple(place), tuple(middle)),
        )


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_textures_are_filtered_as_wide_as_rays_begin_apart(turn: float, device: wp.Device) -> None:
    """Parallel rays have no other width."""
    assets = (
        '<texture name="stripes" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>'
        '<material name="stripes" texture="stripes" texrepeat="150 .1"/>'
    )
    mjm = scenes.compile_xml(f'<geom type="plane" size="9 9 1" material="stripes" euler="0 0 {turn}"/>', assets=assets)
    settings = {"outputs": ("albedo",), "position": (0.0, 0.0, 2.0), "rotation": (0.99, 0.05, 0.08, 0.0)}
    expected, seen = (
        one["albedo"].astype(int)
        for one in rendered(
            wc.from_mujoco(mjm, scenes.forward(mjm), device=device),
            camera(wc.Orthographic(height=SPAN), "flat", **settings),
            camera(parallel(), "table", **settings),
        )
    )
    assert expected.std() < 40.0 and np.abs(seen - expected).max() <= 2


def test_maps_of_opacity(tmp_path: Path, device: wp.Device) -> None:
    """Images are those of a pinhole at the rays' origin: a square of four quarters hovers over a floor."""
    pytest.importorskip("pxr.Usd", reason="pip install 'warpcam[usd]'")
    from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade
    from usd_stages import add_material, add_square

    pixels = np.full((2, 2, 4), (200, 100, 50, 0), np.uint8)
    pixels[..., 3] = [[0, 255], [102, 204]]
    Image.fromarray(pixels.repeat(16, axis=0).repeat(16, axis=1)).save(tmp_path / "quarters.png")
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    surface = add_material(stage, "/Looks/m", diffuseColor=(0.6, 0.3, 0.1))
    texture = UsdShade.Shader.Define(stage, "/Looks/m/quarters")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(str(tmp_path / "quarters.png"))
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), "a")
    square = add_square(stage, "/square", z=1.0, half=1.0)
    st = UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    UsdShade.MaterialBindingAPI.Apply(square.GetPrim()).Bind(UsdShade.Material.Get(stage, "/Looks/m"))
    UsdLux.DomeLight.Define(stage, "/sky")
    add_square(stage, "/floor", half=3.0).CreateDisplayColorAttr([(0.1, 0.4, 0.7)])
    rays, aside = pinholes(0.0, 0.0).directions, np.array((0.5, 0.3, 0.2))
    settings = {"outputs": ("rgb", "segmentation"), "rotation": (1.0, 0.0, 0.0, 0.0)}
    place = np.array((0.1, 0.0, 3.0))
    expected, seen = rendered(
        wc.from_usd(stage, device=device),
        camera(wc.Pinhole(fovy=70.0), "pinhole", position=place, **settings),
        camera(wc.Rays(rays, origins=np.broadcast_to(aside, rays.shape)), "table", position=place - aside, **settings),
    )
    assert_alike(seen, expected)
    assert len(np.unique(expected["rgb"].reshape(-1, 3), axis=0)) >= 4


def test_shadows_on_sheets_that_are_seen_from_both_sides(device: wp.Device) -> None:
    """The side that a ray sees decides whether the light falls on it: a roof over a floor, both of one mesh."""
    pytest.importorskip("pxr.Usd", reason="pip install 'warpcam[usd]'")
    from pbr_scenes import add_sun
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    sheets = UsdGeom.Mesh.Define(stage, "/sheets")
    square = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
    sheets.CreatePointsAttr(np.concatenate([3.0 * square, 1.6 * square + (0.0, 0.0, 1.2)]).astype(np.float32))
    sheets.CreateFaceVertexCountsAttr([4, 4])
    sheets.CreateFaceVertexIndicesAttr([3, 2, 1, 0, 4, 5, 6, 7])  # the floor is seen from behind
    sheets.CreateSubdivisionSchemeAttr("none")
    sheets.CreateDoubleSidedAttr(True)
    add_sun(stage, (0.2, 0.1, 1.0))
    scene = wc.from_usd(stage, num_worlds=SMALL[0] * SMALL[1], device=device, exposure=0.0)
    place = (0.3, -4.0, 1.0)
    settings = {"position": place, "rotation": scenes.looking(place, (0.0, -1.0, 0.0)), "outputs": ALL}
    shaded = assert_as_from_each_place(scene, shadows=True, **settings)["hdr"]
    lit = assert_as_from_each_place(scene, **settings)["hdr"]
    assert 5 < (shaded != lit).any(axis=-1).sum() < 100
