"""Cameras: where the pixels of each kind of lens look, and how cameras are placed."""

import math
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

every_device = pytest.mark.parametrize("device", [device.alias for device in wp.get_devices()])

WIDTH, HEIGHT = 20, 10
MODEL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -2"/>
    <camera name="plain" pos=".3 .2 0" fovy="60"/>
    <camera name="sensor" focal="0.01 0.02" sensorsize="0.02 0.03" principal="0.002 0.003" resolution="200 100"/>
    <camera name="parallel" fovy="2" projection="orthographic"/>
    <body name="arm" pos="1 0 0" euler="0 0 90"><joint/><geom size=".01" pos="0 0 5"/></body>
  </worldbody>
</mujoco>
"""


def make_scene(device: str, num_worlds: int = 2) -> tuple[wc.Scene, Any, Any]:
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    mjd = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, mjd)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=num_worlds)
    return wc.from_mujoco_warp(mjm, m, d), m, d


def seen(scene: wc.Scene, name: str | int, **camera: Any) -> np.ndarray:
    """Return the point at which each pixel meets the plane 2 m below the origin: x and y, (world, height, width, 2)."""
    points = render(scene, wc.Camera(name, width=WIDTH, height=HEIGHT, outputs=("points",), **camera))
    assert np.allclose(points[..., 2], -2.0, atol=1e-5)
    return points[..., :2]


def render(scene: wc.Scene, camera: wc.Camera) -> np.ndarray:
    (output,) = camera.outputs
    return wc.Renderer(scene, [camera]).render()[camera.name][output].cpu().numpy()


def grid(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """x and y per unit of depth of each pixel's ray, (height, width, 2)."""
    i, j = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    return np.stack(((i - cx) / fx, (cy - j) / fy), axis=-1)


FOCAL_60 = 0.5 * HEIGHT / math.tan(math.radians(30.0))


@every_device
def test_vertical_field_of_view(device: str) -> None:
    scene, _, _ = make_scene(device)
    expected = 2.0 * grid(FOCAL_60, FOCAL_60, WIDTH / 2, HEIGHT / 2) + (0.3, 0.2)
    np.testing.assert_allclose(seen(scene, "plain")[0], expected, atol=1e-5)
    np.testing.assert_array_equal(seen(scene, 0), seen(scene, "plain"))


def test_sensor_sees_as_in_mujoco_renderer() -> None:
    # mujoco.Renderer 3.17 at 200 x 100 shows a point straight ahead at pixel (80, 40), one at (0.3, 0.2, -2) at
    # (95, 33.3): the image spans the sensor whatever its shape, the principal point moves it left and up.
    scene, _, _ = make_scene("cpu")
    expected = 2.0 * grid(WIDTH / 2, HEIGHT * 2 / 3, 0.4 * WIDTH, 0.4 * HEIGHT)
    np.testing.assert_allclose(seen(scene, "sensor")[0], expected, atol=1e-5)


def test_orthographic_camera_of_the_scene() -> None:
    scene, _, _ = make_scene("cpu")
    pixels = HEIGHT / 2.0
    expected = grid(pixels, pixels, WIDTH / 2, HEIGHT / 2)
    np.testing.assert_allclose(seen(scene, "parallel")[0], expected, atol=1e-5)
    np.testing.assert_allclose(seen(scene, "sensor", lens=wc.Orthographic(2.0))[0], expected, atol=1e-5)


def test_lens_overrides_the_scenes() -> None:
    scene, _, _ = make_scene("cpu")
    lens = wc.Pinhole(fx=12.0, fy=9.0, cx=7.0, cy=4.0)
    np.testing.assert_allclose(seen(scene, "sensor", lens=lens)[1], 2.0 * grid(12, 9, 7, 4), atol=1e-5)
    square = seen(scene, "sensor", lens=wc.Pinhole(fx=12.0))
    np.testing.assert_allclose(square[1], 2.0 * grid(12, 12, WIDTH / 2, HEIGHT / 2), atol=1e-5)


@every_device
def test_values_may_differ_from_world_to_world(device: str) -> None:
    scene, _, _ = make_scene(device)
    lens = wc.Pinhole(
        fx=torch.tensor([10.0, 20.0]), fy=[30.0, 40.0], cx=wp.array([5.0, 6.0], dtype=float, device="cpu")
    )
    images = seen(scene, "own", lens=lens, position=np.array([[0, 0, 0], [1, 2, 0]]))
    np.testing.assert_allclose(images[0], 2.0 * grid(10, 30, 5, HEIGHT / 2), atol=1e-5)
    np.testing.assert_allclose(images[1], 2.0 * grid(20, 40, 6, HEIGHT / 2) + (1, 2), atol=1e-5)


@every_device
def test_field_of_view_of_the_model_is_live_for_each_world(device: str) -> None:
    scene, m, _ = make_scene(device)
    camera = wc.Camera("plain", width=WIDTH, height=HEIGHT, outputs=("points",))
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    angles = np.tile(m.cam_fovy.numpy(), (2, 1))
    angles[1, 0] = 90.0
    m.cam_fovy = wp.array(angles, dtype=float, device=device)
    points = renderer.render()["plain"]["points"].cpu().numpy()[..., :2] - np.float32((0.3, 0.2))
    np.testing.assert_allclose(points[0], 2.0 * grid(FOCAL_60, FOCAL_60, WIDTH / 2, HEIGHT / 2), atol=1e-5)
    np.testing.assert_allclose(points[1], 2.0 * grid(5, 5, WIDTH / 2, HEIGHT / 2), atol=1e-5)


