"""Bundles of rays for Newton's camera sensors: lenses that they are found to be, and places that they come from."""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
import newton_scenes  # noqa: E402, newton may be missing
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (48, 32)
IMAGES = {
    "color_image": "color",
    "depth_image": "depth",
    "forward_depth_image": "depth_forward",
    "shape_index_image": "shape_index",
    "normal_image": "normal",
}


@pytest.fixture
def zoo(device: wp.Device) -> tuple[Any, Any]:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    builder.add_ground_plane()
    return newton_scenes.finalize(builder, device)


@pytest.mark.parametrize(("width", "height"), [(24, 16), (1, 1), (1, 7), (7, 1)])
def test_lenses_are_found_in_rays(width: int, height: int) -> None:
    from warpcam.compat.newton.lens_detection import read_bundle

    rays = SensorCamera.compute_camera_rays_pinhole(
        width, height, focal_length=24.0, horizontal_aperture=20.0, vertical_aperture=15.0,
        horizontal_aperture_offset=2.0, vertical_aperture_offset=-1.0, device="cpu",
    ).numpy()  # fmt: skip
    bundle = read_bundle(rays)
    fx, fy, cx, cy = bundle.numbers
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    slopes = rays[:, :, 0, 1, :2] / -rays[:, :, 0, 1, 2:]
    np.testing.assert_allclose(slopes[..., 0], (column - cx) / fx, atol=1e-5)
    np.testing.assert_allclose(slopes[..., 1], (cy - row) / fy, atol=1e-5)


