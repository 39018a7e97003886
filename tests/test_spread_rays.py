"""Rays that each begin at a place of their own.

Against a ray at a time, cameras of one pixel, and lenses that have formulas.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from PIL import Image
from ray_tables import HEIGHT, WIDTH, curled_rays, random_rays
from test_rays import ASSETS, PLACE, SCENE, TURN, WORLDS, camera, rendered

import warpcam as wc
from warpcam.accel import rays as tables

COLUMN, ROW = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
SPAN = 2.7  # metres from bottom to top, of parallel rays
FOCAL = 0.5 * HEIGHT / np.tan(np.radians(35.0))


@pytest.fixture(scope="module")
def model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = scenes.compile_xml(SCENE, assets=ASSETS, more='<visual><headlight active="0"/></visual>')
    return mjm, scenes.forward(mjm)


def parallel() -> wc.Rays:
    """As Orthographic(SPAN)."""
    step = SPAN / HEIGHT
    origins = np.stack([(COLUMN - 0.5 * WIDTH) * step, (0.5 * HEIGHT - ROW) * step, np.zeros_like(ROW)], -1)
    return wc.Rays(np.broadcast_to((0.0, 0.0, -1.0), origins.shape), origins=origins)


def pinholes(ahead: float, more: float) -> wc.Rays:
    """A pinhole's rays that begin farther along them, the more the farther to the right."""
    rays = np.stack([(COLUMN - 0.5 * WIDTH) / FOCAL, (0.5 * HEIGHT - ROW) / FOCAL, np.full_like(ROW, -1.0)], -1)
    return wc.Rays(rays, origins=(ahead + more * COLUMN / WIDTH)[..., None] * tables.unit(rays))


def swaying(seed: int = 5) -> np.ndarray:
    """Places of a camera that moves while it looks, and jumps."""
    random = np.random.default_rng(seed)
    origins = 0.3 * np.stack([np.sin(ROW / 4.0), np.cos(COLUMN / 9.0), np.sin((ROW + COLUMN) / 11.0)], -1)
    origins[:, 20:] += random.uniform(-0.4, 0.4, 3)
    return origins + 0.02 * random.normal(size=origins.shape)


LENSES = {
    "parallel": parallel,
    "pinhole": lambda: pinholes(0.1, 0.3),
    "random": lambda: wc.Rays(random_rays(1), origins=np.random.default_rng(2).uniform(-0.5, 0.5, (HEIGHT, WIDTH, 3))),
    "curled": lambda: wc.Rays(curled_rays(), origins=swaying()),
    "from far away": lambda: wc.Rays(-random_rays(3), origins=6.0 * tables.unit(random_rays(3))),
}


def inside(mjm: mujoco.MjModel, mjd: mujoco.MjData, places: np.ndarray) -> np.ndarray:
    """Which places lie in a geom, where MuJoCo's rays meet its other side and cameras see out."""
    found = np.zeros(len(places), bool)
    for geom in range(mjm.ngeom):
        if mjm.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            local = (places - mjd.geom_xpos[geom]) @ mjd.geom_xmat[geom].reshape(3, 3)
            center, half = mjm.geom_aabb[geom, :3], mjm.geom_aabb[geom, 3:]
            found |= (np.abs(local - center) < half).all(axis=-1)
    return found


