"""Light from all around from images in float, in the looks "pbr" and "path"."""

import os
from typing import Any

import numpy as np
import pytest
import sky_images
import warp as wp
from path_scenes import inside

import warpcam as wc
from warpcam.kernels.build import environment_maps
from warpcam.textures.panorama import sky_of_panorama

pytest.importorskip("pxr.Usd")
from pbr_scenes import FOVY, SIZE, add_ball, add_sun, ball_normals
from pxr import Usd
from usd_stages import add_mesh

PLACED = {"position": (0.0, 0.0, 0.0), "lens": wc.Pinhole(fovy=FOVY), "outputs": ("hdr",)}
CAMERA = wc.Camera("c", width=SIZE, height=SIZE, **PLACED)
TILTED = (0.7, 0.3, -0.5, 0.2)
LOOKS = ("pbr", "path")
OPTIMIZED = os.environ.get("WARPCAM_TESTS") == "optimized"
USERS_SIDE = environment_maps.LEAST_SIDE
pytestmark = pytest.mark.usefixtures("small_maps")  # test_environment_maps and `test_beside_paths` have those of users
SAMPLES, NOISE = (1024, 0.0) if OPTIMIZED else (128, 0.05)  # paths beside the real-time look, and what they add


def drawn(scene: wc.Scene, look: Any, environments: Any, samples: int = 16, camera: Any = CAMERA) -> np.ndarray:
    """Light in all worlds, (world, row, column, 3)."""
    paths = wc.PathOptions(samples=samples) if look == "path" else None
    renderer = wc.Renderer(scene, [camera], look=look, path=paths, environments=environments)
    return renderer.render()["c"]["hdr"].cpu().numpy()


def ball(stage: Usd.Stage, device: wp.Device, worlds: int = 1, **material: Any) -> wc.Scene:
    add_ball(stage, **{"ior": 1.0, "diffuseColor": (1.0, 1.0, 1.0), **material})
    return wc.from_usd(stage, worlds, device=device, exposure=0.0)


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_a_white_ball_is_lost(
    stage: Usd.Stage, look: str, metallic: float, roughness: float, device: wp.Device
) -> None:
    scene = ball(stage, device, ior=1.5, roughness=roughness, metallic=metallic)
    seen = drawn(scene, look, wc.Environments(scene, np.full((4, 8, 3), 0.7, np.float32)))[0]
    hit = ball_normals()[0]
    assert seen[inside(hit)].mean() == pytest.approx(0.7, rel=5e-3)
    np.testing.assert_allclose(seen[inside(~hit)], 0.7, rtol=1e-4)


