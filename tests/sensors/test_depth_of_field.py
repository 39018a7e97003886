"""Depth of field against the formula of thin lenses, and against a lens of many samples."""

from typing import Any

import moving_scene
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from measured_colors import Bench, measured
from small_scene import camera, scene_of

import warpcam as wc
from warpcam import sensors
from warpcam.kernels.types import View

FOCAL = 400.0  # of cameras [pixels]
LENS: dict[str, Any] = {"focus_distance": 1.0, "f_number": 2.0, "focal_length": 0.05}


def view(across: float = FOCAL, down: float = FOCAL) -> View:
    result = View()
    result.scale, result.center = wp.vec2(1.0 / across, 1.0 / down), wp.vec2(0.0, 0.0)
    return result


def bench_of(effect: sensors.Effect, images: np.ndarray, depth: Any, device: wp.Device) -> Bench:
    return Bench(effect, images, device, views=[view()] * len(images), depth=depth)


def seen(effect: sensors.Effect, images: np.ndarray, depth: Any, device: wp.Device) -> np.ndarray:
    return bench_of(effect, images, depth, device)()


def radius(depth: Any, focus_distance: float, f_number: float, focal_length: float) -> Any:
    """Signed radius of the circle of confusion [pixels]: on the sensor [m], over the width of a pixel."""
    on_sensor = focal_length**2 / f_number * (depth - focus_distance) / (depth * (focus_distance - focal_length))
    return 0.5 * on_sensor / (focal_length / FOCAL)