@pytest.mark.parametrize("name", LENSES)
def test_each_pixel_is_its_ray(model: tuple[Any, Any], name: str, device: wp.Device) -> None:
    mjm, mjd = model
    lens = LENSES[name]()
    outputs = ("depth", "distance", "segmentation", "points")
    seen = rendered(wc.from_mujoco(mjm, mjd, device=device), camera(lens, outputs=outputs))[0]
    turn, found = np.zeros(9), np.zeros(1, np.int32)
    mujoco.mju_quat2Mat(turn, TURN / np.linalg.norm(TURN))
    matrix = turn.reshape(3, 3)
    rays = tables.unit(lens.rays(WIDTH, HEIGHT, 1, "lens")[0])
    starts = lens.starts(WIDTH, HEIGHT, 1, "lens")[0]
    outwards, places = rays @ matrix.T, np.asarray(PLACE) + starts @ matrix.T
    free = ~inside(mjm, mjd, places.reshape(-1, 3)).reshape(HEIGHT, WIDTH)
    distance, shape = np.full((HEIGHT, WIDTH), np.inf), np.full((HEIGHT, WIDTH), -1)
    for row, column in zip(*free.nonzero(), strict=True):
        along = mujoco.mj_ray(mjm, mjd, places[row, column], outwards[row, column], None, 1, -1, found)
        if along >= 0.0:
            distance[row, column], shape[row, column] = along, found[0]
    assert free.mean() > 0.7 and len(np.unique(shape)) > 4
    assert (free & (seen["segmentation"][..., 0] != shape)).sum() <= 2  # where a ray grazes an edge
    same = free & (seen["segmentation"][..., 0] == shape) & (shape >= 0)
    along = distance[same]
    assert np.abs(seen["distance"][same][:, 0] - along).max() < 3e-5
    planar = -(starts[same][:, 2] + along * rays[same][:, 2])
    assert np.abs(seen["depth"][same][:, 0] - planar).max() < 3e-5
    assert np.abs(seen["points"][same] - (places[same] + along[:, None] * outwards[same])).max() < 3e-5
    missed = seen["segmentation"][..., 0] < 0
    assert np.isinf(seen["distance"][missed]).all() and np.isinf(seen["depth"][missed]).all()


SETTINGS = {
    "outputs": ("depth", "distance", "segmentation", "rgb", "normals", "points", "albedo", "bodies"),
    "shadows": True,
    "position": (0.2, -0.3, 2.0),
    "rotation": (0.97, 0.2, 0.05, 0.1),
}


def assert_alike(seen: dict[str, Any], expected: dict[str, Any], least: float = 0.995) -> None:
    same = (seen["segmentation"] == expected["segmentation"])[..., 0]
    assert same.mean() > least and len(np.unique(expected["segmentation"])) > 1
    for name, most in (("depth", 2e-5), ("distance", 2e-5), ("points", 2e-5), ("normals", 2e-3)):
        if name in seen:
            np.testing.assert_allclose(seen[name][same], expected[name][same], atol=most, rtol=2e-4, err_msg=name)
    for name in ("rgb", "albedo"):
        if name in seen:
            difference = np.abs(seen[name][same].astype(int) - expected[name][same])
            assert np.percentile(difference, 99) <= 4, name


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
    """Of a scene with a world for each pixel."""
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
    from physical_scenes import add_ball, add_sun
    from pxr import Gf, Usd, UsdGeom, UsdLux

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    add_ball(stage, roughness=0.4, metallic=0.3, diffuseColor=(0.9, 0.5, 0.3))
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
    assert found["hdr"].max() > 0.3


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
    """Which side a ray sees tells which light falls on it."""
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


def test_worlds_have_tables_of_their_own(model: tuple[Any, Any], device: wp.Device) -> None:
    """Directions, places, or both may be given for each world."""
    mjm, mjd = model
    scene, alone = wc.from_mujoco(mjm, [mjd] * 3, device=device), wc.from_mujoco(mjm, mjd, device=device)
    rays, places = np.stack([random_rays(seed) for seed in range(3)]), np.stack([swaying(seed) for seed in range(3)])
    outputs = ("distance", "rgb")
    for lens in (
        wc.Rays(rays, origins=places),
        wc.Rays(rays, origins=places[0]),
        wc.Rays(curled_rays(), origins=places),
    ):
        together = wc.Renderer(scene, [camera(lens, outputs=outputs)]).render()["own"]
        for world in range(3):
            directions, origins = (
                part[world] if np.ndim(part) == 4 else part for part in (lens.directions, lens.origins)
            )
            one = rendered(alone, camera(wc.Rays(directions, origins=origins), outputs=outputs))[0]
            for name, image in one.items():
                assert (together[name][world].cpu().numpy() == image).all(), (world, name)
        assert (together["distance"][0] != together["distance"][2]).any()


