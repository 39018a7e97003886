"""Lenses that are tables of rays: against closed forms, against a ray at a time, against the pinhole."""

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import lens_samples
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from custom_ray_tables import HEIGHT, WIDTH, curled_rays, random_rays
from ray_table_scenes import ASSETS, PLACE, SCENE, TURN, WORLDS, camera, rendered

import warpcam as wc
from warpcam.accel import ray_tables


@pytest.fixture(scope="module")
def model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    # without MuJoCo's headlight, which shines the way a camera looks
    mjm = scenes.compile_xml(SCENE, assets=ASSETS, more='<visual><headlight active="0"/></visual>')
    return mjm, scenes.forward(mjm)


LENSES: dict[str, Callable[[], wc.Lens]] = {
    "half a sphere": lambda: wc.Fisheye(fovy=180.0),
    "all around": lambda: wc.Fisheye(fx=6.0),
    "coefficients": lambda: wc.Fisheye(fx=6.0, k=(0.1, -0.02, 0.003, 0.0), cx=20.0, cy=15.0, max_fov=200.0),
    "distorted": lambda: wc.Distorted(fx=20.0, coefficients=(-0.1, 0.02, 0.01, -0.02)),
    "random": lambda: wc.Rays(random_rays(1)),
    "curled": lambda: wc.Rays(curled_rays()),
}


@pytest.mark.parametrize("name", LENSES)
def test_each_pixel_is_its_ray(model: tuple[Any, Any], name: str, device: wp.Device) -> None:
    """Against MuJoCo's own rays, one at a time: no tile's cone leaves out what a ray meets."""
    mjm, mjd = model
    lens = LENSES[name]()
    outputs = ("depth", "distance", "segmentation", "points")
    seen = rendered(wc.from_mujoco(mjm, mjd, device=device), camera(lens, outputs=outputs))[0]
    rays = ray_tables.unit(lens.rays(WIDTH, HEIGHT, 1, "lens")[0])
    turn, found = np.zeros(9), np.zeros(1, np.int32)
    mujoco.mju_quat2Mat(turn, TURN / np.linalg.norm(TURN))
    outwards = rays @ turn.reshape(3, 3).T
    distance, shape = np.full((HEIGHT, WIDTH), np.inf), np.full((HEIGHT, WIDTH), -1)
    for row, column in zip(*rays.any(axis=-1).nonzero(), strict=True):
        along = mujoco.mj_ray(mjm, mjd, PLACE, outwards[row, column], None, 1, -1, found)
        if along >= 0.0:
            distance[row, column], shape[row, column] = along, found[0]
    assert len(np.unique(shape)) > 4
    assert ((seen["segmentation"][..., 0] != shape).sum()) <= 2  # where a ray grazes an edge
    same = (seen["segmentation"][..., 0] == shape) & (shape >= 0)
    assert np.abs(seen["distance"][same][:, 0] - distance[same]).max() < 2e-5
    assert np.abs(seen["depth"][same][:, 0] + distance[same] * rays[same][:, 2]).max() < 2e-5
    expected = np.asarray(PLACE) + distance[same][:, None] * outwards[same]
    assert np.abs(seen["points"][same] - expected).max() < 2e-5
    missed = seen["segmentation"][..., 0] < 0
    assert np.isinf(seen["distance"][missed]).all() and np.isinf(seen["depth"][missed]).all()


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_a_pinholes_rays_give_its_images(model: tuple[Any, Any], antialiasing: int, device: wp.Device) -> None:
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    focal = 0.5 * HEIGHT / np.tan(np.radians(35.0))
    rays = np.stack([(column - 0.5 * WIDTH) / focal, (0.5 * HEIGHT - row) / focal, np.full_like(row, -1.0)], axis=-1)
    outputs = ("depth", "distance", "segmentation", "rgb", "normals", "points", "albedo")
    settings = {"outputs": outputs, "shadows": True, "antialiasing": antialiasing, "position": (0.2, -0.3, 2.0)}
    settings |= {"rotation": (1.0, 0.0, 0.0, 0.0)}
    scene = wc.from_mujoco(*model, device=device)
    pinhole, table, lens = rendered(
        scene,
        camera(wc.Pinhole(fovy=70.0), "pinhole", **settings),
        camera(wc.Rays(rays), "table", **settings),
        camera(wc.Distorted(fx=focal), "distorted", **settings),
    )
    for seen in (table, lens):
        same = (pinhole["segmentation"] == seen["segmentation"])[..., 0]
        assert same.mean() > 0.995
        for name, most in (("depth", 1e-5), ("distance", 1e-5), ("points", 1e-5), ("normals", 1e-4)):
            np.testing.assert_allclose(seen[name][same], pinhole[name][same], atol=most, err_msg=name)
        for name in ("rgb", "albedo"):
            difference = np.abs(seen[name][same].astype(int) - pinhole[name][same])
            assert np.percentile(difference, 99) <= 4, name


