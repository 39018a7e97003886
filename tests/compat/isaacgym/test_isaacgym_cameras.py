"""Isaac Gym's cameras: where they are, what they follow, their matrices; and calls in the wrong order."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp
from PIL import Image

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, HEIGHT, KINDS, WIDTH, at, new_sim, props, tensors_of, walls

from warpcam.compat.isaacgym import gymapi, gymtorch

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
COLOR, DEPTH, SEGMENTATION = KINDS
UPS = {
    gymapi.UP_AXIS_Z: {"ahead": (1, 0, 0), "left": (0, 1, 0), "above": (0, 0, 1)},
    gymapi.UP_AXIS_Y: {"ahead": (0, 0, -1), "left": (-1, 0, 0), "above": (0, 1, 0)},
}


@pytest.mark.parametrize("up", UPS, ids=lambda up: up.name)
def test_which_way_a_camera_looks(device: wp.Device, up: gymapi.UpAxis) -> None:
    """Boxes ahead, on the left of it and above it are where they are to be seen."""
    sim = new_sim(device, up=up)
    env = GYM.create_env(sim, gymapi.Vec3(-2, -2, -2), gymapi.Vec3(2, 2, 2), 1)
    box = GYM.create_box(sim, 0.3, 0.3, 0.3, gymapi.AssetOptions(fix_base_link=True))
    axes = {name: 2.0 * np.array(axis) for name, axis in UPS[up].items()}
    for segment, place in enumerate(
        (axes["ahead"], axes["ahead"] + 0.4 * axes["left"], axes["ahead"] + 0.25 * axes["above"])
    ):
        GYM.create_actor(env, box, gymapi.Transform(p=place), f"box {segment}", 0, 0, 1 + segment)
    for camera in range(2):
        assert GYM.create_camera_sensor(env, props()) == camera
    GYM.set_camera_transform(0, env, gymapi.Transform())
    GYM.set_camera_location(1, env, gymapi.Vec3(), gymapi.Vec3(*axes["ahead"]))
    images = [tensors_of(sim, env, camera, (SEGMENTATION,))[SEGMENTATION] for camera in range(2)]
    GYM.render_all_camera_sensors(sim)
    first, second = (image.cpu().numpy() for image in images)
    np.testing.assert_array_equal(first, second)
    rows, columns = np.indices(first.shape)
    middles = {
        k: (rows[first == k].mean() + 0.5 - HEIGHT / 2, columns[first == k].mean() + 0.5 - WIDTH / 2) for k in (1, 2, 3)
    }
    assert np.allclose(middles[1], 0.0, atol=0.6)
    assert middles[2][1] < -4 and abs(middles[2][0]) < 1
    assert middles[3][0] < -2 and abs(middles[3][1]) < 1


@pytest.mark.parametrize("up", UPS, ids=lambda up: up.name)
def test_matrices_take_points_of_the_shared_frame_to_their_pixels(device: wp.Device, up: gymapi.UpAxis) -> None:
    sim = new_sim(device, up=up)
    ball = GYM.create_sphere(sim, 0.15, gymapi.AssetOptions(fix_base_link=True))
    place = gymapi.Vec3(0.4, 0.3, 0.2)
    images = []
    for _ in range(3):
        env = GYM.create_env(sim, gymapi.Vec3(-3, -3, -3), gymapi.Vec3(3, 3, 3), 2)
        GYM.create_actor(env, ball, gymapi.Transform(p=place), "ball", 0, 0, 1)
        camera = GYM.create_camera_sensor(env, props(width=80, height=60))
        GYM.set_camera_location(camera, env, gymapi.Vec3(-0.6, 1.2, 1.1), gymapi.Vec3(0.2, 0.2, 0.2))
        images.append(tensors_of(sim, env, camera, (DEPTH,))[DEPTH])
    GYM.render_all_camera_sensors(sim)
    origins = []
    for index, image in enumerate(images):
        env = GYM.get_env(sim, index)
        view = GYM.get_camera_view_matrix(sim, env, 0)
        projection = GYM.get_camera_proj_matrix(sim, env, 0)
        assert view.dtype == projection.dtype == np.float32
        assert projection[0, 0] == pytest.approx(1.0) and projection[1, 1] == pytest.approx(80 / 60)
        origin = np.array(tuple(GYM.get_env_origin(env)))
        origins.append(tuple(origin))
        clip = np.append(np.array(tuple(place)) + origin, 1.0) @ view @ projection
        u, v = (0.5 + 0.5 * clip[0] / clip[3]) * 80, (0.5 - 0.5 * clip[1] / clip[3]) * 60
        depth = image.cpu().numpy()
        rows, columns = np.nonzero(np.isfinite(depth))
        assert abs(columns.mean() + 0.5 - u) < 0.7 and abs(rows.mean() + 0.5 - v) < 0.7
        # The users' own way back: every point that is seen lies on the ball.
        z = depth[rows, columns]
        x = -(columns + 0.5 - 40) / 80 * z * (2.0 / projection[0, 0])
        y = (rows + 0.5 - 30) / 60 * z * (2.0 / projection[1, 1])
        points = np.stack((x, y, z, np.ones_like(z)), axis=1) @ np.linalg.inv(view)
        far = np.linalg.norm(points[:, :3] - origin - np.array(tuple(place)), axis=1)
        np.testing.assert_allclose(far, 0.15, atol=2e-4)
    assert len(set(origins)) == 3


def test_cameras_follow_bodies_in_both_ways(device: wp.Device) -> None:
    sim = new_sim(device)
    plate = GYM.create_box(sim, 0.02, 0.2, 0.2, gymapi.AssetOptions(disable_gravity=True))
    wall = GYM.create_box(sim, 1.0, 20.0, 20.0, gymapi.AssetOptions(fix_base_link=True))
    images = []
    for _ in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 1), 2)
        GYM.create_actor(env, wall, at(4.5, 0, 0), "wall", 0, 0, 1)
        GYM.create_actor(env, plate, at(0, 0, 0), "plate", 0, 0, 2)
        body = GYM.find_actor_rigid_body_handle(env, 1, "box")
        for mode in (gymapi.FOLLOW_TRANSFORM, gymapi.FOLLOW_POSITION):
            camera = GYM.create_camera_sensor(env, props())
            GYM.attach_camera_to_body(camera, env, body, at(0.5, 0, 0), mode)
            images.append(tensors_of(sim, env, camera, (DEPTH,))[DEPTH])
    GYM.render_all_camera_sensors(sim)
    for image in images:
        np.testing.assert_allclose(image.cpu(), -3.5, rtol=1e-5)
    states = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    turn = np.radians(30.0)
    states[3, :7] = torch.tensor((1.0, 0.0, 0.0, 0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)))  # of the second
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(states))
    GYM.render_all_camera_sensors(sim)
    np.testing.assert_allclose(images[0].cpu(), -3.5, rtol=1e-5)
    np.testing.assert_allclose(images[3].cpu(), -2.5, rtol=1e-5)
    turned = images[2].cpu().numpy()
    # The plate turns it: it stands at (1 + 0.5 cos, 0.5 sin) and looks 30 degrees to the left; its middle column's
    # ray meets the wall after (3 - 0.5 cos) / cos.
    middle = turned[:, WIDTH // 2 - 1 : WIDTH // 2 + 1].mean()
    assert middle == pytest.approx(-(3.0 - 0.5 * np.cos(turn)) / np.cos(turn), rel=1e-2)
    env = GYM.get_env(sim, 1)
    pose, old = GYM.get_camera_transform(sim, env, 0), GYM.get_camera_transform(sim, env, 0, quirks=True)
    np.testing.assert_allclose(tuple(pose.p), (1.0 + 0.5 * np.cos(turn), 0.5 * np.sin(turn), 0.0), atol=1e-5)
    np.testing.assert_allclose(tuple(pose.r), (0, 0, np.sin(0.5 * turn), np.cos(0.5 * turn)), atol=1e-5)
    assert tuple(old.p) == (0.5, 0.0, 0.0)
    assert tuple(GYM.get_camera_transform(sim, env, 1).p) == pytest.approx((1.5, 0.0, 0.0))
    # A location lets it go.
    GYM.set_camera_location(0, env, gymapi.Vec3(2, 0, 0), gymapi.Vec3(3, 0, 0))
    GYM.render_all_camera_sensors(sim)
    np.testing.assert_allclose(images[2].cpu(), -2.0, rtol=1e-5)


def test_quirks_of_the_simulation(device: wp.Device) -> None:
    sim = GYM.create_sim(device.ordinal if device.is_cuda else -1, -1, gymapi.SIM_PHYSX, quirks=True)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    box = GYM.create_box(sim, 1, 1, 1)
    GYM.create_actor(env, box, at(3, 0, 0))
    camera = GYM.create_camera_sensor(env)
    GYM.attach_camera_to_body(camera, env, 0, at(0, 1, 0), gymapi.FOLLOW_TRANSFORM)
    assert tuple(GYM.get_camera_transform(sim, env, camera).p) == (0.0, 1.0, 0.0)
    assert tuple(GYM.get_camera_transform(sim, env, camera, quirks=False).p) == (3.0, 1.0, 0.0)


def test_the_default_properties() -> None:
    default = gymapi.CameraProperties()
    assert (default.width, default.height, default.horizontal_fov) == (1600, 900, 90.0)
    assert (default.near_plane, default.far_plane) == (0.001, 2000000.0)
    assert (default.supersampling_horizontal, default.supersampling_vertical) == (1, 1)
    assert default.use_collision_geometry is False and default.enable_tensors is False
    with pytest.raises(wc.WarpcamError, match="CameraProperties has no 'heigth'; it has width, height"):
        default.heigth = 4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0}, "width must be a whole number of pixels, at least 1, got 0"),
        ({"horizontal_fov": 180.0}, r"horizontal_fov must be in \(0, 180\) degrees, got 180.0"),
        ({"near_plane": 3.0, "far_plane": 2.0}, "far_plane beyond it, got 3.0 and 2.0"),
        (
            {"supersampling_horizontal": 4},
            "supersampling of 4 x 1 came; allowed is 1 x 1 or 2 x 2 or 4 x 2 or 4 x 4 or 8 x 8",
        ),
    ],
)
def test_properties_that_no_camera_has(device: wp.Device, changes: dict[str, float], message: str) -> None:
    sim = new_sim(device)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    with pytest.raises(wc.WarpcamError, match=message):
        GYM.create_camera_sensor(env, props(**changes))


def test_calls_in_the_wrong_order_raise(device: wp.Device) -> None:
    world = walls(device, 2)
    sim, env = world.sim, world.envs[0]
    with pytest.raises(wc.WarpcamError, match="camera 0 of environment 0 has not been rendered yet"):
        GYM.get_camera_image(sim, env, 0, DEPTH)
    with pytest.raises(wc.WarpcamError, match="start_access_image_tensors was not called"):
        GYM.end_access_image_tensors(sim)
    world.render()
    GYM.start_access_image_tensors(sim)
    with pytest.raises(wc.WarpcamError, match="images are being read; call end_access_image_tensors"):
        GYM.render_all_camera_sensors(sim)
    with pytest.raises(wc.WarpcamError, match="called twice"):
        GYM.start_access_image_tensors(sim)
    GYM.end_access_image_tensors(sim)
    world.render()
    with pytest.raises(wc.WarpcamError, match="camera 4 came; environment 0 has 0"):
        GYM.get_camera_image(sim, env, 4, DEPTH)
    with pytest.raises(wc.WarpcamError, match=r"image type 9 came; allowed are IMAGE_COLOR, IMAGE_DEPTH"):
        GYM.get_camera_image(sim, env, 0, 9)
    with pytest.raises(wc.WarpcamError, match="body 3 came, environment 0 has 0 to 0"):
        GYM.attach_camera_to_body(0, env, 3, at(0, 0, 0), gymapi.FOLLOW_POSITION)
    with pytest.raises(wc.WarpcamError, match="the simulation is prepared already"):
        GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    host = GYM.create_camera_sensor(env, props(enable_tensors=False))
    with pytest.raises(wc.WarpcamError, match="camera 1 of environment 0 was created with enable_tensors False"):
        GYM.get_camera_image_gpu_tensor(sim, env, host, DEPTH)
    other = new_sim(device)
    with pytest.raises(wc.WarpcamError, match="environment 0 is of another simulation"):
        GYM.get_camera_image(other, env, 0, DEPTH)


def test_a_destroyed_camera_is_gone(device: wp.Device) -> None:
    world = walls(device, 2)
    world.render()
    kept = world.tensors[0][SEGMENTATION].clone()
    GYM.set_rigid_body_segmentation_id(world.envs[0], 0, 0, 99)
    GYM.destroy_camera_sensor(world.sim, world.envs[0], 0)
    for call in (
        lambda: GYM.get_camera_image(world.sim, world.envs[0], 0, DEPTH),
        lambda: GYM.set_camera_location(0, world.envs[0], gymapi.Vec3(), gymapi.Vec3(1, 0, 0)),
        lambda: GYM.destroy_camera_sensor(world.sim, world.envs[0], 0),
    ):
        with pytest.raises(wc.WarpcamError, match="camera 0 has been destroyed; environment 0 has none"):
            call()
    assert GYM.create_camera_sensor(world.envs[0], props()) == 1  # no handle is given twice
    GYM.set_camera_location(0, world.envs[1], gymapi.Vec3(-1, 0, 0), gymapi.Vec3(1, 0, 0))
    world.render()
    assert torch.equal(world.tensors[0][SEGMENTATION], kept)  # nobody writes there any more
    np.testing.assert_allclose(world.image(1, DEPTH), -3.1, rtol=1e-5)
    GYM.destroy_sim(world.sim)
    with pytest.raises(wc.WarpcamError, match="the simulation has been destroyed"):
        GYM.render_all_camera_sensors(world.sim)


def test_a_step_that_is_left_out_is_said_once(device: wp.Device) -> None:
    world = walls(device, 1)
    GYM.simulate(world.sim)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _ in range(3):
            GYM.render_all_camera_sensors(world.sim)
    texts = [str(one.message) for one in said if issubclass(one.category, RuntimeWarning)]
    assert len(texts) == 2
    assert "fetch_results was not called" in texts[0] and "step_graphics was not called" in texts[1]
    np.testing.assert_allclose(world.image(0, DEPTH), -2.0, rtol=1e-5)


def test_wrapping_is_free_and_never_none(device: wp.Device) -> None:
    world = walls(device, 1)
    described = GYM.get_camera_image_gpu_tensor(world.sim, world.envs[0], 0, COLOR)
    assert gymtorch.wrap_tensor(described) is gymtorch.wrap_tensor(described)
    part = gymtorch.wrap_tensor(described, offsets=(2, 0, 0), counts=(3, WIDTH, 4))
    assert part.shape == (3, WIDTH, 4) and part.data_ptr() == described.data_ptr + 2 * WIDTH * 4
    with pytest.raises(wc.WarpcamError, match="a tensor of gymapi is needed, got NoneType"):
        gymtorch.wrap_tensor(None)
    with pytest.raises(wc.WarpcamError, match="30 from 2 on are asked for in dimension 0, which has 24"):
        gymtorch.wrap_tensor(described, (2, 0, 0), (30, 1, 1))


def test_pictures_are_saved(device: wp.Device, tmp_path: Path) -> None:
    world = walls(device, 2, far_plane=2.05)
    world.render()
    for kind in (*KINDS, gymapi.IMAGE_OPTICAL_FLOW):
        path = tmp_path / f"{kind.name}.png"
        GYM.write_camera_image_to_file(world.sim, world.envs[0], 0, kind, str(path))
        with Image.open(path) as picture:
            assert picture.format == "PNG" and picture.size == (WIDTH, HEIGHT)
            assert np.asarray(picture).any()
    GYM.write_camera_image_to_file(world.sim, world.envs[1], 0, DEPTH, str(tmp_path / "far.png"))
    with Image.open(tmp_path / "far.png") as picture:
        assert not np.asarray(picture).any()


def test_calls_that_are_not_here_say_why(device: wp.Device) -> None:
    with pytest.raises(wc.WarpcamError, match=r"Gym\.create_viewer is not here: there is no window"):
        GYM.create_viewer(new_sim(device), gymapi.CameraProperties())
    with pytest.raises(AttributeError, match="Gym has no call 'create_veiwer'"):
        _ = GYM.create_veiwer
