"""Suns of images of light from all around, which are distant lights in the look "pbr"."""

from typing import Any

import numpy as np
import pytest
import sky_images
import warp as wp

import warpcam as wc
from warpcam.kernels.build import environment_maps
from warpcam.textures.panorama_sun import sun_of_panorama, without_sun

pytest.importorskip("pxr.Usd")
from pbr_scenes import bind
from pxr import Gf, Usd, UsdGeom, UsdLux
from usd_stages import add_mesh

SKY, POWER = 0.2, 2.0  # radiance around the sun; what a white surface shows that faces the sun
TOWARD = np.array((0.48, 0.36, 0.8))
SIZE = (48, 40)


@pytest.fixture(autouse=True)
def small_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment_maps, "LEAST_SIDE", 128)


def sky_with_sun(toward: Any = TOWARD, angle: float = 2.0, sky: float = SKY, height: int = 256) -> np.ndarray:
    """An even sky with a disk of that angle from its middle to its edge [degrees]."""
    cosines = sky_images.directions(height, 2 * height) @ np.asarray(toward)
    disk = cosines >= np.cos(np.radians(angle))
    solid = (disk * sky_images.angles(height, 2 * height)).sum()
    image = np.full((height, 2 * height, 3), sky, np.float32)
    image[disk] += np.array((1.0, 0.9, 0.7), np.float32) * np.float32(POWER * np.pi / solid)
    return image


def light_of(image: np.ndarray) -> np.ndarray:
    """Over pi, (3,)."""
    return (image * sky_images.angles(*image.shape[:2])[..., None]).sum(axis=(0, 1)) / np.pi


def test_a_disk_is_found() -> None:
    image = sky_with_sun()
    sun = sun_of_panorama(image)
    np.testing.assert_allclose(sun.direction, TOWARD, atol=2e-3)
    left = without_sun(image, sun)
    assert left.max() < 5.0 * SKY
    np.testing.assert_allclose(sun.color + light_of(left), light_of(image), rtol=1e-4)
    assert np.degrees(np.arcsin(np.sqrt(sun.sine_squared))) == pytest.approx(2.0, rel=0.05)


def test_light_beside_a_sun_is_kept() -> None:
    """What is as bright 7 degrees beside it is taken out with it."""
    side = np.cross(TOWARD, (0.0, 0.0, 1.0))
    beside = np.cos(np.radians(7.0)) * TOWARD + np.sin(np.radians(7.0)) * side / np.linalg.norm(side)
    image = sky_with_sun() + 0.08 * (sky_with_sun(beside, 1.0) - SKY)
    sun = sun_of_panorama(image)
    np.testing.assert_allclose(sun.color + light_of(without_sun(image, sun)), light_of(image), rtol=1e-4)


@pytest.mark.parametrize("toward", [(0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_at_the_edges_of_an_image(toward: Any) -> None:
    sun = sun_of_panorama(sky_with_sun(toward))
    np.testing.assert_allclose(sun.direction, toward, atol=5e-3)
    assert sun.color[0] == pytest.approx(POWER, rel=0.05)


def test_what_has_none() -> None:
    """Even light, light that changes slowly, a wide bright window, a spot that hardly lights, a sky without its sun."""
    spot = np.ones((64, 128, 3), np.float32)
    spot[20, 30] = 30.0
    for image in (
        np.full((16, 32, 3), 0.7, np.float32),
        np.zeros((16, 32, 3), np.float32),
        sky_images.image_of(sky_images.smooth_radiance, 64, 128),
        sky_with_sun(angle=12.0),
        sky_with_sun(angle=7.0),
        spot,
        wc.Environments.sky((0.3, 0.5, 0.8), sun=False),
        np.ones((1, 1, 3), np.float32),
    ):
        assert sun_of_panorama(image) is None


def floor_and_box(stage: Usd.Stage, **material: Any) -> None:
    floor = add_mesh(stage, "/floor", [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2, 3)])
    bind(floor, stage, **{"diffuseColor": (0.5, 0.5, 0.5), "ior": 1.0, **material})
    box = UsdGeom.Cube.Define(stage, "/box")
    box.CreateSizeAttr(0.6)
    UsdGeom.Xformable(box).AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, 0.7))


def camera(**more: Any) -> wc.Camera:
    options = {"shadows": True, "outputs": ("hdr",), **more}
    return wc.Camera(
        "c", width=SIZE[0], height=SIZE[1], lens=wc.Orthographic(height=4.0), position=(0.0, 0.0, 3.0), **options
    )


def drawn(scene: wc.Scene, environments: Any, camera: wc.Camera, **options: Any) -> np.ndarray:
    renderer = wc.Renderer(scene, [camera], look="pbr", environments=environments, **options)
    return renderer.render()["c"]["hdr"].cpu().numpy()


def test_it_shines_as_a_distant_light(stage: Usd.Stage, device: wp.Device) -> None:
    """With the same shadow; where it is left in the image there is none."""
    floor_and_box(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    image = sky_with_sun(sky=0.0)
    seen = drawn(scene, wc.Environments(scene, image), camera())[0]
    left = drawn(scene, wc.Environments(scene, image, extract_sun=False), camera())[0]
    sun = UsdLux.DistantLight.Define(stage, "/sun")
    sun.CreateNormalizeAttr(True)
    sun.CreateAngleAttr(4.0)
    sun.CreateIntensityAttr(np.pi * POWER)
    sun.CreateColorAttr((1.0, 0.9, 0.7))
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*map(float, TOWARD))).GetQuat()
    UsdGeom.Xformable(sun).AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(turn)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    truth = drawn(scene, None, camera())[0]
    assert (truth[..., 0] < 0.01).mean() > 0.02
    alike = np.isclose(seen, truth, rtol=0.02, atol=1e-3).all(axis=-1)
    assert alike.mean() > 0.99  # a shadow's edge may lie a pixel beside
    assert left.min() > 0.1