def test_a_table_is_written_again(model: tuple[Any, Any], device: wp.Device) -> None:
    """By any lens that is a table; but there is room for places only where some were given."""
    scene = wc.from_mujoco(*model, device=device)
    settings = {"outputs": ("distance", "segmentation")}
    fish, lens = wc.Fisheye(fovy=120.0), wc.Rays(curled_rays(), origins=swaying())
    expected, plain = rendered(scene, camera(lens, "spread", **settings), camera(fish, "plain", **settings))
    renderer = wc.Renderer(scene, [camera(parallel(), "spread", **settings), camera(fish, "plain", **settings)])
    renderer.render()
    for each, images in ((lens, expected), (fish, plain)):
        renderer.set_lens("spread", each)
        seen = renderer.render()["spread"]
        assert (seen["segmentation"][0].cpu().numpy() == images["segmentation"]).mean() > 0.998
        same = seen["segmentation"][0].cpu().numpy() == images["segmentation"]
        np.testing.assert_allclose(seen["distance"][0].cpu().numpy()[same], images["distance"][same], atol=1e-5)
    with pytest.raises(wc.WarpcamError, match="was given Rays with origins, and the renderer was built with a lens"):
        renderer.set_lens("plain", lens)


def test_pixels_without_a_ray_see_nothing(model: tuple[Any, Any], device: wp.Device) -> None:
    rays = curled_rays()
    rays[5:9, 3:30] = 0.0
    scene = wc.from_mujoco(*model, device=device)
    settings = {"background": (0.2, 0.4, 0.6), "antialiasing": 4, "shadows": True}
    settings["outputs"] = ("rgb", "distance", "segmentation", "points")
    seen = rendered(scene, camera(wc.Rays(rays, origins=swaying()), **settings))[0]
    blind = ~rays.any(axis=-1)
    assert (seen["segmentation"][blind] == -1).all() and np.isinf(seen["distance"][blind]).all()
    assert np.isinf(seen["points"][blind]).all() and (seen["segmentation"][~blind] >= 0).any()
    assert (seen["rgb"][6, 5:28] == (51, 102, 153)).all()


