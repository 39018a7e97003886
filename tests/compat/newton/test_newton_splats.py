"""Gaussian splats through Newton's camera sensors: beside its own, and by their definition."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.core import torch_interop
from warpcam.core.color import srgb_to_linear

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
import newton_scenes  # noqa: E402, newton may be missing
import splat_scenes  # noqa: E402
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402
from newton_scenes import pose  # noqa: E402
from splat_scenes import Placed, gaussians, random_gaussians, reference  # noqa: E402

from warpcam.compat.newton import SensorCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (33, 25)
IMAGES = {
    "color_image": "color",
    "hdr_color_image": "color_hdr",
    "depth_image": "depth",
    "forward_depth_image": "depth_forward",
    "shape_index_image": "shape_index",
}
QUALITY = 1


def seen_by(kind: Any, model: Any, state: Any, samples: int = 1, **settings: Any) -> dict[str, np.ndarray]:
    """By the camera that ``splat_scenes.eye`` is, (height, width)."""
    sensor = kind(model)
    sensor.create_default_light()
    position = (0.0, -4.0, 0.0)
    w, x, y, z = (float(part) for part in scenes.looking(position, (0.0, 0.0, 0.0)))
    views = wp.array([wp.transform(wp.vec3(*position), wp.quat(x, y, z, w))], dtype=wp.transformf, device=model.device)
    fov = np.radians(splat_scenes.FOVY)
    rays = kind.compute_camera_rays_pinhole(*SIZE, camera_fov=fov, device=model.device, sample_count=samples)
    images = {name: getattr(sensor, f"allocate_image_{what}")(1, *SIZE) for name, what in IMAGES.items()}
    model.bvh_refit_shapes(state)
    sensor.update(state, views, rays, render_config=kind.RenderConfig(**settings), **images)
    return {name: image.numpy()[0].copy() for name, image in images.items()}


def channels(packed: np.ndarray) -> np.ndarray:
    return np.stack([packed >> shift & 255 for shift in (0, 8, 16, 24)], axis=-1).astype(int)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"gaussians_max_num_hits": 3},
        {"gaussians_min_transmittance": 0.1},
        {"gaussians_min_transmittance": 0.9, "gaussians_max_num_hits": 40},
        {"gaussians_mode": QUALITY},
    ],
)
def test_they_are_newtons_own(device: wp.Device, settings: dict[str, Any]) -> None:
    """Two clouds beside each other and partly behind a box. Opaque at their middles: Newton's own ends others at boxes
    that cut them off."""
    builder = newton.ModelBuilder()
    for seed, place in enumerate((pose(-1.0, 0.0, 0.0), pose(1.0, 0.3, 0.2, (0.3, 0.2, 0.1, 1.0)))):
        some = random_gaussians(300, seed=7 + seed, size=0.2)
        look = np.ones(300), some.sh_coeffs
        cloud = newton.Gaussian(some.positions, some.rotations, some.scales, *look, min_response=0.1)
        builder.add_shape_gaussian(-1, gaussian=cloud, xform=place, scale=(0.5, 0.5, 0.5))
    builder.add_shape_box(-1, hx=3.0, hy=0.1, hz=0.4, xform=pose(0.0, 0.2, 0.0))
    model, state = newton_scenes.finalize(builder, device)
    theirs, mine = (seen_by(kind, model, state, **settings) for kind in (TheirCamera, SensorCamera))
    assert {0, 1, 2} <= set(np.unique(theirs["shape_index_image"]))
    assert (mine["shape_index_image"] == theirs["shape_index_image"]).mean() > 0.998
    same = mine["shape_index_image"] == theirs["shape_index_image"]
    for name in ("depth_image", "forward_depth_image"):
        assert np.abs(mine[name] - theirs[name])[same].max() < 1e-3, name
    assert np.abs(mine["hdr_color_image"] - theirs["hdr_color_image"])[same].max() < 5e-3
    assert np.abs(channels(mine["color_image"]) - channels(theirs["color_image"]))[same].max() <= 2


def faint(count: int = 70) -> "newton.Gaussian":
    """So many behind one another that none of the nearest 20 is a surface."""
    random = np.random.default_rng(3)
    places = np.column_stack((random.uniform(-0.3, 0.3, count), np.linspace(-0.8, 0.8, count), np.zeros(count)))
    return gaussians(places, random.uniform(0.0, 1.0, (count, 3)), scales=np.full(count, 0.5), opacities=0.03)


def test_quality_is_all_that_a_ray_meets_each_once(device: wp.Device) -> None:
    source = faint()
    camera = splat_scenes.eye()
    expected = reference([Placed(source)], camera, splat_scenes.nothing(camera))
    light = expected["light"]
    solid, sure = light < 0.49, np.abs(light - 0.49) > 0.01
    assert solid.sum() > 50 and (~solid).sum() > 50
    builder = newton.ModelBuilder()
    builder.add_shape_gaussian(-1, gaussian=source)
    model, state = newton_scenes.finalize(builder, device)
    found = {kind: seen_by(kind, model, state, gaussians_mode=QUALITY) for kind in (TheirCamera, SensorCamera)}
    seen = found[SensorCamera]
    assert ((seen["shape_index_image"] == 0) == solid)[sure].all()
    hit = solid & sure
    behind = light[..., None] * np.asarray(camera.background)
    color = (expected["hdr"] - behind)[hit] / (1.0 - light[hit])[:, None]
    assert np.abs(seen["hdr_color_image"][hit] - srgb_to_linear(color)).max() < 2e-3
    theirs = (found[TheirCamera]["shape_index_image"] == 0) & ~solid
    assert (theirs & sure).sum() > 20  # it counts some again; else the page on this sensor is to be changed
    fast = seen_by(SensorCamera, model, state)
    assert (fast["shape_index_image"] != 0).all()
    for most, there in ((20, False), (60, True)):
        assert (
            seen_by(SensorCamera, model, state, gaussians_max_num_hits=most)["shape_index_image"] == 0
        ).any() == there


def test_settings_of_splats_may_change(device: wp.Device) -> None:
    """With one sensor, to and fro, and with smooth edges."""
    builder = newton.ModelBuilder()
    builder.add_shape_gaussian(-1, gaussian=faint())
    model, state = newton_scenes.finalize(builder, device)
    sensor = SensorCamera(model)
    views = wp.array([wp.transform((0.0, 0.0, 4.0), wp.quat_identity())], dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.7, device=device, sample_count=4)
    shape = sensor.allocate_image_shape_index(1, *SIZE)
    color = sensor.allocate_image_color(1, *SIZE)
    counts = []
    for least in (0.49, 0.95, 0.49):
        config = SensorCamera.RenderConfig(gaussians_min_transmittance=least, anti_aliasing=1)
        sensor.update(state, views, rays, shape_index_image=shape, color_image=color, render_config=config)
        hit = shape.numpy() == 0
        counts.append(hit.sum())
        assert set(np.unique(color.numpy()[hit] >> 24)) <= {255}
        assert (color.numpy()[~hit] == 0).all()
    assert counts[0] == counts[2] < counts[1]


def test_limits_that_a_capture_writes_are_not_taken_for_others(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_gaussian(-1, gaussian=faint(3))
    model, state = newton_scenes.finalize(builder, device)
    sensor = SensorCamera(model)
    views = wp.array([wp.transform((0.0, 0.0, 4.0), wp.quat_identity())], dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.7, device=device)
    shape = sensor.allocate_image_shape_index(1, *SIZE)
    limits: Any = sensor.scene._source
    limits = limits.parts.splat_limits

    def update(most: int) -> None:
        config = SensorCamera.RenderConfig(gaussians_max_num_hits=most)
        sensor.update(state, views, rays, shape_index_image=shape, render_config=config)

    update(20)
    with monkeypatch.context() as capture:
        capture.setattr(torch_interop, "is_capturing", lambda device: True)
        update(5)
    update(20)
    limits.fill_(wp.vec2(0.5, 5.0))  # as a launch of the graph would
    update(20)
    assert limits.numpy()[0, 1] == 20.0


def test_a_cloud_may_be_left_out_and_seen_by_other_renderers(device: wp.Device) -> None:
    """One cloud is in all worlds; the user's own clouds need no update before them."""
    builder = newton.ModelBuilder()
    source = gaussians(np.zeros((1, 3)), np.ones((1, 3)), scales=np.full(1, 0.5), opacities=0.9)
    builder.add_shape_gaussian(-1, gaussian=source)
    model, state = newton_scenes.finalize(builder, device)
    sensor = SensorCamera(model)
    camera = wc.Camera(
        "eye",
        width=SIZE[0],
        height=SIZE[1],
        outputs=["segmentation"],
        lens=wc.Pinhole(fovy=40.0),
        position=(0.0, 0.0, 4.0),
    )
    ids = wc.Renderer(sensor.scene, [camera]).render()["eye"]["segmentation"].cpu().numpy()
    counts = [(ids == 0).sum()]
    views = wp.array([wp.transform((0.0, 0.0, 4.0), wp.quat_identity())], dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=np.radians(40.0), device=device)
    shape = sensor.allocate_image_shape_index(1, *SIZE)
    for everywhere in (True, False, True):
        config = SensorCamera.RenderConfig(enable_global_world=everywhere)
        sensor.update(state, views, rays, shape_index_image=shape, render_config=config)
        counts.append((shape.numpy() == 0).sum())
    assert counts[0] == counts[1] == counts[3] > 20 and counts[2] == 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gaussians_mode": 2}, "Invalid gaussians_mode: 2"),
        (
            {"gaussians_min_transmittance": "low"},
            "gaussians_min_transmittance must be a number and not negative, got 'low'",
        ),
        ({"gaussians_max_num_hits": -1}, "gaussians_max_num_hits must be a number and not negative, got -1"),
    ],
)
def test_bad_settings_are_named(device: wp.Device, settings: dict[str, Any], message: str) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_gaussian(-1, gaussian=faint(3))
    model, state = newton_scenes.finalize(builder, device)
    with pytest.raises(wc.WarpcamError, match=message):
        seen_by(SensorCamera, model, state, **settings)
