"""Isaac Gym's looks: ids, colours, textures and lights of bodies, written at any time."""

from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp
from PIL import Image

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, HEIGHT, KINDS, WIDTH, World, at, new_sim, props, tensors_of, walls

from warpcam.compat.isaacgym import gymapi

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
COLOR, DEPTH, SEGMENTATION = KINDS
VISUAL, COLLISION, BOTH = gymapi.MESH_VISUAL, gymapi.MESH_COLLISION, gymapi.MESH_VISUAL_AND_COLLISION
PROXY = """
<robot name="proxy"><link name="base">
  <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><box size="1 9 9"/></geometry><material name="red"><color rgba="1 0 0 1"/></material></visual>
  <collision><geometry><box size="2 9 9"/></geometry></collision>
</link></robot>
"""


def lit_by_ambient(world: World, level: float = 1.0) -> None:
    """Every surface shows its own colour."""
    GYM.set_light_parameters(world.sim, 0, gymapi.Vec3(), gymapi.Vec3(level, level, level), gymapi.Vec3(0, 0, 1))


def test_colours_and_ids_round_trip_and_change_live(device: wp.Device) -> None:
    world = walls(device)
    lit_by_ambient(world)
    colors = [gymapi.Vec3(1, 0, 0), gymapi.Vec3(0, 1, 0), gymapi.Vec3(0, 0, 1)]
    for _ in range(2):
        for env, color in zip(world.envs, colors, strict=True):
            GYM.set_rigid_body_color(env, 0, 0, VISUAL, color)
            assert GYM.get_rigid_body_color(env, 0, 0, VISUAL) == color
            GYM.set_rigid_body_segmentation_id(env, 0, 0, int(10 + color.x + 2 * color.y))
        world.render()
        for index, color in enumerate(colors):
            shown = world.image(index, COLOR)[HEIGHT // 2, WIDTH // 2, :3]
            np.testing.assert_allclose(shown, 255 * np.array(tuple(color)), atol=1)
            ids = world.image(index, SEGMENTATION)
            assert (ids == GYM.get_rigid_body_segmentation_id(world.envs[index], 0, 0)).all()
        colors = colors[1:] + colors[:1]
    GYM.reset_actor_materials(world.envs[0], 0, BOTH)
    assert GYM.get_rigid_body_color(world.envs[0], 0, 0, VISUAL) not in colors
    with pytest.raises(wc.WarpcamError, match=r"color must be in \[0, 1\], got Vec3\(2.0"):
        GYM.set_rigid_body_color(world.envs[0], 0, 0, VISUAL, gymapi.Vec3(2, 0, 0))
    with pytest.raises(wc.WarpcamError, match="body 1 came, actor 'wall' has 0 to 0"):
        GYM.set_rigid_body_color(world.envs[0], 0, 1, VISUAL, gymapi.Vec3())
    with pytest.raises(wc.WarpcamError, match="actor 2 came, environment 0 has 0 to 0"):
        GYM.get_rigid_body_segmentation_id(world.envs[0], 2, 0)


def test_textures_of_files_and_buffers_times_colours(device: wp.Device, tmp_path: Path) -> None:
    world = walls(device)
    lit_by_ambient(world)
    path = tmp_path / "halves.png"
    Image.fromarray(np.repeat(np.array([[[255, 0, 0]], [[0, 0, 255]]], np.uint8), 2, axis=1)).save(path)
    halves = GYM.create_texture_from_file(world.sim, str(path))
    green = np.full((4, 8 * 4), 255, np.uint8).reshape(4, 8, 4)
    green[..., (0, 2)] = 0
    plain = GYM.create_texture_from_buffer(world.sim, 8, 4, green.reshape(4, 32))
    assert GYM.get_rigid_body_texture(world.envs[0], 0, 0, VISUAL) == gymapi.INVALID_HANDLE
    before = [tensors[COLOR].data_ptr() for tensors in world.tensors]
    for env in world.envs:
        GYM.set_rigid_body_color(env, 0, 0, VISUAL, gymapi.Vec3(1, 1, 1))
    world.render()
    assert (world.image(0, COLOR)[..., :3] > 250).all()
    GYM.set_rigid_body_texture(world.envs[0], 0, 0, VISUAL, halves)
    GYM.set_rigid_body_texture(world.envs[1], 0, 0, VISUAL, plain)
    GYM.set_rigid_body_color(world.envs[1], 0, 0, VISUAL, gymapi.Vec3(0.5, 0.5, 0.5))
    world.render()
    image = world.image(0, COLOR)[..., :3].astype(int)
    ends = [image[1].mean(0), image[-2].mean(0), image[:, 1].mean(0), image[:, -2].mean(0)]
    assert {int(np.argmax(end)) for end in ends} == {0, 2}
    shown = world.image(1, COLOR)[HEIGHT // 2, WIDTH // 2]
    assert shown[1] == pytest.approx(128, abs=3) and shown[0] == shown[2] == 0
    assert (world.image(2, COLOR)[..., :3] > 250).all()
    np.testing.assert_allclose(world.image(2, DEPTH), -2.2, rtol=1e-5)
    assert GYM.get_rigid_body_texture(world.envs[0], 0, 0, VISUAL) == halves
    assert [tensors[COLOR].data_ptr() for tensors in world.tensors] == before
    # Once a shape has had a texture, another one is only a number: nothing is built again.
    scene = world.sim.camera_batches._renderers[0].view.scene
    GYM.set_rigid_body_texture(world.envs[1], 0, 0, VISUAL, halves)
    GYM.set_rigid_body_texture(world.envs[0], 0, 0, VISUAL, plain)
    world.render()
    assert world.sim.camera_batches._renderers[0].view.scene is scene
    assert (np.argmax(world.image(0, COLOR)[..., :3], axis=-1) == 1).all()
    np.testing.assert_allclose(world.image(1, COLOR)[..., :3], np.round(image / 2.0), atol=40)
    assert set(np.unique(np.argmax(world.image(1, COLOR)[..., :3], axis=-1))) == {0, 2}
    GYM.set_rigid_body_texture(world.envs[0], 0, 0, VISUAL, halves)
    GYM.reset_actor_materials(world.envs[1], 0, VISUAL)
    world.render()
    assert world.sim.camera_batches._renderers[0].view.scene is scene
    np.testing.assert_array_equal(world.image(0, COLOR)[..., :3], image)
    assert (np.ptp(world.image(1, COLOR)[..., :3].reshape(-1, 3), axis=0) == 0).all()
    with pytest.raises(wc.WarpcamError, match="texture 0 is on actor 'wall' of environment 0"):
        GYM.free_texture(world.sim, halves)
    GYM.reset_actor_materials(world.envs[0], 0, VISUAL)
    GYM.free_texture(world.sim, halves)
    with pytest.raises(wc.WarpcamError, match="texture 0 came, there are 1"):
        GYM.set_rigid_body_texture(world.envs[0], 0, 0, VISUAL, halves)
    GYM.set_rigid_body_texture(world.envs[0], 0, 0, VISUAL, plain)
    world.render()
    assert world.image(0, COLOR)[HEIGHT // 2, WIDTH // 2, 1] > world.image(0, COLOR)[HEIGHT // 2, WIDTH // 2, 0]


def test_textures_that_cannot_be_made(device: wp.Device, tmp_path: Path) -> None:
    sim = new_sim(device)
    with pytest.raises(wc.WarpcamError, match=r"none\.png' cannot be read"):
        GYM.create_texture_from_file(sim, str(tmp_path / "none.png"))
    with pytest.raises(wc.WarpcamError, match="64 numbers of uint8 are needed, got 32 of uint8"):
        GYM.create_texture_from_buffer(sim, 4, 4, np.zeros(32, np.uint8))


def test_lights_change_live(device: wp.Device) -> None:
    world = walls(device)
    for env in world.envs:
        GYM.set_rigid_body_color(env, 0, 0, VISUAL, gymapi.Vec3(1, 1, 1))

    def shown(*lights: tuple[gymapi.Vec3, gymapi.Vec3, gymapi.Vec3]) -> np.ndarray:
        for index, light in enumerate(lights):
            GYM.set_light_parameters(world.sim, index, *light)
        world.render()
        return world.image(1, COLOR)[HEIGHT // 2, WIDTH // 2, :3].astype(int)

    dark, red, blue = gymapi.Vec3(), gymapi.Vec3(0.6, 0, 0), gymapi.Vec3(0, 0, 0.6)
    towards, away = gymapi.Vec3(-1, 0, 0), gymapi.Vec3(1, 0, 0)  # the wall faces -x
    seen = shown((red, dark, towards))
    assert seen[0] > 150 and seen[1] < 60 and seen[2] < 60
    assert (shown((red, dark, away)) < 5).all()
    assert shown((red, blue, away))[2] > 150
    seen = shown((red, dark, towards), (blue, dark, towards))
    assert seen[0] > 150 and seen[2] > 150
    with pytest.raises(wc.WarpcamError, match="index must be 0 to 3, got 4"):
        GYM.set_light_parameters(world.sim, 4, red, dark, towards)

    # Of no direction, as programs switch lights off, or have the ambient part alone.
    seen = shown((red, gymapi.Vec3(0, 0.6, 0), dark), (dark, dark, dark))
    assert seen[1] > 150 and seen[0] < 5 and seen[2] < 5


def test_what_collides_is_seen_only_by_cameras_that_ask_for_it(device: wp.Device, tmp_path: Path) -> None:
    (tmp_path / "proxy.urdf").write_text(PROXY)
    sim = new_sim(device)
    asset = GYM.load_asset(sim, str(tmp_path), "proxy.urdf", gymapi.AssetOptions(fix_base_link=True))
    images: dict[bool, list[torch.Tensor]] = {False: [], True: []}
    for index in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        actor = GYM.create_actor(env, asset, at(3.5, 0, 0), "proxy", 0, 0, 4 + index)
        assert GYM.get_rigid_body_color(env, actor, 0, VISUAL) == gymapi.Vec3(1, 0, 0)
        for colliders in (False, True):
            camera = GYM.create_camera_sensor(env, props(use_collision_geometry=colliders))
            GYM.set_camera_transform(camera, env, gymapi.Transform())
            tensors = tensors_of(sim, env, camera, (DEPTH, SEGMENTATION))
            images[colliders].append(tensors[DEPTH])
            assert tensors[SEGMENTATION].shape == (HEIGHT, WIDTH)
    GYM.render_all_camera_sensors(sim)
    for index in range(2):
        np.testing.assert_allclose(images[False][index].cpu(), -3.0, rtol=1e-5)
        np.testing.assert_allclose(images[True][index].cpu(), -2.5, rtol=1e-5)


def test_supersampling_smooths_edges_of_colour_alone(device: wp.Device) -> None:
    sim = new_sim(device)
    box = GYM.create_box(sim, 0.5, 0.5, 0.5, gymapi.AssetOptions(fix_base_link=True))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    pose = gymapi.Transform(gymapi.Vec3(2, 0, 0), gymapi.Quat.from_axis_angle(gymapi.Vec3(1, 0, 0), 0.3))
    GYM.create_actor(env, box, pose, "box", 0, 0, 1)
    images = []
    for samples in (1, 2):
        camera = GYM.create_camera_sensor(env, props(supersampling_horizontal=samples, supersampling_vertical=samples))
        GYM.set_camera_transform(camera, env, gymapi.Transform())
        images.append(tensors_of(sim, env, camera))
    GYM.render_all_camera_sensors(sim)
    assert torch.equal(images[0][DEPTH], images[1][DEPTH])
    levels = [len(np.unique(image[COLOR][..., 0].cpu().numpy())) for image in images]
    assert levels[1] > levels[0]


def test_ground_has_the_id_that_it_is_given(device: wp.Device) -> None:
    sim = new_sim(device)
    GYM.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1), distance=0.5, segmentation_id=77))
    corners = np.array(((2, -9, -9), (2, 9, -9), (2, 0, 20)), np.float32)
    terrain = gymapi.TriangleMeshParams(segmentation_id=78)
    terrain.transform.p.x = 1.0
    GYM.add_triangle_mesh(sim, corners.flatten(), np.array((0, 2, 1), np.uint32), terrain)
    images = []
    for _ in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(-5, -5, 0), gymapi.Vec3(5, 5, 0), 1)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 30, 0))
        camera = GYM.create_camera_sensor(env, props())
        GYM.set_camera_location(camera, env, gymapi.Vec3(), gymapi.Vec3(1, 0, 0))
        images.append(tensors_of(sim, env, camera, (DEPTH, SEGMENTATION)))
    GYM.render_all_camera_sensors(sim)
    ids = [image[SEGMENTATION].cpu().numpy() for image in images]
    assert (ids[0][-1] == 77).all() and (ids[1][-1] == 77).all()
    assert ids[0][HEIGHT // 2 - 1, WIDTH // 2] == 78
    assert images[0][DEPTH][HEIGHT // 2 - 1, WIDTH // 2].item() == pytest.approx(-3.0, rel=1e-5)
    # The terrain stands in the frame that all share: it is elsewhere as seen from the second.
    assert tuple(GYM.get_env_origin(GYM.get_env(sim, 1))) == (0.0, 10.0, 0.0)
    assert not (ids[1][HEIGHT // 2 - 1, WIDTH // 2] == 78) or (ids[0] != ids[1]).any()