def bundle(kind: str) -> np.ndarray:
    """(height, width, 1, 2, 3), from several places."""
    rays = SensorCamera.compute_camera_rays_pinhole(*SIZE, camera_fov=0.8, device="cpu").numpy()
    random = np.random.default_rng(0)
    if kind == "eyes":  # side by side, squinting
        rays[:, :24, 0, 0, 0], rays[:, 24:, 0, 0, 0] = -0.4, 0.4
        rays[:, :24, 0, 1, 0] += 0.35
        rays[:, 24:, 0, 1, 0] -= 0.35
        rays[:, :, 0, 1] /= np.linalg.norm(rays[:, :, 0, 1], axis=-1, keepdims=True)
    elif kind == "mosaic":  # at random, one of them looking back, some blind, of any length
        place = random.integers(0, 5, SIZE[::-1])
        rays[:, :, 0, 0] = random.uniform(-0.4, 0.4, (5, 3))[place]
        rays[:, :, 0, 1] *= random.uniform(0.5, 2.0, (*SIZE[::-1], 1))
        rays[place == 4, 0, 1] *= -1.0
        rays[:4, :4, 0, 1] = 0.0
    elif kind == "rows":  # of a camera that moves while it looks
        rays[:, :, 0, 0, 0] = np.linspace(-0.5, 0.5, SIZE[1])[:, None]
    elif kind == "lenslets":  # of a light field: each four by four pixels look from a place of their own
        places = np.stack(np.meshgrid(*(np.linspace(-0.6, 0.6, n // 4).repeat(4) for n in SIZE)), axis=-1)
        rays[:, :, 0, 0, :2] = places
    elif kind == "scattered":  # each pixel from anywhere
        rays[:, :, 0, 0] = random.uniform(-0.4, 0.4, (*SIZE[::-1], 3))
    else:  # columns of a line camera on a cylinder, which all look outwards
        turn = np.linspace(-1.0, 1.0, SIZE[0])
        outwards = np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=-1)
        rays[:, :, 0, 0] = 0.7 * outwards
        rays[:, :, 0, 0, 1] = np.linspace(0.9, -0.9, SIZE[1])[:, None]
        rays[:, :, 0, 1] = outwards
    return rays


@pytest.mark.parametrize("kind", ["eyes", "mosaic", "rows", "lenslets", "scattered", "cylinder"])
def test_rays_from_several_places_are_newtons_own(zoo: tuple[Any, Any], kind: str) -> None:
    model, state = zoo
    rays = wp.array(bundle(kind), dtype=wp.vec3, device=model.device)
    position = (0.0, -4.0, 1.6)
    w, x, y, z = (float(part) for part in scenes.looking(position, (0.0, 0.0, 0.8)))
    views = wp.array([wp.transform(position, wp.quat(x, y, z, w))] * 3, dtype=wp.transformf, device=model.device)
    worlds = wp.array([1, 0, 1], dtype=wp.int32, device=model.device)
    clear = TheirCamera.ClearData(0xFF336699, -7.0, 99, (0.5, 0.0, 0.5), 0xFF000001)
    found = []
    for camera in (TheirCamera, SensorCamera):
        sensor = camera(model)
        sensor.create_default_light()
        images = {name: getattr(sensor, f"allocate_image_{what}")(3, *SIZE) for name, what in IMAGES.items()}
        model.bvh_refit_shapes(state)
        # Particles aside, Newton's camera takes rays of any length.
        sensor.update(state, views, rays, world_indices=worlds, clear_data=clear, **images)
        found.append({name: image.numpy().copy() for name, image in images.items()})
    theirs, mine = found
    same = mine["shape_index_image"] == theirs["shape_index_image"]
    assert same.mean() > 0.99 and len(np.unique(theirs["shape_index_image"])) > 12
    for name in ("depth_image", "forward_depth_image"):
        close = np.abs(mine[name] - theirs[name]) < 2e-3 + 2e-3 * np.abs(theirs[name])
        assert close[same].mean() > 0.99, name
    assert (np.abs(mine["normal_image"] - theirs["normal_image"]).max(axis=-1) < 1e-2)[same].mean() > 0.98
    colors = [np.stack([seen["color_image"] >> shift & 255 for shift in (0, 8, 16, 24)], axis=-1) for seen in found]
    assert (np.abs(colors[0].astype(int) - colors[1]).max(axis=-1) <= 2)[same].mean() > 0.97
    if kind == "mosaic":
        assert (mine["shape_index_image"][:, :4, :4] == 99).all() and (theirs["forward_depth_image"] < -7.5).any()


def test_tiled_cameras_take_them_too(zoo: tuple[Any, Any]) -> None:
    """One camera of the two sees from two places."""
    model, state = zoo
    rays = np.stack((bundle("rows")[:, :, 0], bundle("eyes")[:, :, 0]))
    rays[0, :, :, 0] = 0.0
    given = wp.array(rays, dtype=wp.vec3, device=model.device)
    w, x, y, z = (float(part) for part in scenes.looking((0.0, -4.0, 1.6), (0.0, 0.0, 0.8)))
    view = wp.transform((0.0, -4.0, 1.6), wp.quat(x, y, z, w))
    views = wp.array([[view] * 2] * 2, dtype=wp.transformf, ndim=2, device=model.device)
    found = []
    for camera in (SensorTiledCamera.__mro__[1], SensorTiledCamera):
        sensor = camera(model)
        shape = sensor.utils.create_shape_index_image_output(*SIZE, camera_count=2)
        model.bvh_refit_shapes(state)
        sensor.update(state, views, given, shape_index_image=shape)
        found.append(shape.numpy())
    hulls = [shape for shape, label in enumerate(model.shape_label) if label == "convex"]
    assert (found[0] == found[1])[~np.isin(found[1], hulls)].mean() > 0.99  # Newton's own has no convex hulls here
    assert (found[1][:, 0] != found[1][:, 1]).mean() > 0.1


def test_arrays_of_rays_are_not_kept_for_ever(zoo: tuple[Any, Any], device: wp.Device) -> None:
    """One for each frame, as of a lens that zooms, beside one that stays."""
    model, state = zoo
    tiled, count = SensorTiledCamera(model), []
    poses = wp.array([[wp.transform((0.0, 0.0, 5.0), wp.quat_identity())] * 2] * 1, dtype=wp.transform, device=device)
    depth = tiled.utils.create_depth_image_output(8, 6, 1)
    stays = tiled.utils.compute_pinhole_camera_rays(8, 6, 0.5)
    for frame in range(40):
        zooms = tiled.utils.compute_pinhole_camera_rays(8, 6, 0.5 + 0.01 * frame)
        for rays in (stays, zooms):
            tiled.update(state, poses, rays, depth_image=depth)
        count.append(len(tiled._slices))
    assert count[-1] == max(count) < 20
    assert tiled._slices[id(stays)][0] is stays


def test_rays_that_are_not_finite_are_refused(zoo: tuple[Any, Any]) -> None:
    model, state = zoo
    rays = bundle("rows")
    rays[3, 4, 0, 0, 1] = np.nan
    sensor = SensorCamera(model)
    views = wp.array([wp.transform_identity()] * 2, dtype=wp.transformf, device=model.device)
    depth = sensor.allocate_image_depth(2, *SIZE)
    with pytest.raises(wc.WarpcamError, match="camera_rays: some are not finite; allowed are"):
        sensor.update(state, views, wp.array(rays, dtype=wp.vec3, device=model.device), depth_image=depth)