@pytest.mark.parametrize("name", WORLDS)
def test_a_pinholes_rays_in_scenes_of_all_kinds(name: str, device: wp.Device) -> None:
    assets, world, more = WORLDS[name]
    mjm = scenes.compile_xml(world, assets=assets, more=more)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    rotation = (0.8, 0.5, 0.1, 0.2) if name == "haze" else (0.95, 0.2, 0.1, 0.0)
    settings = {"outputs": ("depth", "segmentation", "rgb"), "shadows": True, "position": (0.2, -0.3, 2.0)}
    settings["rotation"] = rotation
    focal = 0.5 * HEIGHT / np.tan(np.radians(35.0))
    pinhole, table = rendered(
        scene,
        camera(wc.Pinhole(fovy=70.0), "pinhole", **settings),
        camera(wc.Distorted(fx=focal), "table", **settings),
    )
    same = (pinhole["segmentation"] == table["segmentation"])[..., 0]
    assert same.mean() > 0.99 and len(np.unique(pinhole["segmentation"])) > 1
    np.testing.assert_allclose(table["depth"][same], pinhole["depth"][same], rtol=2e-4, atol=1e-5)
    difference = np.abs(table["rgb"][same].astype(int) - pinhole["rgb"][same])
    assert np.percentile(difference, 98) <= 4
    assert pinhole["rgb"].std() > 5.0