def test_worlds_have_their_own(stage: Usd.Stage, device: wp.Device) -> None:
    """Which image, how it is turned, how bright it is, as in a scene of one world; written in place, too."""
    floor_and_box(stage)
    images = [sky_with_sun(), sky_with_sun((-0.6, 0.0, 0.8)), np.full((4, 8, 3), 0.5, np.float32)]
    worlds = {"index": [0, 1, 0, 2, -1], "yaw": [0.0, 30.0, 90.0, 0.0, 0.0], "intensity": [1.0, 0.5, 2.0, 1.0, 1.0]}
    scene = wc.from_usd(stage, 5, device=device, exposure=0.0)
    environments = wc.Environments(scene, images, **worlds)
    how = {"ambient_occlusion": 1.0, "soft_shadows": True}
    renderer = wc.Renderer(scene, [camera()], look="pbr", environments=environments, **how)
    seen = renderer.render()["c"]["hdr"].cpu().numpy().copy()
    alone = wc.from_usd(stage, device=device, exposure=0.0)
    for world in range(5):
        one = wc.Environments(alone, images, **{name: values[world] for name, values in worlds.items()})
        np.testing.assert_allclose(seen[world], drawn(alone, one, camera(), **how)[0], rtol=1e-4, atol=1e-5)
    assert np.abs(seen[0] - seen[2] / 2.0).max() > 0.2
    assert seen[4].max() == 0.0
    for name in worlds:
        getattr(environments, name)[0] = worlds[name][1]
    np.testing.assert_allclose(renderer.render()["c"]["hdr"].cpu().numpy()[0], seen[1], rtol=1e-5)


def test_lights_of_the_scene_stay(stage: Usd.Stage, device: wp.Device) -> None:
    """And are read each frame, as they are written in place."""
    floor_and_box(stage)
    lamp = UsdLux.SphereLight.Define(stage, "/lamp")
    lamp.CreateRadiusAttr(0.1)
    lamp.CreateIntensityAttr(50.0)
    UsdGeom.Xformable(lamp).AddTranslateOp().Set(Gf.Vec3d(1.5, 0.0, 1.5))
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    only = drawn(scene, None, camera())
    dark = wc.Environments(scene, sky_with_sun(), intensity=0.0)
    np.testing.assert_allclose(drawn(scene, dark, camera()), only, rtol=1e-5, atol=1e-6)
    renderer = wc.Renderer(scene, [camera()], look="pbr", environments=wc.Environments(scene, sky_with_sun()))
    both = renderer.render()["c"]["hdr"].cpu().numpy().copy()
    scene.array("light_active").fill_(False)
    sun = renderer.render()["c"]["hdr"].cpu().numpy()
    np.testing.assert_allclose(both - sun, only, atol=1e-3)


@pytest.mark.parametrize("roughness", [0.05, 0.3, 0.8])
def test_a_ball_has_its_light_once(stage: Usd.Stage, roughness: float, device: wp.Device) -> None:
    """Beside paths, whose sun is in the image; a wide light's highlight on a smooth ball is up to 13 % too bright."""
    ball = UsdGeom.Sphere.Define(stage, "/ball")
    ball.CreateRadiusAttr(1.4)
    bind(ball, stage, diffuseColor=(0.9, 0.9, 0.9), metallic=1.0, roughness=roughness)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    environments = wc.Environments(scene, sky_with_sun(angle=4.0))
    plain = camera(shadows=False)
    seen = drawn(scene, environments, plain)[0]
    renderer = wc.Renderer(scene, [plain], look="path", path=wc.PathOptions(samples=256), environments=environments)
    truth = renderer.render()["c"]["hdr"][0].cpu().numpy()
    assert seen.mean() == pytest.approx(truth.mean(), rel=0.15)


def test_it_is_seen_behind_everything(stage: Usd.Stage, device: wp.Device) -> None:
    floor_and_box(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    image = sky_with_sun((0.0, 0.0, 1.0), angle=4.0)
    up = wc.Camera("c", width=16, height=16, lens=wc.Pinhole(fovy=10.0), position=(0.0, 0.0, 3.0),
                   rotation=(0.0, 1.0, 0.0, 0.0), outputs=("hdr",))  # fmt: skip
    seen, left = (drawn(scene, wc.Environments(scene, image, extract_sun=on), up)[0] for on in (True, False))
    np.testing.assert_array_equal(seen, left)
    assert seen.max() > 50.0 * SKY


def test_memory_is_told(stage: Usd.Stage, device: wp.Device) -> None:
    """Of shares of lights, of which there is one more."""
    floor_and_box(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    environments, options = wc.Environments(scene, sky_with_sun()), {"look": "pbr", "soft_shadows": True}
    renderer = wc.Renderer(scene, [camera()], environments=environments, **options)
    told = wc.estimate_memory(scene, [camera()], environments=environments, **options)
    assert renderer.memory.total == told.total > wc.estimate_memory(scene, [camera()], **options).total


def test_refusals(stage: Usd.Stage, device: wp.Device) -> None:
    floor_and_box(stage)
    scene = wc.from_usd(stage, device=device, exposure=0.0)
    with pytest.raises(wc.WarpcamError, match="extract_sun must be True or False, got 1"):
        wc.Environments(scene, sky_with_sun(), extract_sun=1)