def dot(size: int, worlds: int = 1) -> np.ndarray:
    image = np.zeros((worlds, size, size, 3), np.float32)
    image[:, size // 2, size // 2] = (1.0, 0.5, 0.25)
    return image


def scenery(worlds: int = 2, height: int = 37, width: int = 45) -> tuple[np.ndarray, np.ndarray]:
    """Random colours, and depths with edges, slopes and sky."""
    random = np.random.default_rng(3)
    y, x = np.mgrid[:height, :width]
    depth = np.stack([0.6 + 0.01 * x + 0.5 * ((x // 9 + y // 7 + world) % 3) for world in range(worlds)])
    depth[:, :5, 20:] = np.inf
    depth[:, 30:, :8] = 0.4
    return random.random((worlds, height, width, 3), np.float32), depth.astype(np.float32)


def gathered(image: np.ndarray, depth: np.ndarray, lens: dict[str, float], limit: float) -> np.ndarray:
    """The image (height, width, 3) by the rules, each pixel from all others."""
    away = np.where(np.isinf(depth), 1e30, depth).astype(np.float64)
    circles = np.clip(radius(away, **lens), -limit, limit)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    result = np.zeros(image.shape)
    for place in np.ndindex(depth.shape):
        own, distance = circles[place], np.hypot(rows - place[0], columns - place[1])
        is_over, is_below = circles < own - 0.5, circles > own + 0.5
        spread = np.abs(np.where(is_below, own, circles))
        area = np.where(spread > 0.5, np.pi * (spread**2 + 1.0 / 12.0), 1.0)
        share = np.clip(np.maximum(spread, 0.5) + 0.5 - distance, 0.0, 1.0) / area
        over, rest = ((share * chosen)[..., None] for chosen in (is_over, ~is_over))
        cover = over.sum()
        light = (rest * image).sum((0, 1)) / rest.sum()
        if cover > 0.0:
            light += min(cover, 1.0) * ((over * image).sum((0, 1)) / cover - light)
        result[place] = light
    return result


@pytest.mark.parametrize("depth", [0.5, 0.7, 1.6, 2.0, 8.0, np.inf])
def test_a_dot_spreads_over_the_circle_of_a_thin_lens(depth: float, device: wp.Device) -> None:
    """Second moment of a disc: a quarter of its squared radius along each axis; a pixel's own is about 1/12 more."""
    size = 41
    found = seen(sensors.DepthOfField(**LENS), dot(size), depth, device)[0].astype(np.float64)
    expected = abs(radius(min(depth, 1e9), **LENS))
    assert np.allclose(found.sum((0, 1)), (1.0, 0.5, 0.25), rtol=0.02)
    share = found[..., 0] / found[..., 0].sum()
    away = np.arange(size) - size // 2
    for axis in (0, 1):
        moment = (share.sum(axis) * away**2).sum()
        assert 2.0 * np.sqrt(moment - 1.0 / 12.0) == pytest.approx(expected, rel=0.05)
    far = np.hypot(*np.meshgrid(away, away)) > expected + 0.5
    assert (share[far] == 0.0).all() and expected > 1.0


def test_the_circle_follows_lens_and_camera(device: wp.Device) -> None:
    """Focal length, aperture and focus of each world count, and the focal length of its camera in pixels."""
    lenses = np.array([(1.0, 2.0, 0.05), (2.0, 3.0, 0.05), (1.0, 4.0, 0.1), (1.0, 2.0, 0.05)])
    views = [view(), view(), view(), view(4.0 * FOCAL, FOCAL)]
    found = measured(sensors.DepthOfField(*lenses.T), dot(61, 4), device, views=views, depth=0.5).astype(np.float64)
    away = np.arange(61) - 30
    for world in range(4):
        expected = abs(radius(0.5, *lenses[world])) * (2.0 if world == 3 else 1.0)
        share = found[world, ..., 0] / found[world, ..., 0].sum()
        moment = (share.sum(0) * away**2).sum()
        assert 2.0 * np.sqrt(moment - 1.0 / 12.0) == pytest.approx(expected, rel=0.05), world


def test_what_is_in_focus_stays_bit_by_bit(device: wp.Device) -> None:
    images, _ = scenery()
    depth = np.ones(images.shape[:3], np.float32)
    depth[:, 10:20, 12:30] = 3.0
    depth[0] += np.float32(1e-3)
    found = seen(sensors.DepthOfField(**LENS), images, depth, device)
    assert (found[depth < 2.0] == images[depth < 2.0]).all()
    assert np.abs(found[depth > 2.0] - images[depth > 2.0]).mean() > 0.1


def test_a_sharp_foreground_does_not_run_into_a_blurred_background(device: wp.Device) -> None:
    images, depth = np.full((1, 32, 40, 3), 0.8, np.float32), np.full((1, 32, 40), 5.0, np.float32)
    images[:, :, :20], depth[:, :, :20] = 0.1, 1.0
    found = seen(sensors.DepthOfField(**LENS), images, depth, device)
    assert np.allclose(found, images, atol=1e-6)


def test_a_blurred_foreground_covers_by_its_share_of_the_circle(device: wp.Device) -> None:
    """Across the edge of a half plane, the share of a disc that lies on its side; on both sides of the edge."""
    images, depth = np.zeros((1, 41, 60, 3), np.float32), np.ones((1, 41, 60), np.float32)
    images[:, :, :30], depth[:, :, :30] = 1.0, 0.5
    found = seen(sensors.DepthOfField(**LENS), images, depth, device)[0, 20, :, 0]
    circle = abs(radius(0.5, **LENS))
    edge = np.clip((np.arange(60) - 29.5) / circle, -1.0, 1.0)
    covered = (np.arccos(edge) - edge * np.sqrt(1.0 - edge * edge)) / np.pi
    assert circle > 1.0 and np.abs(found - covered).max() < 0.06
    assert (found[:20] == 1.0).all() and (found[40:] == 0.0).all()


def test_light_is_neither_lost_nor_gained_at_one_depth(device: wp.Device) -> None:
    images = np.zeros((3, 50, 58, 3), np.float32)
    images[:, 20:30, 20:38] = scenery(3, 10, 18)[0]
    found = seen(sensors.DepthOfField(**LENS), images, np.array([0.45, 1.5, np.inf])[:, None, None], device)
    sums = images.sum((1, 2))
    assert np.allclose(found.sum((1, 2)), sums, rtol=0.02)
    found, even = (seen(sensors.DepthOfField(**LENS), light, 0.45, device)[0] for light in (images, 0 * images + 1))
    assert (np.abs(found - images[0]).max() > 0.2) and np.allclose(even, 1.0, atol=1e-6)


@pytest.mark.parametrize("limit", [0.3, 2.0, 16.0])
def test_pixels_follow_the_rules(limit: float, device: wp.Device) -> None:
    """No circle is missed: tiles say how far away light may come from."""
    images, depth = scenery()
    lens = {"focus_distance": 0.7, "f_number": 2.4, "focal_length": 0.07}
    found = seen(sensors.DepthOfField(**lens, max_radius=limit), images, depth, device)
    for world in range(2):
        assert np.allclose(found[world], gathered(images[world], depth[world], lens, limit), atol=2e-4)


def test_what_is_written_in_place_stays_bounded(device: wp.Device) -> None:
    images, depth = scenery(6)
    values = torch.full((6,), 1.0, device=wp.device_to_torch(device))
    bench = bench_of(sensors.DepthOfField(values, 0.1, 0.5, max_radius=4), images, depth, device)
    bench()
    bench.params.focus_distance.assign(np.float32([0.5, -3.0, np.nan, np.inf, 1e30, 1.0]))
    bench.params.f_number.assign(np.float32([0.0, 1e-30, 1.0, 2.0, -1.0, np.nan]))
    found = bench()
    assert np.isfinite(found).all() and (found >= -1e-6).all() and (found <= 1.0 + 1e-6).all()
    assert (found[[2, 5]] == images[[2, 5]]).all()
    lens = {"focus_distance": 0.6, "f_number": 1e-6, "focal_length": 0.5}
    assert np.allclose(found[0][depth[0] > 0.6], gathered(images[0], depth[0], lens, 4.0)[depth[0] > 0.6], atol=2e-4)


ASSETS = moving_scene.ASSETS
WORLD = """
  <light type="directional" dir="0 0 -1" castshadow="false"/>
  <geom type="box" size="9 9 .1" pos="0 0 -4.1" material="squares"/>
  <geom size=".3" pos="-.4 0 -2" rgba=".9 .2 .1 1"/><geom size=".1" pos=".3 .1 -1" rgba=".2 .8 .3 1"/>
"""


def renderer_of(outputs: tuple[str, ...] = ("rgb", "depth")) -> wc.Renderer:
    mjm = scenes.compile_xml(WORLD, assets=ASSETS)
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1))
    own = scenes.own_camera(lens=wc.Pinhole(fx=70.0), outputs=outputs, width=64, height=48)
    return wc.Renderer(scene, [own])


def samples_of(aperture: float, count: int) -> np.ndarray:
    """Places on a round lens that are spread evenly, (count, 2) [m]: a spiral by the golden angle."""
    number = np.arange(count)
    away, turn = 0.5 * aperture * np.sqrt((number + 0.5) / count), 2.399963 * number
    return np.stack([away * np.cos(turn), away * np.sin(turn)], axis=1)


@pytest.mark.parametrize("focus", [1.0, 2.0, 4.0])
def test_a_lens_of_many_samples_shows_the_same(focus: float, device: wp.Device) -> None:
    """The camera at places of the lens, its principal point moved so that what is in focus stays, in the mean."""
    aperture, count = 0.2, 150
    with wp.ScopedDevice(device):
        exact, fast = renderer_of(), renderer_of()
    rig = sensors.Rig(exact, {"eye": [sensors.Accumulation(samples=count)]})
    arrays = exact.camera("eye")
    center = arrays.intrinsics[0].clone()
    for x, y in samples_of(aperture, count).tolist():
        arrays.position[0] = torch.tensor((x, y, 0.0))
        arrays.intrinsics[0] = center + torch.tensor((0, 0, x, -y), device=center.device) * center[0] / focus
        rig.read()
    lens = {"focus_distance": focus, "f_number": 0.1, "focal_length": 0.1 * aperture}
    other = sensors.Rig(fast, {"eye": [sensors.DepthOfField(**lens)]})
    other.read()
    truth, expected, found = (
        moving_scene.linear(images["eye"]["rgb"]) for images in (fast.images, rig.images, other.images)
    )
    assert np.abs(found - expected).mean() < 0.3 * np.abs(truth - expected).mean()
    assert np.abs(truth - expected).mean() > 0.01


def test_light_is_mixed_and_not_bytes(device: wp.Device) -> None:
    """Half a disc of black and half of white is half of the light, which a display shows as 188 of 255."""
    mjm = scenes.compile_xml(
        """<geom type="box" size="9 9 .1" pos="9 0 -2.1" material="white"/>
        <geom type="box" size="9 9 .1" pos="-9 0 -2.1" material="black"/>""",
        assets='<material name="white" emission="1"/><material name="black" specular="0" rgba="0 0 0 1"/>',
    )
    with wp.ScopedDevice(device):
        scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 2))
    own = scenes.own_camera(lens=wc.Pinhole(fx=FOCAL), outputs=("rgb", "depth"), width=40, height=8)
    rig = sensors.Rig(wc.Renderer(scene, [own]), {"eye": [sensors.DepthOfField(**LENS)]})
    row = moving_scene.linear(rig.read()["eye"]["rgb"])[4, :, 0]
    circle = radius(2.0, **LENS)
    edge = np.clip((19.5 - np.arange(40)) / circle, -1.0, 1.0)
    covered = (np.arccos(edge) - edge * np.sqrt(1.0 - edge * edge)) / np.pi
    assert circle > 2.0 and np.abs(row - covered).max() < 0.06
    assert row[0] == 0.0 and row[-1] == 1.0
    wc.randomize(rig.parameters("eye"), depth_of_field_focus_distance=(0.5, 1.0), depth_of_field_f_number=(1.0, 2.0))
    images = rig.read()["eye"]["rgb"]
    assert (images[0] != images[1]).any()


def test_cameras_need_depth_and_a_pinhole() -> None:
    effects = {"eye": [sensors.DepthOfField(**LENS)]}
    with pytest.raises(wc.WarpcamError, match=r"DepthOfField needs .*'depth'"):
        sensors.Rig(renderer_of(("rgb",)), effects)
    eye = camera("eye", lens=wc.Fisheye(fovy=100.0), position=(0.0, 0.0, 5.0), outputs=("rgb", "depth"))
    with pytest.raises(wc.WarpcamError, match="DepthOfField needs a camera with a pinhole lens"):
        sensors.Rig(wc.Renderer(scene_of("cpu", 1), [eye]), effects)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"focus_distance": 0.05}, "focus_distance must be greater than focal_length, got 0.05"),
        ({"focus_distance": [2.0, 0.01]}, "focus_distance must be greater than focal_length, got 0.01"),
        ({"focal_length": [0.1, 1.5]}, "focus_distance must be greater than focal_length, got 1"),
        ({"focus_distance": [2.0] * 3}, r"focus_distance must have shape a number or \(2,\), got \(3,\)"),
        ({"focus_distance": "near"}, "focus_distance must be numbers, got 'near'"),
        ({"f_number": 0.0}, "f_number must be from 0.1 to 1e\\+06, got 0"),
        ({"focal_length": -0.1}, "focal_length must be from 1e-06 to 10, got -0.1"),
        ({"max_radius": 65}, "max_radius must be above 0 and at most 64, got 65"),
        ({"max_radius": 0.0}, "max_radius must be above 0 and at most 64, got 0.0"),
        ({"max_radius": "wide"}, "max_radius must be above 0 and at most 64, got 'wide'"),
        ({"max_radius": float("nan")}, "max_radius must be above 0 and at most 64, got nan"),
    ],
)
def test_bad_input_is_refused(changes: dict[str, Any], complaint: str) -> None:
    renderer = wc.Renderer(scene_of("cpu", 2), [camera(outputs=("rgb", "depth"))])
    with pytest.raises(wc.WarpcamError, match=f"Rig: 'top': DepthOfField: {complaint}"):
        sensors.Rig(renderer, {"top": [sensors.DepthOfField(**{**LENS, **changes})]})
