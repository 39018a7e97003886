"""Rays that each begin at a place of their own: what they hit, against a ray at a time, and their tables."""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from custom_ray_tables import HEIGHT, WIDTH, curled_rays, random_rays
from offset_ray_lenses import parallel, pinholes, swaying
from ray_table_scenes import ASSETS, PLACE, SCENE, TURN, camera, rendered

import warpcam as wc
from warpcam.accel import ray_tables


@pytest.fixture(scope="module")
def model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm = scenes.compile_xml(SCENE, assets=ASSETS, more='<visual><headlight active="0"/></visual>')
    return mjm, scenes.forward(mjm)


LENSES = {
    "parallel": parallel,
    "pinhole": lambda: pinholes(0.1, 0.3),
    "random": lambda: wc.Rays(random_rays(1), origins=np.random.default_rng(2).uniform(-0.5, 0.5, (HEIGHT, WIDTH, 3))),
    "curled": lambda: wc.Rays(curled_rays(), origins=swaying()),
    "from far away": lambda: wc.Rays(-random_rays(3), origins=6.0 * ray_tables.unit(random_rays(3))),
}


def inside(mjm: mujoco.MjModel, mjd: mujoco.MjData, places: np.ndarray) -> np.ndarray:
    """Return which places lie in a geom, where MuJoCo's rays meet its other side and cameras see out."""
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
    rays = ray_tables.unit(lens.rays(WIDTH, HEIGHT, 1, "lens")[0])
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


@pytest.mark.parametrize("offset", [False, True], ids=["one place", "offset"])
def test_edges_are_smoothed_by_the_pixels_of_their_own_world(
    model: tuple[Any, Any], offset: bool, device: wp.Device
) -> None:
    """The pixels of the first world are far narrower than those of the second."""
    mjm, mjd = model
    scene, alone = wc.from_mujoco(mjm, [mjd] * 2, device=device), wc.from_mujoco(mjm, mjd, device=device)
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, WIDTH), np.linspace(0.7, -0.7, HEIGHT))
    rays = np.stack([np.stack((part * x, part * y, -np.ones_like(x)), axis=-1) for part in (0.05, 1.0)])
    origins = 0.05 * rays * (1.0, 1.0, 0.0) if offset else None
    settings = {"outputs": ("rgb",), "antialiasing": 4}
    together = wc.Renderer(scene, [camera(wc.Rays(rays, origins=origins), **settings)]).render()["own"]["rgb"]
    for world in range(2):
        lens = wc.Rays(rays[world], origins=None if origins is None else origins[world])
        assert (together[world].cpu().numpy() == rendered(alone, camera(lens, **settings))[0]["rgb"]).all()


def test_a_table_is_written_again(model: tuple[Any, Any], device: wp.Device) -> None:
    """By any lens that is a table; but there is room for places only where some were given."""
    scene = wc.from_mujoco(*model, device=device)
    settings = {"outputs": ("distance", "segmentation")}
    fish, lens = wc.Fisheye(fovy=120.0), wc.Rays(curled_rays(), origins=swaying())
    expected, plain = rendered(scene, camera(lens, "offset", **settings), camera(fish, "plain", **settings))
    renderer = wc.Renderer(scene, [camera(parallel(), "offset", **settings), camera(fish, "plain", **settings)])
    renderer.render()
    for each, images in ((lens, expected), (fish, plain)):
        renderer.set_lens("offset", each)
        seen = renderer.render()["offset"]
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