def test_a_ball_behind(device: wp.Device) -> None:
    """All around, a ball is as large as its angle, wherever it is; planar depth is negative behind."""
    mjm = scenes.compile_xml('<geom type="sphere" size=".5" pos="0 0 2"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    lens = wc.Fisheye(fovy=360.0)
    settings = {
        "width": 64,
        "height": 64,
        "position": (0.0, 0.0, 0.0),
        "outputs": ("depth", "distance", "segmentation"),
    }
    behind, ahead = rendered(
        scene,
        camera(lens, "behind", rotation=(1.0, 0.0, 0.0, 0.0), **settings),
        camera(lens, "ahead", rotation=(0.0, 1.0, 0.0, 0.0), **settings),
    )
    column, row = np.meshgrid(np.arange(64) + 0.5 - 32.0, 32.0 - np.arange(64) - 0.5)
    angle = np.hypot(column, row) * np.pi / 32.0
    half = np.arcsin(0.25)
    assert ((ahead["segmentation"][..., 0] == 0) == (angle < half)).all()
    assert ((behind["segmentation"][..., 0] == 0) == ((angle > np.pi - half) & (angle <= np.pi))).all()
    for seen, off in ((ahead, angle), (behind, np.pi - angle)):
        hit = seen["segmentation"][..., 0] == 0
        along = 2.0 * np.cos(off) - np.sqrt(np.maximum(0.25 - 4.0 * np.sin(off) ** 2, 0.0))
        assert np.abs(seen["distance"][hit][:, 0] - along[hit]).max() < 1e-5
        assert np.abs(seen["depth"][hit][:, 0] - (along * np.cos(angle))[hit]).max() < 1e-5
    assert (behind["depth"][behind["segmentation"] == 0] < 0.0).all()


def test_near_far_and_clipping_are_along_the_rays(device: wp.Device) -> None:
    mjm = scenes.compile_xml('<geom type="sphere" size=".5" pos="2 0 0"/><geom type="sphere" size="1" pos="8 0 0"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    rays = np.zeros((1, 2, 3))
    rays[..., 0] = 1.0
    settings = {"width": 2, "height": 1, "position": (0.0, 0.0, 0.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    settings["outputs"] = ("distance", "depth", "segmentation")
    cameras = [
        camera(wc.Rays(rays), "all", **settings),
        camera(wc.Rays(rays), "near", near=1.6, **settings),
        camera(wc.Rays(rays), "far", far=1.4, depth_clipping="max", **settings),
    ]
    seen = rendered(scene, *cameras)
    assert [one["segmentation"][0, 0, 0] for one in seen] == [0, 1, -1]
    np.testing.assert_allclose([one["distance"][0, 0, 0] for one in seen], [1.5, 7.0, np.inf], atol=1e-5)
    np.testing.assert_allclose([one["depth"][0, 0, 0] for one in seen], [0.0, 0.0, 1.4], atol=1e-5)


def test_worlds_have_lenses_of_their_own(model: tuple[Any, Any], device: wp.Device) -> None:
    mjm, mjd = model
    scene = wc.from_mujoco(mjm, [mjd, mjd, mjd], device=device)
    fovy = np.array([60.0, 150.0, 300.0])
    together = wc.Renderer(scene, [camera(wc.Fisheye(fovy=fovy), outputs=("distance", "rgb"))]).render()["own"]
    for world, one in enumerate(fovy):
        alone = rendered(
            wc.from_mujoco(mjm, mjd, device=device), camera(wc.Fisheye(fovy=one), outputs=("distance", "rgb"))
        )
        for name, image in alone[0].items():
            assert (together[name][world].cpu().numpy() == image).all(), (world, name)
    assert (together["distance"][0] != together["distance"][1]).any()
    stack = np.stack([random_rays(seed) for seed in range(3)])
    seen = wc.Renderer(scene, [camera(wc.Rays(stack), outputs=("distance",))]).render()["own"]["distance"]
    assert (seen[0] != seen[2]).any()


def turned(rays: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Rotate the rays to the world's axes."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion / np.linalg.norm(quaternion))
    return ray_tables.unit(rays) @ turn.reshape(3, 3).T


@pytest.mark.parametrize("antialiasing", [1, 4])
def test_turning_the_camera_is_turning_its_rays(model: tuple[Any, Any], antialiasing: int, device: wp.Device) -> None:
    """A pixel depends on its ray alone, not on the ray's direction in the camera's frame."""
    outputs = ("depth", "distance", "segmentation", "rgb", "normals", "points", "albedo")
    settings = {"outputs": outputs, "shadows": True, "antialiasing": antialiasing}
    fish = wc.Fisheye(fovy=150.0).rays(WIDTH, HEIGHT, 1, "lens")[0]
    one, other = rendered(
        wc.from_mujoco(*model, device=device),
        camera(wc.Rays(fish), "one", **settings),
        camera(wc.Rays(turned(fish, TURN)), "other", rotation=(1.0, 0.0, 0.0, 0.0), **settings),
    )
    same = (one["segmentation"] == other["segmentation"])[..., 0]
    assert same.mean() > 0.995
    for name, most in (("distance", 1e-5), ("points", 1e-5), ("normals", 1e-4)):
        np.testing.assert_allclose(one[name][same], other[name][same], atol=most, err_msg=name)
    for name in ("rgb", "albedo"):
        difference = np.abs(one[name][same].astype(int) - other[name][same])
        assert np.percentile(difference, 98) <= 4, name
    assert (one["depth"] != other["depth"]).any()


def test_smooth_edges_of_a_fisheye(model: tuple[Any, Any], device: wp.Device) -> None:
    """Smooth edges are nearer to the mean of sixteen pixels for each."""
    scene = wc.from_mujoco(*model, device=device)
    settings = {"outputs": ("rgb",), "background": (0.0, 0.0, 0.0)}
    fine = {"width": 4 * WIDTH, "height": 4 * HEIGHT} | settings
    plain, smooth, wide = (
        image["rgb"].astype(float)
        for image in rendered(
            scene,
            camera(wc.Fisheye(fovy=170.0), "plain", **settings),
            camera(wc.Fisheye(fovy=170.0), "smooth", antialiasing=4, **settings),
            camera(wc.Fisheye(fovy=170.0), "fine", **fine),
        )
    )
    mean = wide.reshape(HEIGHT, 4, WIDTH, 4, 3).mean(axis=(1, 3))
    touched = (plain != smooth).any(axis=-1)
    assert 20 < touched.sum() < 0.5 * touched.size
    assert np.abs(smooth - mean)[touched].mean() < 0.6 * np.abs(plain - mean)[touched].mean()


def test_a_table_is_written_again(model: tuple[Any, Any], device: wp.Device) -> None:
    mjm, mjd = model
    scene = wc.from_mujoco(mjm, [mjd, mjd], device=device)
    settings = {"outputs": ("distance", "rgb")}
    cameras = [
        camera(wc.Fisheye(fovy=60.0), "shared", **settings),
        camera(wc.Fisheye(fovy=np.array([60.0, 200.0])), "own", **settings),
        camera(wc.Pinhole(fovy=60.0), "pinhole", **settings),
    ]
    renderer = wc.Renderer(scene, cameras)
    before = renderer.render()["shared"]["distance"].cpu().numpy().copy()
    renderer.set_lens("shared", wc.Rays(wc.Fisheye(fovy=200.0).rays(WIDTH, HEIGHT, 1, "lens")[0]))
    renderer.set_lens("own", wc.Fisheye(fovy=np.array([200.0, 60.0])))
    images = renderer.render()
    shared, own = (images[name]["distance"].cpu().numpy() for name in ("shared", "own"))
    assert (shared != before).any() and (shared[0] == shared[1]).all()
    np.testing.assert_allclose(own, np.stack([shared[0], before[0]]), atol=1e-6)
    renderer.set_lens("own", wc.Fisheye(fovy=60.0))
    np.testing.assert_allclose(renderer.render()["own"]["distance"].cpu().numpy(), before, atol=1e-6)
    with pytest.raises(wc.WarpcamError, match="was given a lens for each world, and the renderer was built with one"):
        renderer.set_lens("shared", wc.Fisheye(fovy=np.array([60.0, 200.0])))
    with pytest.raises(wc.WarpcamError, match="got Fisheye in place of Pinhole; other lenses have arrays"):
        renderer.set_lens("pinhole", wc.Fisheye(fovy=60.0))
    with pytest.raises(wc.WarpcamError, match="lens Fisheye: fovy must be"):
        renderer.set_lens("shared", wc.Fisheye(fovy=600.0))


def test_pixels_without_a_ray_see_nothing(model: tuple[Any, Any], device: wp.Device) -> None:
    rays = curled_rays()
    rays[5:9, 3:30] = 0.0
    scene = wc.from_mujoco(*model, device=device)
    outputs = ("rgb", "distance", "segmentation")
    settings = {"background": (0.2, 0.4, 0.6), "antialiasing": 4, "outputs": outputs, "shadows": True}
    seen = rendered(scene, camera(wc.Rays(rays), **settings))[0]
    blind = ~rays.any(axis=-1)
    assert (seen["segmentation"][blind] == -1).all() and np.isinf(seen["distance"][blind]).all()
    assert (seen["rgb"][6, 5:28] == (51, 102, 153)).all()


# Tables of all kinds of lenses, made by a child that has been forked off and has no threads of torch.
FORKING = """
import os, signal, sys
sys.path.append(sys.argv[1])
import torch
import lens_samples
torch.set_num_threads(2)
torch.sin(torch.zeros(1 << 20, dtype=torch.float64))  # starts the parent's threads
child = os.fork()
if child == 0:
    signal.alarm(60)
    tables = [lens for lens in (make() for make in lens_samples.LENSES.values()) if hasattr(lens, "rays")]
    for lens in tables:
        size = (45, 27) if type(lens).__name__ == "Rays" else (400, 300)
        assert lens.rays(*size, 1, "lens").any()
    os._exit(0 if len(tables) > 10 else 3)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="it forks")
def test_a_forked_process_makes_tables() -> None:
    folder = os.path.dirname(lens_samples.__file__)
    done = subprocess.run([sys.executable, "-c", FORKING, folder], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_a_distortion_mirrors_is_not_seen() -> None:
    """A distortion that has folded back through the middle has an area of positive sign again."""
    size, focal, k1, k2, k3 = 32, 13.0, -0.3, -0.19, 0.01
    rays = wc.Distorted(fx=focal, coefficients=(k1, k2, 0.0, 0.0, k3)).rays(size, size, 1, "here")[0]
    square = np.linspace(0.0, 4.0, 4001)
    furthest = (np.sqrt(square) * (1.0 + square * (k1 + square * (k2 + square * k3)))).max()
    across, up = np.meshgrid(np.arange(size) + 0.5 - 0.5 * size, 0.5 * size - np.arange(size) - 0.5)
    assert (rays.any(axis=-1) == (np.hypot(across, up) < focal * furthest)).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (33, 1), (7, 70)])
def test_images_of_all_sizes(model: tuple[Any, Any], shape: tuple[int, int], device: wp.Device) -> None:
    """A part of a table gives a part of its image."""
    height, width = shape
    rays = np.random.default_rng(3).normal(size=(height, width, 3))
    scene = wc.from_mujoco(*model, device=device)
    settings = {"outputs": ("distance", "segmentation")}
    seen = rendered(scene, camera(wc.Rays(rays), width=width, height=height, **settings))[0]
    wide = np.zeros((height + 5, width + 11, 3))
    wide[2 : 2 + height, 3 : 3 + width] = rays
    part = rendered(scene, camera(wc.Rays(wide), width=width + 11, height=height + 5, **settings))[0]
    for name, image in seen.items():
        assert (part[name][2 : 2 + height, 3 : 3 + width] == image).all()


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (lambda: wc.Rays(np.ones((HEIGHT, WIDTH))), r"lens Rays: directions must have shape \(27, 45, 3\) or \(1, 27"),
        (lambda: wc.Rays(np.ones((WIDTH, HEIGHT, 3))), r"directions must have shape .* got \(45, 27, 3\)"),
        (lambda: wc.Rays(np.zeros((HEIGHT, WIDTH, 3))), "directions are all 0"),
        (lambda: wc.Rays(np.full((HEIGHT, WIDTH, 3), np.nan)), "directions must be finite, got nan"),
        (lambda: wc.Rays("wide"), "directions must be numbers, got 'wide'"),
        (lambda: wc.Fisheye(fovy=400.0), r"fovy must be in \(0, 360\] degrees, got 400.0"),
        (lambda: wc.Fisheye(fovy=np.ones(7)), r"fovy must have shape a number or \(1,\), got \(7,\)"),
        (lambda: wc.Fisheye(fx=-1.0), "fx must be positive, got -1.0"),
        (lambda: wc.Fisheye(fx=9.0, k=(1.0, 2.0)), r"k must have shape \(4,\) or \(1, 4\), got \(2,\)"),
        (lambda: wc.Fisheye(fx=9.0, max_fov=0.0), r"max_fov must be in \(0, 360\] degrees, got 0.0"),
        (lambda: wc.Fisheye(fovy=300.0, k=(-0.4, 0.0, 0.0, 0.0)), "fovy must be one that the lens reaches"),
        (lambda: wc.Distorted(fx=9.0, coefficients=(1.0,)), r"coefficients must have shape \(4,\), \(5,\)"),
        (lambda: wc.Fisheye(), "Fisheye: nothing came; either fovy"),
        (lambda: wc.Fisheye(fovy=9.0, cx=2.0), "fovy came together with cx"),
    ],
)
def test_bad_lenses_are_named(model: tuple[Any, Any], lens: Callable[[], wc.Lens], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        wc.Renderer(wc.from_mujoco(*model, device="cpu"), [camera(lens())])


def test_what_is_not_offered_is_named() -> None:
    for name in ("flow", "flow_valid"):
        with pytest.raises(wc.WarpcamError, match=f"outputs has '{name}', which no lens that is a table"):
            camera(wc.Fisheye(fovy=180.0), outputs=("depth", name))
    with pytest.raises(wc.WarpcamError, match="at most 32767 pixels across and down"):
        camera(wc.Fisheye(fovy=180.0), width=40000, height=2)