def test_own_camera_rides_on_a_body() -> None:
    scene, _, _ = make_scene("cpu")
    # 90 degrees about z: the body's x is the world's y. The quaternion is twice as long as need be.
    images = seen(scene, "own", lens=wc.Pinhole(fx=10.0), parent="arm", position=(0.5, 0.0, 0.0), rotation=(2, 0, 0, 0))
    rays = 2.0 * grid(10, 10, WIDTH / 2, HEIGHT / 2)
    expected = np.stack((1.0 - rays[..., 1], 0.5 + rays[..., 0]), axis=-1)
    np.testing.assert_allclose(images[0], expected, atol=1e-5)
    np.testing.assert_array_equal(
        seen(scene, "own", lens=wc.Pinhole(fx=10.0), parent=1)[0],
        seen(scene, "own", lens=wc.Pinhole(fx=10.0), parent="arm", position=(0, 0, 0))[0],
    )


def test_rotation_is_w_x_y_z() -> None:
    scene, _, _ = make_scene("cpu")
    half = math.sqrt(0.5)
    images = seen(scene, "own", lens=wc.Pinhole(fx=10.0), rotation=(half, 0, 0, half))  # 90 degrees about z
    rays = 2.0 * grid(10, 10, WIDTH / 2, HEIGHT / 2)
    np.testing.assert_allclose(images[0], np.stack((-rays[..., 1], rays[..., 0]), axis=-1), atol=1e-5)


@every_device
def test_pose_and_lens_are_written_in_place(device: str) -> None:
    scene, _, _ = make_scene(device)
    camera = wc.Camera(
        "own", width=WIDTH, height=HEIGHT, outputs=("points",), lens=wc.Pinhole(fovy=60.0), position=(0, 0, 0)
    )
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    arrays = renderer.camera("own")
    arrays.position[1] = torch.tensor([4.0, 5.0, 0.0])
    arrays.fovy[1] = 90.0
    points = renderer.render()["own"]["points"].cpu().numpy()[..., :2]
    np.testing.assert_allclose(points[0], 2.0 * grid(FOCAL_60, FOCAL_60, WIDTH / 2, HEIGHT / 2), atol=1e-5)
    np.testing.assert_allclose(points[1], 2.0 * grid(5, 5, WIDTH / 2, HEIGHT / 2) + (4, 5), atol=1e-5)


def test_arrays_that_are_not_the_cameras_are_named() -> None:
    scene, _, _ = make_scene("cpu")
    renderer = wc.Renderer(scene, [wc.Camera("plain", width=4, height=4, outputs=("depth",))])
    with pytest.raises(AttributeError, match=r"Camera\('plain'\) has no array 'position' of its own, it has near, far"):
        renderer.camera("plain").position  # noqa: B018


@pytest.mark.parametrize(("clipping", "miss"), [("none", math.inf), ("max", 1.5), ("zero", 0.0)])
def test_depth_clipping(clipping: str, miss: float) -> None:
    scene, _, _ = make_scene("cpu")
    camera = wc.Camera(
        "plain", width=4, height=4, outputs=("depth",), far=np.array([1.5, 3.0]), depth_clipping=clipping
    )
    depth = render(scene, camera)
    assert (depth[0] == miss).all()
    np.testing.assert_allclose(depth[1], 2.0, atol=1e-6)


def test_near_hides_what_is_nearer() -> None:
    scene, _, _ = make_scene("cpu")
    camera = wc.Camera("plain", width=4, height=4, outputs=("depth",), near=(1.0, 2.5))
    depth = render(scene, camera)
    np.testing.assert_allclose(depth[0], 2.0, atol=1e-6)
    assert np.isinf(depth[1]).all()


@every_device
@pytest.mark.parametrize(
    ("array", "value"),
    [("position", math.nan), ("rotation", 0.0), ("fovy", 180.0), ("fovy", -1.0), ("near", -1.0), ("far", 0.0)],
)
def test_a_broken_camera_costs_its_own_world_its_image(array: str, value: float, device: str) -> None:
    scene, _, _ = make_scene(device, num_worlds=3)
    camera = wc.Camera("own", width=8, height=8, outputs=("depth",), lens=wc.Pinhole(fovy=60.0), position=(0, 0, 0))
    renderer = wc.Renderer(scene, [camera])
    getattr(renderer.camera("own"), array)[1] = value
    depth = renderer.render()["own"]["depth"].cpu().numpy()
    assert np.isinf(depth[1]).all()
    np.testing.assert_allclose(depth[[0, 2]], 2.0, atol=1e-6)
    assert renderer.faulty.tolist() == [0, 1, 0]
    getattr(renderer.camera("own"), array)[1] = 1.0
    renderer.render()
    assert renderer.faulty.tolist() == [0, 0, 0]