def test_near_and_far_count_from_where_rays_begin(device: wp.Device) -> None:
    mjm = scenes.compile_xml('<geom type="sphere" size=".5" pos="2 0 0"/><geom type="sphere" size="1" pos="8 0 0"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lens = wc.Rays(np.full((1, 2, 3), (1.0, 0.0, 0.0)), origins=[[(0.0, 0.0, 0.0), (-3.0, 0.0, 0.5)]])
    settings = {"width": 2, "height": 1, "position": (0.0, 0.0, 0.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    settings["outputs"] = ("distance", "depth", "segmentation")
    seen = rendered(
        scene,
        camera(lens, "all", **settings),
        camera(lens, "near", near=1.6, **settings),
        camera(lens, "far", far=1.55, depth_clipping="max", **settings),
    )
    assert [one["segmentation"][0, :, 0].tolist() for one in seen] == [[0, 0], [1, 0], [0, -1]]
    np.testing.assert_allclose([one["distance"][0, 0, 0] for one in seen], [1.5, 7.0, 1.5], atol=1e-5)
    np.testing.assert_allclose([one["distance"][0, 1, 0] for one in seen], [5.0, 5.0, np.inf], atol=1e-5)
    np.testing.assert_allclose([one["depth"][0, 1, 0] for one in seen], [-0.5, -0.5, 1.55], atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (33, 1), (7, 70)])
def test_images_of_all_sizes(model: tuple[Any, Any], shape: tuple[int, int], device: wp.Device) -> None:
    """A part of a table gives a part of its image."""
    height, width = shape
    random = np.random.default_rng(3)
    rays, places = (random.normal(size=(height, width, 3)) for _ in range(2))
    scene = wc.from_mujoco(*model, device=device)
    settings = {"outputs": ("distance", "segmentation")}
    seen = rendered(scene, camera(wc.Rays(rays, origins=0.3 * places), width=width, height=height, **settings))[0]
    wide, beyond = np.zeros((2, height + 5, width + 11, 3))
    wide[2 : 2 + height, 3 : 3 + width], beyond[2 : 2 + height, 3 : 3 + width] = rays, 0.3 * places
    settings |= {"width": width + 11, "height": height + 5}
    part = rendered(scene, camera(wc.Rays(wide, origins=beyond), **settings))[0]
    for name, image in seen.items():
        assert (part[name][2 : 2 + height, 3 : 3 + width] == image).all()


@pytest.mark.parametrize(
    ("origins", "message"),
    [
        (np.ones((HEIGHT, WIDTH)), r"lens Rays: origins must have shape \(27, 45, 3\) or \(1, 27, 45, 3\)"),
        (np.ones((WIDTH, HEIGHT, 3)), r"lens Rays: origins must have shape .* got \(45, 27, 3\)"),
        (np.full((HEIGHT, WIDTH, 3), np.inf), "lens Rays: origins must be finite, got inf"),
        ("here", "lens Rays: origins must be numbers, got 'here'"),
    ],
)
def test_bad_places_are_named(model: tuple[Any, Any], origins: Any, message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        wc.Renderer(wc.from_mujoco(*model, device="cpu"), [camera(wc.Rays(curled_rays(), origins=origins))])


def test_what_is_not_offered_is_named() -> None:
    for name in ("flow", "flow_valid"):
        with pytest.raises(wc.WarpcamError, match=f"outputs has '{name}', which no lens that is a table"):
            camera(parallel(), outputs=("depth", name))


def test_shapes_are_near_or_far_from_where_rays_begin(device: wp.Device) -> None:
    """Not from the camera, which is nearer to the second ball and too near to the third."""
    balls = "".join(f'<geom type="sphere" size=".5" pos="{x} 0 0"/>' for x in (9, 2))
    mjm = scenes.compile_xml(balls)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lens = wc.Rays(np.full((1, 2, 3), (-1.0, 0.0, 0.0)), origins=[[(10.0, 0.0, 0.0), (-10.0, 0.0, 0.0)]])
    settings = {"width": 2, "height": 1, "position": (0.0, 0.0, 0.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    settings["outputs"] = ("distance", "segmentation")
    first, second = rendered(
        scene, camera(lens, "far", far=8.0, **settings), camera(lens, "near", near=5.0, far=8.0, **settings)
    )
    assert first["segmentation"][0, :, 0].tolist() == [0, -1] and first["distance"][0, 0, 0] == pytest.approx(0.5)
    assert second["segmentation"][0, :, 0].tolist() == [1, -1] and second["distance"][0, 0, 0] == pytest.approx(7.5)


def test_planes_are_seen_from_where_rays_begin(device: wp.Device) -> None:
    """By a camera below the plane, in the pixel whose ray begins above it."""
    mjm = scenes.compile_xml('<geom type="plane" size="0 0 1"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lens = wc.Rays(np.full((1, 2, 3), (0.0, 0.0, -1.0)), origins=[[(0.0, 0.0, 2.5), (0.0, 0.0, 0.0)]])
    settings = {"width": 2, "height": 1, "position": (0.0, 0.0, -1.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    seen = rendered(scene, camera(lens, outputs=("distance", "depth"), **settings))[0]
    np.testing.assert_allclose(seen["distance"][0, :, 0], [1.5, np.inf], atol=1e-6)
    np.testing.assert_allclose(seen["depth"][0, :, 0], [-1.0, np.inf], atol=1e-6)


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
    """As the pinhole that stands where the rays begin: a square of four quarters hovers over a floor."""
    pytest.importorskip("pxr.Usd", reason="pip install 'warpcam[usd]'")
    from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade
    from stages import add_material, add_square

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
    """Which side a ray sees tells whether the light falls on it: a roof over a floor, both of one mesh."""
    pytest.importorskip("pxr.Usd", reason="pip install 'warpcam[usd]'")
    from physical_scenes import add_sun
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
