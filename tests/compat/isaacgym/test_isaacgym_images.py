"""Isaac Gym's images: shapes, signs, encodings, addresses, and what an environment's camera sees."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, HEIGHT, KINDS, WIDTH, at, new_sim, ordinal, props, tensors_of, walls

from warpcam.compat.isaacgym import gymapi, gymtorch

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
COLOR, DEPTH, SEGMENTATION = KINDS


def test_tensors_have_shapes_dtypes_and_one_address(device: wp.Device) -> None:
    world = walls(device)
    addresses = [[tensor.data_ptr() for tensor in tensors.values()] for tensors in world.tensors]
    for _ in range(3):
        world.render()
    for env, camera, tensors, before in zip(world.envs, world.cameras, world.tensors, addresses, strict=True):
        assert tensors[COLOR].shape == (HEIGHT, WIDTH, 4) and tensors[COLOR].dtype == torch.uint8
        assert tensors[DEPTH].shape == (HEIGHT, WIDTH) and tensors[DEPTH].dtype == torch.float32
        assert tensors[SEGMENTATION].shape == (HEIGHT, WIDTH) and tensors[SEGMENTATION].dtype == torch.int32
        assert all(str(tensor.device) == wp.device_to_torch(device) for tensor in tensors.values())
        again = tensors_of(world.sim, env, camera)
        assert [again[kind].data_ptr() for kind in KINDS] == before
        described = GYM.get_camera_image_gpu_tensor(world.sim, env, camera, DEPTH)
        assert described.data_ptr == before[1] and described.shape == [HEIGHT, WIDTH]
        assert described.device == ordinal(device) and described.dtype == gymapi.DTYPE_FLOAT32
    stacked = torch.stack([tensors[DEPTH] for tensors in world.tensors])
    assert stacked.shape == (3, HEIGHT, WIDTH)


def test_a_tensor_that_is_requested_after_a_render_holds_that_frame(device: wp.Device) -> None:
    """Some programs request tensors between the render and their first reading."""
    world, late = walls(device), walls(device, tensors=False)
    for frame in range(2):
        world.render()
        late.render()
        for env, camera, tensors in zip(late.envs, late.cameras, world.tensors, strict=True):
            again = tensors_of(late.sim, env, camera)
            for kind in KINDS:
                assert torch.equal(again[kind], tensors[kind]) and (kind != DEPTH or again[kind].max() < 0.0), frame
    flow = tensors_of(late.sim, late.envs[0], late.cameras[0], (gymapi.IMAGE_OPTICAL_FLOW,))
    assert not flow[gymapi.IMAGE_OPTICAL_FLOW].any()
    assert len(late.sim.camera_batches._renderers) == 1  # what drew them at first is let go at the next render


def test_depth_is_negative_and_planar_in_each_environment(device: wp.Device) -> None:
    world = walls(device)
    world.render()
    for index in range(3):
        np.testing.assert_allclose(world.image(index, DEPTH), -2.0 - 0.1 * index, rtol=1e-5)
        assert (world.image(index, SEGMENTATION) == 7 + index).all()
        assert (world.image(index, COLOR)[..., 3] == 255).all()


def test_beyond_the_far_plane_and_before_the_near_one_nothing_is_seen(device: wp.Device) -> None:
    world = walls(device, 2, far_plane=2.05)
    world.render()
    assert np.isfinite(world.image(0, DEPTH)).all() and np.isneginf(world.image(1, DEPTH)).all()
    assert (world.image(1, SEGMENTATION) == 0).all()
    world = walls(device, 2, near_plane=2.05)
    world.render()
    assert (world.image(0, DEPTH) < -2.9).all()  # from inside its back is seen, or nothing
    np.testing.assert_allclose(world.image(1, DEPTH), -2.1, rtol=1e-5)


def test_environments_lie_apart_and_do_not_see_each_other(device: wp.Device) -> None:
    near, far = walls(device, spacing=0.5), walls(device, spacing=500.0)
    near.render()
    far.render()
    for kind in KINDS:
        for env in range(3):
            np.testing.assert_array_equal(near.image(env, kind), far.image(env, kind))


def test_the_horizontal_field_of_view_is_of_the_whole_width(device: wp.Device) -> None:
    sim = new_sim(device)
    post = GYM.create_box(sim, 0.5, 1.0, 9.0, gymapi.AssetOptions(fix_base_link=True))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, post, at(2.25, 0, 0), "post", 0, 0, 1)
    camera = GYM.create_camera_sensor(env, props(width=200, height=10, horizontal_fov=60.0))
    image = tensors_of(sim, env, camera, (SEGMENTATION,))[SEGMENTATION]
    GYM.set_camera_transform(camera, env, gymapi.Transform())
    GYM.render_all_camera_sensors(sim)
    expected = 200 * 0.5 / (2.0 * np.tan(np.radians(30.0)))  # its face, 1 m wide, is 2 m away
    assert abs(int(image[5].sum()) - expected) <= 1.0


def test_images_on_the_host_have_that_systems_shapes(device: wp.Device) -> None:
    tensors, host = walls(device), walls(device, enable_tensors=False)
    tensors.render()
    host.render()
    dtypes = {COLOR: np.uint8, DEPTH: np.float32, SEGMENTATION: np.uint32}
    for kind in KINDS:
        for env in range(3):
            image = GYM.get_camera_image(host.sim, host.envs[env], host.cameras[env], kind)
            assert image.dtype == dtypes[kind]
            assert image.shape == (HEIGHT, 4 * WIDTH if kind == COLOR else WIDTH)
            np.testing.assert_array_equal(image.reshape(-1), tensors.image(env, kind).reshape(-1))
            same = GYM.get_camera_image(tensors.sim, tensors.envs[env], tensors.cameras[env], kind)
            np.testing.assert_array_equal(image, same)
            image[:] = 0  # a copy: nobody else's is changed
    world, env = host, host.envs[1]
    GYM.set_rigid_body_segmentation_id(env, 0, 0, 2**32 - 5)
    world.render()
    assert (GYM.get_camera_image(world.sim, env, 0, SEGMENTATION) == 2**32 - 5).all()


def test_images_on_the_host_are_those_of_the_last_render(device: wp.Device) -> None:
    world = walls(device, 1, fixed=False, enable_tensors=False)
    world.render()
    first = GYM.get_camera_image(world.sim, world.envs[0], 0, DEPTH)
    states = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(world.sim))
    states[0, 0] += 1.0
    GYM.set_actor_root_state_tensor(world.sim, gymtorch.unwrap_tensor(states))
    np.testing.assert_array_equal(GYM.get_camera_image(world.sim, world.envs[0], 0, DEPTH), first)
    world.render()
    np.testing.assert_allclose(GYM.get_camera_image(world.sim, world.envs[0], 0, DEPTH), first - 1.0, rtol=1e-5)


def test_cameras_of_one_size_are_one_camera_of_one_renderer(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    class Counting(wc.Renderer):
        def __init__(self, scene: Any, cameras: Any, **options: Any) -> None:
            made.append((scene.num_worlds, [camera.width for camera in cameras]))
            super().__init__(scene, cameras, **options)

    monkeypatch.setattr(wc, "Renderer", Counting)
    world = walls(device, 5)
    world.render()
    world.render()
    assert made == [(5, [WIDTH])]
    # One more in a single environment: only that world is drawn for it.
    extra = GYM.create_camera_sensor(world.envs[3], props(width=16, height=16))
    GYM.set_camera_location(extra, world.envs[3], gymapi.Vec3(0.5, 0, 0), gymapi.Vec3(1, 0, 0))
    image = tensors_of(world.sim, world.envs[3], extra, (DEPTH,))[DEPTH]
    world.render()
    assert made == [(5, [WIDTH]), (1, [16])]
    np.testing.assert_allclose(image.cpu(), -1.8, rtol=1e-5)
    np.testing.assert_allclose(world.image(4, DEPTH), -2.4, rtol=1e-5)


def test_two_cameras_of_an_environment_and_lenses_that_differ(device: wp.Device) -> None:
    sim = new_sim(device)
    wall = GYM.create_box(sim, 1.0, 4.0, 4.0, gymapi.AssetOptions(fix_base_link=True))
    images = []
    for fov, far in ((40.0, 9.0), (90.0, 1.0)):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        GYM.create_actor(env, wall, at(2.5, 0, 0), "wall", 0, 0, 1)
        for back in (0.0, 1.0):
            camera = GYM.create_camera_sensor(env, props(horizontal_fov=fov, far_plane=far))
            GYM.set_camera_location(camera, env, gymapi.Vec3(-back, 0, 0), gymapi.Vec3(1, 0, 0))
            images.append(tensors_of(sim, env, camera, (DEPTH,))[DEPTH])
    GYM.render_all_camera_sensors(sim)
    assert [view.scene.num_worlds for view in sim.camera_batches._views.values()] == [2]
    depths = [image.cpu().numpy() for image in images]
    np.testing.assert_allclose(depths[0], -2.0, rtol=1e-5)
    np.testing.assert_allclose(depths[1], -3.0, rtol=1e-5)
    assert np.isneginf(depths[2]).all() and np.isneginf(depths[3]).all()


def test_a_tensor_asked_for_late_is_written_too(device: wp.Device) -> None:
    sim = new_sim(device)
    box = GYM.create_box(sim, 1, 9, 9, gymapi.AssetOptions(fix_base_link=True))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, box, at(2.5, 0, 0), "box", 0, 0, 3)
    camera = GYM.create_camera_sensor(env, props())
    depth = tensors_of(sim, env, camera, (DEPTH,))[DEPTH]
    GYM.render_all_camera_sensors(sim)
    ids = tensors_of(sim, env, camera, (SEGMENTATION,))[SEGMENTATION]
    np.testing.assert_array_equal(GYM.get_camera_image(sim, env, camera, SEGMENTATION), 3)
    GYM.render_all_camera_sensors(sim)
    assert (ids == 3).all() and torch.allclose(depth, torch.full_like(depth, -2.0))


def test_memory_is_flat_over_cameras_that_come_and_go(device: wp.Device) -> None:
    world = walls(device, 2)
    world.render()
    studio = world.sim.camera_batches
    kept = (len(studio._renderers), len(studio._buffers), len(studio._views), len(studio._batches))
    for _ in range(3):
        extra = GYM.create_camera_sensor(world.envs[1], props(width=16, height=16))
        tensors_of(world.sim, world.envs[1], extra, (DEPTH,))
        world.render()
        GYM.get_camera_image(world.sim, world.envs[1], extra, SEGMENTATION)
        GYM.destroy_camera_sensor(world.sim, world.envs[1], extra)
    assert (len(studio._renderers), len(studio._buffers), len(studio._views), len(studio._batches)) == kept
    assert not studio._later
    world.render()


def test_flow_is_coded_in_parts_of_the_image(device: wp.Device) -> None:
    flow = gymapi.IMAGE_OPTICAL_FLOW
    world = walls(device, 2, fixed=False)
    images = [
        tensors_of(world.sim, env, camera, (flow,))[flow] for env, camera in zip(world.envs, world.cameras, strict=True)
    ]
    world.render()
    states = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(world.sim))
    states[:, 1] += 0.1  # to the left
    GYM.set_actor_root_state_tensor(world.sim, gymtorch.unwrap_tensor(states))
    world.render()
    for env, image in enumerate(images):
        assert image.shape == (HEIGHT, WIDTH, 2) and image.dtype == torch.int16
        pixels = -0.1 / (2.0 + 0.1 * env) * WIDTH / 2.0
        middle = image[HEIGHT // 2, WIDTH // 2].cpu().numpy().astype(float)
        np.testing.assert_allclose(middle[0] * WIDTH / 2**15, pixels, atol=2e-3)
        np.testing.assert_allclose(middle[1] * HEIGHT / 2**15, 0.0, atol=2e-3)
    # Programs add the last dimension themselves.
    described = GYM.get_camera_image_gpu_tensor(world.sim, world.envs[1], world.cameras[1], flow)
    assert described.shape == [HEIGHT, WIDTH] and described.dtype == gymapi.DTYPE_INT16
    told = (described.data_ptr, described.device, int(described.dtype))
    shape = (*described.shape, 2)
    again = gymtorch.wrap_tensor_impl(*told, shape, (0, 0, 0), shape)
    assert again.data_ptr() == images[1].data_ptr() and torch.equal(again, images[1])
    with pytest.raises(wc.WarpcamError, match=r"shape \(24, 32\) came, but there are 1536 numbers"):
        gymtorch.wrap_tensor_impl(*told, described.shape)
    with pytest.raises(wc.WarpcamError, match="no tensor of gymapi that is still there begins at 12"):
        gymtorch.wrap_tensor_impl(12, *told[1:], shape)
    host = GYM.get_camera_image(world.sim, world.envs[0], world.cameras[0], flow)
    assert host.shape == (HEIGHT, 2 * WIDTH) and host.dtype == np.int16


def test_flow_on_the_host_is_since_the_render_before(device: wp.Device) -> None:
    flow = gymapi.IMAGE_OPTICAL_FLOW
    world = walls(device, 1, fixed=False, enable_tensors=False)
    states = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(world.sim))
    seen = []
    for step in range(4):
        states[0, 1] += 0.1
        GYM.set_actor_root_state_tensor(world.sim, gymtorch.unwrap_tensor(states))
        world.render()
        if step != 2:
            image = GYM.get_camera_image(world.sim, world.envs[0], 0, flow).reshape(HEIGHT, WIDTH, 2)
            seen.append(image[HEIGHT // 2, WIDTH // 2, 0] * WIDTH / 2**15)
    np.testing.assert_allclose(seen, (0.0, -0.8, -0.8), atol=2e-3)


def write_plate(path: Any, points: np.ndarray) -> None:
    """A rectangle, by its corners, as a file of that kind."""
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 2, 1), (0, 3, 2)])  # from both sides
    if path.suffix == ".dae":
        collada = pytest.importorskip("collada")
        mesh = collada.Collada()
        mesh.assetInfo.upaxis = collada.asset.UP_AXIS.Z_UP
        source = collada.source.FloatSource("points", points.astype(np.float32).flatten(), ("X", "Y", "Z"))
        form = collada.geometry.Geometry(mesh, "form", "form", [source])
        inputs = collada.source.InputList()
        inputs.addInput(0, "VERTEX", "#points")
        form.primitives.append(form.createTriangleSet(faces.flatten(), inputs, "paint"))
        mesh.geometries.append(form)
        node = collada.scene.Node("one", [collada.scene.GeometryNode(form, [])])
        mesh.scene = collada.scene.Scene("all", [node])
        mesh.scenes.append(mesh.scene)
        mesh.write(str(path))
    else:
        pytest.importorskip("trimesh").Trimesh(points, faces, process=False).export(path)


@pytest.mark.parametrize("kind", ["obj", "stl", "dae"])
def test_meshes_whose_files_have_y_up_are_flipped(tmp_path: Path, kind: str) -> None:
    """Meshes that are only visible are flipped; .dae files say which axis is up."""
    along = 2 if kind == "dae" else 1  # up in the file
    corners = np.zeros((4, 3))
    corners[:, along], corners[:, 3 - along] = (0, 0, 0.9, 0.9), (-0.1, 0.1, 0.1, -0.1)
    for visible in ("seen", "felt"):
        write_plate(tmp_path / f"{visible}.{kind}", corners)
    mesh = '<{0}><origin xyz="0 0 0" rpy="0 0 0"/><geometry><mesh filename="{1}.{2}"/></geometry></{0}>'
    shapes = mesh.format("visual", "seen", kind) + mesh.format("collision", "felt", kind)
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "flag.urdf").write_text(f'<robot name="flag"><link name="flag">{inertia}{shapes}</link></robot>')
    sim = new_sim(wp.get_device("cpu"))
    seen = {}
    for flip in (False, True):
        options = gymapi.AssetOptions(flip_visual_attachments=flip, fix_base_link=True)
        asset = GYM.load_asset(sim, str(tmp_path), "flag.urdf", options)
        for colliders in (False, True):
            env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
            GYM.create_actor(env, asset, at(1.5, 0, 0), "flag", 0, 0, 5)
            camera = GYM.create_camera_sensor(env, props(use_collision_geometry=colliders))
            GYM.set_camera_transform(camera, env, gymapi.Transform())
            seen[flip, colliders] = env, camera
    GYM.render_all_camera_sensors(sim)
    for (flip, colliders), (env, camera) in seen.items():
        rows, columns = np.nonzero(GYM.get_camera_image(sim, env, camera, SEGMENTATION) == 5)
        if kind == "dae" or (flip and not colliders):
            assert abs(rows.max() - HEIGHT // 2) <= 1 and np.ptp(rows) > 3 * np.ptp(columns)  # upwards from the middle
        else:
            assert abs(columns.max() - WIDTH // 2) <= 1 and np.ptp(columns) > 3 * np.ptp(rows)  # y is to the left