@pytest.mark.parametrize("look", LOOKS)
def test_irradiance(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    """On a matt ball, beside a sum over all texels; the image is turned and scaled."""
    image = sky_images.image_of(sky_images.smooth_radiance, 64, 128)
    scene = ball(stage, device)
    gain = np.array((1.0, 2.0, 0.5))
    environments = wc.Environments(scene, image, yaw=35.0, rotation=TILTED, intensity=gain)
    hit, normals, _ = ball_normals()
    seen = drawn(scene, look, environments, 64)[0][hit]
    truth = gain * sky_images.irradiance(image, normals @ sky_images.turn_of(TILTED, 35.0))
    middle = inside(hit)[hit]
    if look == "pbr":
        np.testing.assert_allclose(seen[middle], truth[middle], rtol=2e-3)
    else:
        np.testing.assert_allclose(seen[middle].mean(axis=0), truth[middle].mean(axis=0), rtol=3e-3)
        assert np.abs(seen[middle] / truth[middle] - 1.0).mean() < 0.08


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_even_light_of_few_columns(width: int) -> None:
    """A surface gets the same from all around however few columns an image has."""
    terms = sky_of_panorama(np.ones((2, width, 3), np.float32), np.eye(3))
    assert terms[0, 0] > 0.5
    np.testing.assert_allclose(terms[1:] / terms[0], 0.0, atol=2e-3)


@pytest.mark.parametrize("look", LOOKS)
def test_what_is_behind(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    """Each pixel shows its direction's light."""
    scene = ball(stage, device)
    image = sky_images.image_of(sky_images.smooth_radiance, 128, 256)
    seen = drawn(scene, look, wc.Environments(scene, image, yaw=-50.0, rotation=TILTED), 64)[0]
    at = ((np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0) * np.tan(np.radians(0.5 * FOVY))
    x, y = np.meshgrid(at, -at)
    rays = np.stack((x, y, -np.ones_like(x)), axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    truth = sky_images.smooth_radiance(rays @ sky_images.turn_of(TILTED, -50.0))
    free = inside(~ball_normals()[0])
    np.testing.assert_allclose(seen[free], truth[free], rtol=2e-3)


@pytest.mark.parametrize("look", LOOKS)
def test_a_quarter_turn_moves_columns(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    """A yaw of 90 degrees shows what the image does whose columns lie a quarter further to the left."""
    image = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32)
    scene = ball(stage, device, 2, roughness=0.2, metallic=1.0)
    rolled = np.roll(image, -8, axis=1)
    pair = wc.Environments(scene, [image, rolled], index=[0, 1], yaw=[90.0, 0.0], rotation=TILTED)
    # Paths draw the same numbers, but from another row of sums: what they draw differs, what they mean does not.
    one, other = drawn(scene, look, pair, 32)
    hit = ball_normals()[0]
    np.testing.assert_allclose(one[inside(~hit)], other[inside(~hit)], rtol=0.02 if look == "path" else 1e-4)
    if look == "pbr":
        np.testing.assert_allclose(one[hit], other[hit], rtol=0.02)  # lobes are sums over fixed directions
    else:
        np.testing.assert_allclose(one[hit].mean(axis=0), other[hit].mean(axis=0), rtol=0.01)


def test_a_small_sun_is_a_distant_light(stage: Usd.Stage, device: wp.Device) -> None:
    """One of 4 x 4 texels, in the dark, lights as a distant light does, by few paths."""
    height, width, row, column = 512, 1024, 96, 400
    image = np.zeros((height, width, 3), np.float32)
    image[row : row + 4, column : column + 4] = 1.0
    power = (image[row : row + 4, column, 0] * sky_images.angles(height, width)[row : row + 4, 0]).sum() * 4
    image[row : row + 4, column : column + 4] *= np.pi / power  # a white surface that faces it shows 1
    around = sky_images.directions(height, width)[row : row + 4, column : column + 4].reshape(-1, 3).mean(axis=0)
    add_mesh(stage, "/floor", [(-3, -1, -1), (3, -1, -1), (3, -1, -8), (-3, -1, -8)], [(0, 1, 2, 3)])
    rotation = (0.5, 0.5, 0.5, 0.5)  # +y is up
    toward = sky_images.turn_of(rotation, 0.0) @ around
    add_ball(stage, diffuseColor=(0.8, 0.8, 0.8), ior=1.0)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    seen = drawn(scene, "path", wc.Environments(scene, image, rotation=rotation), 64)[0]
    add_sun(stage, toward, angle=1.4)
    truth = drawn(wc.from_usd(stage, device=device, exposure=0.0), "path", None, 64)[0]
    assert truth[inside(ball_normals()[0])].max() > 0.5
    assert seen.mean() == pytest.approx(truth.mean(), rel=0.01)
    assert np.abs(seen - truth).mean() < 0.06 * truth.mean()


@pytest.mark.parametrize("look", LOOKS)
def test_worlds_have_their_own(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    """Which image, how bright; -1 is none. Arrays are written in place."""
    scene = ball(stage, device, 4)
    images = [np.full(size, light, np.float32) for size, light in (((4, 8, 3), 0.5), ((6, 10, 3), (0.1, 0.2, 0.4)))]
    environments = wc.Environments(scene, images, index=[0, 1, -1, 1], intensity=[1.0, 1.0, 1.0, 2.0])
    paths = wc.PathOptions(samples=16) if look == "path" else None
    renderer = wc.Renderer(scene, [CAMERA], look=look, path=paths, environments=environments)
    middle = inside(ball_normals()[0])
    truth = np.array(((0.5,) * 3, (0.1, 0.2, 0.4), (0.0,) * 3, (0.2, 0.4, 0.8)))
    seen = renderer.render()["c"]["hdr"].cpu().numpy()
    np.testing.assert_allclose(seen[:, middle].mean(axis=1), truth, rtol=5e-3)
    np.testing.assert_allclose(seen[:, 0, 0], truth, atol=1e-5)
    environments.index[0], environments.index[2] = 99, 0
    environments.intensity[2, 1] = 3.0
    environments.rotation[1] = 0.0  # is no rotation
    seen = renderer.render()["c"]["hdr"].cpu().numpy()
    np.testing.assert_allclose(seen[:3, middle].mean(axis=1), ((0.0,) * 3, (0.0,) * 3, (0.5, 1.5, 0.5)), rtol=5e-3)


def test_they_are_drawn_at_random(stage: Usd.Stage, device: wp.Device) -> None:
    scene = ball(stage, device, 64)
    environments = wc.Environments(scene, [np.ones((4, 8, 3), np.float32)] * 3)
    wc.randomize(environments, index=[0, 2], yaw=(0.0, 360.0), intensity=wc.Uniform(0.5, 2.0, linked=True))
    index, yaw, intensity = (getattr(environments, name).cpu().numpy() for name in ("index", "yaw", "intensity"))
    assert set(index.tolist()) == {0, 2}
    assert yaw.min() < 60.0 and yaw.max() > 300.0
    assert intensity.min() > 0.5 and intensity.max() < 2.0 and (intensity == intensity[:, :1]).all()
    wc.randomize(environments, rotation=wc.Uniform(0.0, 30.0, of="turn"))
    np.testing.assert_allclose(np.linalg.norm(environments.rotation.cpu().numpy(), axis=1), 1.0, rtol=1e-5)
    with pytest.raises(wc.WarpcamError, match="index: a choice takes whole numbers from -1 to 2, got"):
        wc.randomize(environments, index=[0, 3])
    with pytest.raises(wc.WarpcamError, match="intensity: values must be from 0"):
        wc.randomize(environments, intensity=(-1.0, 1.0))


@pytest.mark.parametrize("look", LOOKS)
def test_a_background_of_the_camera(stage: Usd.Stage, look: str, device: wp.Device) -> None:
    """It is seen in place of the image, which lights all the same."""
    scene = ball(stage, device)
    camera = wc.Camera("c", width=SIZE, height=SIZE, background=(0.0, 0.0, 0.0), **PLACED)
    seen = drawn(scene, look, wc.Environments(scene, np.full((4, 8, 3), 0.7, np.float32)), camera=camera)[0]
    assert (seen[0, 0] == 0.0).all()
    assert seen[inside(ball_normals()[0])].mean() == pytest.approx(0.7, rel=5e-3)


def test_refusals(stage: Usd.Stage, device: wp.Device) -> None:
    scene = ball(stage, device)
    image = np.ones((4, 8, 3), np.float32)
    for images, says in (
        (np.ones((4, 8, 3), np.uint8), r"images\[0\] must be a file or floats"),
        (np.ones((4, 8)), "images must be a file, an array"),
        ([image, -image], r"images\[1\] must be finite and at least 0"),
        ([image, image * np.inf], r"images\[1\] must be finite"),
        ([], "images must be a file"),
        ([image, -image[1:]], r"images\[1\] must be finite and at least 0"),
        (None, "images must be a file, .* got NoneType"),
        ("sky.png", "allowed are files .hdr and .exr"),
    ):
        with pytest.raises(wc.WarpcamError, match=says):
            wc.Environments(scene, images)
    for options, says in (
        ({"index": 1}, "index must be whole numbers from -1 to 0"),
        ({"index": 0.0}, "index must be whole numbers"),
        ({"yaw": np.nan}, "yaw"),
        ({"rotation": (0.0, 0.0, 0.0, 0.0)}, "rotation must not be 0"),
        ({"intensity": -1.0}, "intensity must not be negative"),
        ({"intensity": (1.0, 2.0)}, "intensity must have shape"),
        ({"limits": 5}, "limits must be a warpcam.Limits or None, got int"),
    ):
        with pytest.raises(wc.WarpcamError, match=says):
            wc.Environments(scene, image, **options)
    environments = wc.Environments(scene, image)
    other = wc.from_usd(stage, device=device, exposure=0.0)
    with pytest.raises(wc.WarpcamError, match="environments are of another scene"):
        wc.Renderer(other, [CAMERA], environments=environments)
    with pytest.raises(wc.WarpcamError, match=r"environments must be a warpcam.Environments or None"):
        wc.Renderer(scene, [CAMERA], environments=image)


def test_of_the_look_of_mujoco(device: wp.Device) -> None:
    """Its scenes are lit in the other looks."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><headlight active="0"/></visual><asset><material name="m" specular="0"/></asset>'
        '<worldbody><geom type="sphere" size="1" pos="0 0 -4" rgba="1 1 1 1" material="m"/></worldbody></mujoco>'
    )
    scene = wc.from_mujoco(model, mujoco.MjData(model), device=device)
    environments = wc.Environments(scene, np.full((4, 8, 3), 0.7, np.float32))
    with pytest.raises(wc.WarpcamError, match="the look is 'mujoco'"):
        wc.Renderer(scene, [CAMERA], environments=environments)
    for look in LOOKS:
        seen = drawn(scene, look, environments)[0]
        assert seen[inside(ball_normals()[0])].mean() == pytest.approx(0.7, rel=0.01)


# Of the ball's pixels but those at its edge: the mean absolute error over the mean.
@pytest.mark.parametrize(
    ("material", "most"),
    [
        ({"diffuseColor": (0.8, 0.5, 0.3), "roughness": 1.0, "ior": 1.0}, 0.04),
        ({"diffuseColor": (0.8, 0.5, 0.3), "roughness": 0.3, "ior": 1.5}, 0.04),
        ({"diffuseColor": (0.9, 0.7, 0.5), "roughness": 0.1, "metallic": 1.0}, 0.03),
        ({"diffuseColor": (0.9, 0.7, 0.5), "roughness": 0.3, "metallic": 1.0}, 0.05),
        ({"diffuseColor": (0.9, 0.7, 0.5), "roughness": 0.6, "metallic": 1.0}, 0.075),
        ({"diffuseColor": (0.9, 0.7, 0.5), "roughness": 1.0, "metallic": 1.0}, 0.055),
    ],
)
def test_beside_paths(
    stage: Usd.Stage, material: dict[str, Any], most: float, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real-time look of a ball."""
    sharp = material.get("metallic") == 1.0 and material["roughness"] < 0.5
    monkeypatch.setattr(environment_maps, "LEAST_SIDE", USERS_SIDE if sharp else 128)
    scene = ball(stage, device, **material)
    environments = wc.Environments(scene, sky_images.image_of(sky_images.bumpy_radiance, 128, 256), rotation=TILTED)
    seen, truth = (drawn(scene, look, environments, SAMPLES)[0][inside(ball_normals()[0])] for look in LOOKS)
    error = np.abs(seen - truth).mean() / truth.mean()
    assert error < most + NOISE
    assert seen.mean() == pytest.approx(truth.mean(), rel=0.025)
