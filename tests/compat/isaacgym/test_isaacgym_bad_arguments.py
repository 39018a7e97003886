"""Arguments that no call of Isaac Gym's can use: each is named where it is given, and nothing is taken for another."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")

from gym_worlds import GYM, World, at, new_sim, props, walls

from warpcam.compat.isaacgym import gymapi, gymtorch

VISUAL = gymapi.MESH_VISUAL
NAN = float("nan")
ZEROS = (gymapi.Vec3(), gymapi.Vec3(0, 0, 1))
KINDS = "allowed are MESH_NONE, MESH_COLLISION, MESH_VISUAL, MESH_VISUAL_AND_COLLISION"
PIXELS = np.zeros(16, np.uint8)

# What is said of a call; of an environment with an actor 0 and a camera 0.
LOOKS: dict[str, Callable[[Any, Any], Any]] = {
    "set_rigid_body_segmentation_id: a whole number from 0 to 2^32 - 1 is needed, got 1.7": lambda sim, env: (
        GYM.set_rigid_body_segmentation_id(env, 0, 0, 1.7)
    ),
    "set_rigid_body_segmentation_id: a whole number from 0 to 2^32 - 1 is needed, got None": lambda sim, env: (
        GYM.set_rigid_body_segmentation_id(env, 0, 0, None)
    ),
    f"reset_actor_materials: mesh type 77 came; {KINDS}": lambda sim, env: GYM.reset_actor_materials(env, 0, 77),
    f"set_rigid_body_color: mesh type 'all' came; {KINDS}": lambda sim, env: GYM.set_rigid_body_color(
        env, 0, 0, "all", gymapi.Vec3()
    ),
    "set_rigid_body_texture: texture [7] came, there are none": lambda sim, env: GYM.set_rigid_body_texture(
        env, 0, 0, VISUAL, [7]
    ),
    "free_texture: there is no texture [1]": lambda sim, env: GYM.free_texture(sim, [1]),
    "create_texture_from_file: 'None' cannot be read": lambda sim, env: GYM.create_texture_from_file(sim, None),
    "create_texture_from_buffer: width must be a whole number of pixels, at least 1, got -2": lambda sim, env: (
        GYM.create_texture_from_buffer(sim, -2, -2, PIXELS)
    ),
    "create_texture_from_buffer: height must be a whole number of pixels, at least 1, got '2'": lambda sim, env: (
        GYM.create_texture_from_buffer(sim, 2, "2", PIXELS)
    ),
    "set_light_parameters: intensity must not be negative, got Vec3(-1.0, 0.0, 0.0)": lambda sim, env: (
        GYM.set_light_parameters(sim, 0, gymapi.Vec3(-1, 0, 0), *ZEROS)
    ),
    "set_light_parameters: ambient must not be negative, got Vec3(0.0, -1.0, 0.0)": lambda sim, env: (
        GYM.set_light_parameters(sim, 0, gymapi.Vec3(), gymapi.Vec3(0, -1, 0), gymapi.Vec3(0, 0, 1))
    ),
}
CAMERAS: dict[str, Callable[[Any, Any], Any]] = {
    "set_camera_location: position must be a Vec3, got 'ab'": lambda sim, env: GYM.set_camera_location(
        0, env, "ab", gymapi.Vec3()
    ),
    "set_camera_location: target must be finite, got Vec3(nan, 0.0, 0.0)": lambda sim, env: GYM.set_camera_location(
        0, env, gymapi.Vec3(), gymapi.Vec3(NAN, 0, 0)
    ),
    "set_camera_transform: transform must be a Transform, got NoneType": lambda sim, env: GYM.set_camera_transform(
        0, env, None
    ),
    "set_camera_transform: transform must be finite, its rotation not of length 0, got": lambda sim, env: (
        GYM.set_camera_transform(0, env, gymapi.Transform(r=gymapi.Quat(0, 0, 0, 0)))
    ),
    "attach_camera_to_body: local_transform must be a Transform, got Vec3": lambda sim, env: GYM.attach_camera_to_body(
        0, env, 0, gymapi.Vec3(), gymapi.FOLLOW_TRANSFORM
    ),
    "attach_camera_to_body: mode 9 came; allowed are FOLLOW_POSITION, FOLLOW_TRANSFORM": lambda sim, env: (
        GYM.attach_camera_to_body(0, env, 0, at(0, 0, 0), 9)
    ),
    "CameraProperties.horizontal_fov must be a number, got 'wide'": lambda sim, env: GYM.create_camera_sensor(
        env, props(horizontal_fov="wide")
    ),
    "CameraProperties.near_plane must be a number, got None": lambda sim, env: GYM.create_camera_sensor(
        env, props(near_plane=None)
    ),
}


def states(sim: Any, indices: torch.Tensor, count: Any) -> None:
    roots = gymtorch.unwrap_tensor(torch.zeros(1, 13))
    GYM.set_actor_root_state_tensor_indexed(sim, roots, gymtorch.unwrap_tensor(indices), count)


COUNT = "set_actor_root_state_tensor_indexed: count"
STATES: dict[str, Callable[[Any, Any], Any]] = {
    f"{COUNT} must be a whole number, from 0 to the 1 indices, got 4": lambda sim, env: states(
        sim, torch.zeros(1, dtype=torch.int32), 4
    ),
    f"{COUNT} must be a whole number, from 0 to the 1 indices, got None": lambda sim, env: states(
        sim, torch.zeros(1, dtype=torch.int32), None
    ),
}


@pytest.fixture(scope="module")
def world() -> World:
    return walls(wp.get_device("cpu"), 1)


@pytest.mark.parametrize("message", [*LOOKS, *CAMERAS, *STATES])
def test_what_cannot_be_used_is_named(world: World, message: str) -> None:
    call = {**LOOKS, **CAMERAS, **STATES}[message]
    with pytest.raises(wc.WarpcamError) as caught:
        call(world.sim, world.envs[0])
    assert message in str(caught.value)


def test_no_indices_move_nothing(world: World) -> None:
    before = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(world.sim)).clone()
    states(world.sim, torch.zeros(0, dtype=torch.int32), 0)
    GYM.refresh_actor_root_state_tensor(world.sim)
    assert torch.equal(gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(world.sim)), before)


def test_scalars_of_all_kinds_are_numbers(world: World) -> None:
    sim, env = world.sim, world.envs[0]
    for scalar in (np.array, torch.tensor, np.int64):
        GYM.set_rigid_body_segmentation_id(env, 0, 0, scalar(3))
        assert env.actor(0, "").segments[0] == 3
        states(sim, torch.zeros(0, dtype=torch.int32), scalar(0))
        assert GYM.get_actor_name(GYM.get_env(sim, scalar(0)), scalar(0)) == "wall"
        GYM.set_camera_location(scalar(0), env, *ZEROS)
        GYM.attach_camera_to_body(scalar(0), env, scalar(0), at(-3, 0, 0), gymapi.FOLLOW_POSITION)
        GYM.render_all_camera_sensors(sim)
        assert GYM.get_camera_image(sim, env, scalar(0), scalar(int(gymapi.IMAGE_DEPTH))).dtype == np.float32
    other = new_sim(wp.get_device("cpu"))
    for scalar in (np.array, torch.tensor, np.float32):
        GYM.create_box(other, scalar(1.0), 1, 1, None)
        GYM.create_camera_sensor(GYM.create_env(other, *ZEROS, 1), props(horizontal_fov=scalar(60.0)))


def test_what_nothing_can_be_made_of_is_named() -> None:
    sim = new_sim(wp.get_device("cpu"))
    box = GYM.create_box(sim, 1, 1, 1, None)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    mistakes: dict[str, Callable[[], Any]] = {
        "create_sim: type 7 came; allowed are SIM_PHYSX, SIM_FLEX": lambda: GYM.create_sim(-1, -1, 7, None),
        "create_env: lower must be a Vec3, got NoneType": lambda: GYM.create_env(sim, None, gymapi.Vec3(), 1),
        "create_box: width must be positive and finite, got 'a'": lambda: GYM.create_box(sim, "a", 1, 1, None),
        "create_box: options must be AssetOptions, got int": lambda: GYM.create_box(sim, 1, 1, 1, 3),
        "load_asset: a folder and a file in it are needed, got None and 'arm.xml'": lambda: GYM.load_asset(
            sim, None, "arm.xml"
        ),
        "create_sim: compute_device must be a CUDA ordinal, or -1, got None": lambda: GYM.create_sim(None, 0),
        "create_env: num_per_row must be a whole number, got None": lambda: GYM.create_env(
            sim, gymapi.Vec3(), gymapi.Vec3(), None
        ),
        "get_env: environment -1 came, there are 0 to 0": lambda: GYM.get_env(sim, -1),
        "get_asset_dof_count: an asset is needed, got NoneType": lambda: GYM.get_asset_dof_count(None),
        "get_asset_rigid_body_name: index 1 came, the asset has 1": lambda: GYM.get_asset_rigid_body_name(box, 1),
        "get_rigid_transform: body 0 came, environment 0 has none": lambda: GYM.get_rigid_transform(env, 0),
        "set_actor_dof_position_targets: actor 0 came, environment 0 has none": lambda: (
            GYM.set_actor_dof_position_targets(env, 0, [1.0])
        ),
        "create_sphere: radius must be positive and finite, got inf": lambda: GYM.create_sphere(
            sim, float("inf"), None
        ),
        "create_actor: segmentationId: a whole number from 0 to 2^32 - 1 is needed, got 0.5": lambda: GYM.create_actor(
            env, box, at(0, 0, 0), "box", 0, 0, 0.5
        ),
    }
    for message, call in mistakes.items():
        with pytest.raises(wc.WarpcamError) as caught:
            call()
        assert message in str(caught.value)


@pytest.mark.parametrize("prepared", [False, True])
def test_targets_that_are_no_numbers_are_named(prepared: bool) -> None:
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_box(sim, 1, 1, 1, None), at(0, 0, 0), "box")
    if prepared:
        GYM.prepare_sim(sim)
    given = (["a"], "ab", [[1.0], [1.0, 2.0]], [1.0], None, torch.zeros(2), torch.zeros(0, device="meta"), [1j], {})
    for name in ("set_actor_dof_position_targets", "set_actor_dof_velocity_targets"):
        for values in given:
            with pytest.raises(wc.WarpcamError, match=f"{name}: 0 numbers are needed, got "):
                getattr(GYM, name)(env, 0, values)
        assert getattr(GYM, name)(env, 0, torch.zeros(0))


def test_a_picture_that_cannot_be_saved_is_named(world: World, tmp_path: Path) -> None:
    world.render()
    path = str(tmp_path / "nowhere" / "depth.png")
    with pytest.raises(wc.WarpcamError, match=r"write_camera_image_to_file: '.*depth\.png' cannot be written: No such"):
        GYM.write_camera_image_to_file(world.sim, world.envs[0], 0, gymapi.IMAGE_DEPTH, path)
