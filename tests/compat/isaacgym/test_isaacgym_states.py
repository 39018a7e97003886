"""Isaac Gym's assets, actors and states: what is set is seen at the next render, and what is simulated moves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from gym_worlds import GYM, KINDS, at, new_sim, props, tensors_of, walls, wrapped  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
COLOR, DEPTH, SEGMENTATION = KINDS
ARM = """
<mujoco model="arm">
  <worldbody>
    <body name="base">
      <geom type="box" size="0.1 0.1 0.1" mass="1"/>
      <body name="upper" pos="0 0 0.2">
        <joint name="swing" axis="0 0 1" range="-90 90"/>
        <joint name="lift" axis="0 1 0"/>
        <geom type="box" size="0.3 0.05 0.05" pos="0.3 0 0" mass="1"/>
        <body name="hand" pos="0.7 0 0">
          <joint name="reach" type="slide" axis="1 0 0" range="0 1"/>
          <geom type="box" size="0.05 0.4 0.4" mass="0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
CART = """
<robot name="cart">
  <link name="rail">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="cart">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
  </link>
  <joint name="slide" type="prismatic">
    <parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
  </joint>
</robot>
"""


def arms(device: wp.Device, folder: Path, count: int = 3) -> gymapi.Sim:
    (folder / "arm.xml").write_text(ARM)
    sim = new_sim(device)
    asset = GYM.load_asset(sim, str(folder), "arm.xml", gymapi.AssetOptions(fix_base_link=True))
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        GYM.create_actor(env, asset, at(0.1 * index, 0, 1), "arm", index, 0, 1)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 2, 1), "ball", index, 0, 2)
    return sim


def test_names_counts_and_places(device: wp.Device, tmp_path: Path) -> None:
    sim = arms(device, tmp_path)
    env = GYM.get_env(sim, 1)
    assert GYM.get_actor_rigid_body_names(env, 0) == ["base", "upper", "hand"]
    assert GYM.get_actor_dof_names(env, 0) == ["swing", "lift", "reach"]
    assert [GYM.get_asset_dof_type(GYM.get_actor_asset(env, 0), i).name for i in (0, 2)] == [
        "DOF_ROTATION",
        "DOF_TRANSLATION",
    ]
    limits = GYM.get_actor_dof_properties(env, 0)
    np.testing.assert_allclose(limits["upper"][[0, 2]], (0.5 * np.pi, 1.0), rtol=1e-5)
    assert limits["hasLimits"].tolist() == [True, False, True]
    assert (GYM.get_sim_rigid_body_count(sim), GYM.get_sim_dof_count(sim), GYM.get_sim_actor_count(sim)) == (12, 9, 6)
    for _ in range(2):  # before it is prepared, and after
        places = [
            GYM.find_actor_rigid_body_index(env, 1, "sphere", domain)
            for domain in (gymapi.DOMAIN_ACTOR, gymapi.DOMAIN_ENV, gymapi.DOMAIN_SIM)
        ]
        assert places == [0, 3, 7]
        assert GYM.get_actor_index(env, 1, gymapi.DOMAIN_SIM) == 3
        assert GYM.find_actor_dof_index(env, 0, "lift", gymapi.DOMAIN_SIM) == 4
        GYM.prepare_sim(sim)
    assert GYM.find_actor_handle(env, "ball") == 1 and GYM.find_actor_handle(env, "none") == gymapi.INVALID_HANDLE
    assert GYM.get_rigid_handle(env, "arm", "hand") == 2
    states = GYM.get_actor_rigid_body_states(env, 0, gymapi.STATE_ALL)
    assert states["pose"]["p"]["z"][1] == pytest.approx(1.2) and states["pose"]["p"]["x"][2] == pytest.approx(0.8)


def test_states_round_trip_and_move_bodies_at_once(device: wp.Device, tmp_path: Path) -> None:
    sim = arms(device, tmp_path)
    GYM.prepare_sim(sim)
    roots, bodies, dofs = (
        wrapped(acquire(sim))
        for acquire in (
            GYM.acquire_actor_root_state_tensor,
            GYM.acquire_rigid_body_state_tensor,
            GYM.acquire_dof_state_tensor,
        )
    )
    assert roots.shape == (6, 13) and bodies.shape == (12, 13) and dofs.shape == (9, 2)
    assert str(roots.device) == wp.device_to_torch(device)
    np.testing.assert_allclose(
        roots[:, :3].cpu(),
        [[0.1 * (i // 2), 2.0 * (i % 2), 1] if i % 2 == 0 else [0, 2, 1] for i in range(6)],
        atol=1e-6,
    )
    dofs.copy_(torch.tensor([[0.5, 0.1], [-0.3, 0.2], [0.25, 0.3]] * 3))
    given = dofs.clone()
    assert GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(dofs))
    dofs.zero_()
    GYM.refresh_dof_state_tensor(sim)
    torch.testing.assert_close(dofs, given)
    GYM.refresh_rigid_body_state_tensor(sim)
    hand = bodies[2].cpu().numpy()
    reach = 0.95  # along x of the upper body, lifted by -0.3 about y, turned by 0.5 about z
    along = np.cos(-0.3) * reach
    expected = (along * np.cos(0.5), along * np.sin(0.5), 1.2 - reach * np.sin(-0.3))
    np.testing.assert_allclose(hand[:3], expected, atol=1e-5)
    # Some actors only: the second ball, and the first base, which is fixed, too.
    roots[3, :3] = torch.tensor((4.0, 5.0, 6.0))
    roots[3, 7:] = torch.arange(6.0) + 1.0
    roots[0, :3] = torch.tensor((0.0, 0.0, 3.0))
    roots[5, :3] = 99.0  # is not asked for
    chosen = torch.tensor((3, 0, 5), dtype=torch.int32, device=roots.device)
    GYM.set_actor_root_state_tensor_indexed(sim, gymtorch.unwrap_tensor(roots), gymtorch.unwrap_tensor(chosen), 2)
    GYM.refresh_actor_root_state_tensor(sim)
    GYM.refresh_rigid_body_state_tensor(sim)
    np.testing.assert_allclose(bodies[7].cpu(), (4, 5, 6, 0, 0, 0, 1, 1, 2, 3, 4, 5, 6), atol=1e-5)
    np.testing.assert_allclose(roots[5, :3].cpu(), (0, 2, 1), atol=1e-6)
    np.testing.assert_allclose(bodies[2, :3].cpu(), np.add(expected, (0, 0, 2)), atol=1e-5)
    state = GYM.get_actor_dof_states(GYM.get_env(sim, 1), 0, gymapi.STATE_ALL)
    state["pos"][0] = -0.5
    GYM.set_actor_dof_states(GYM.get_env(sim, 1), 0, state, gymapi.STATE_POS)
    GYM.refresh_dof_state_tensor(sim)
    np.testing.assert_allclose(dofs[:, 0].cpu(), [0.5, -0.3, 0.25, -0.5, -0.3, 0.25, 0.5, -0.3, 0.25], atol=1e-6)


def test_actors_are_told_where_to_begin_while_environments_are_made(device: wp.Device, tmp_path: Path) -> None:
    """Place actors as programs do between two environments; values told and asked then are those simulated and seen."""
    (tmp_path / "arm.xml").write_text(ARM)
    sim = new_sim(device, dt=0.01, substeps=4)
    asset = GYM.load_asset(sim, str(tmp_path), "arm.xml", gymapi.AssetOptions(fix_base_link=True, disable_gravity=True))
    properties = GYM.get_asset_dof_properties(asset)
    properties["driveMode"], properties["stiffness"], properties["damping"] = gymapi.DOF_MODE_POS, 400.0, 40.0
    envs, hands, before, eyes = [], [], [], []
    states = np.zeros(3, gymapi.DofState.dtype)
    for index in range(3):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 2, 1), "ball", index, 0, 2)
        turn = gymapi.Quat.from_axis_angle(gymapi.Vec3(0, 0, 1), 0.3)
        turned = gymapi.Transform(gymapi.Vec3(0.1 * index, 0, 1), turn)
        arm = GYM.create_actor(env, asset, turned, "arm", index, 0, 1)
        GYM.set_actor_dof_properties(env, arm, properties)
        states["pos"], states["vel"] = (0.2 * index, -0.3, 0.25), 0.5
        assert GYM.set_actor_dof_states(env, arm, states, gymapi.STATE_POS)
        assert (GYM.get_actor_dof_states(env, arm)["pos"] == states["pos"]).all()
        assert not GYM.get_actor_dof_states(env, arm)["vel"].any()
        GYM.set_actor_dof_states(env, arm, states, gymapi.STATE_VEL)
        assert GYM.set_actor_dof_position_targets(env, arm, states["pos"] + 0.2)
        hands.append(GYM.find_actor_rigid_body_handle(env, arm, "hand"))
        before.append((GYM.get_rigid_transform(env, hands[-1]), GYM.get_actor_rigid_body_states(env, arm)))
        camera = GYM.create_camera_sensor(env, props())
        GYM.attach_camera_to_body(camera, env, hands[-1], at(-1, 0, 0), gymapi.FOLLOW_TRANSFORM)
        eyes.append(GYM.get_camera_transform(sim, env, camera))
        envs.append(env)
    GYM.prepare_sim(sim)
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim)).cpu().numpy()
    np.testing.assert_allclose(dofs[:, 0].reshape(3, 3), [(0.2 * i, -0.3, 0.25) for i in range(3)], atol=1e-6)
    np.testing.assert_allclose(dofs[:, 1], 0.5)
    for env, hand, eye, (transform, bodies) in zip(envs, hands, eyes, before, strict=True):
        now = GYM.get_rigid_transform(env, hand)
        np.testing.assert_allclose((*transform.p, *transform.r), (*now.p, *now.r), atol=1e-6)
        place = GYM.get_camera_transform(sim, env, 0)
        np.testing.assert_allclose((*eye.p, *eye.r), (*place.p, *place.r), atol=1e-6)
        after = GYM.get_actor_rigid_body_states(env, 1)
        np.testing.assert_allclose(bodies.view(np.float32), after.view(np.float32), atol=1e-5)
        assert np.abs(bodies["vel"]["angular"]["z"][1:]).min() > 0.1
    assert before[0][0].p.x != pytest.approx(before[2][0].p.x)
    for _ in range(60):
        GYM.simulate(sim)
    for index, env in enumerate(envs):
        reached = GYM.get_actor_dof_states(env, 1)["pos"]
        np.testing.assert_allclose(reached, (0.2 * index + 0.2, -0.1, 0.45), atol=0.02)
    GYM.set_actor_dof_position_targets(envs[1], 1, [0.0, 0.0, 0.0])  # later as well, of that one alone
    for _ in range(60):
        GYM.simulate(sim)
    np.testing.assert_allclose(GYM.get_actor_dof_states(envs[1], 1)["pos"], 0.0, atol=0.02)
    np.testing.assert_allclose(GYM.get_actor_dof_states(envs[2], 1)["pos"], (0.6, -0.1, 0.45), atol=0.02)


def test_speeds_of_one_actor_are_driven(device: wp.Device, tmp_path: Path) -> None:
    (tmp_path / "cart.urdf").write_text(CART)
    sim = new_sim(device, dt=0.01, substeps=4)
    asset = GYM.load_asset(sim, str(tmp_path), "cart.urdf", gymapi.AssetOptions(fix_base_link=True))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    cart = GYM.create_actor(env, asset, at(0, 0, 0), "cart")
    properties = GYM.get_actor_dof_properties(env, cart)
    properties["driveMode"], properties["damping"] = gymapi.DOF_MODE_VEL, 100.0
    GYM.set_actor_dof_properties(env, cart, properties)
    GYM.set_actor_dof_velocity_targets(env, cart, np.array([0.5]))
    for _ in range(100):
        GYM.simulate(sim)
    state = GYM.get_actor_dof_states(env, cart)
    assert state["vel"][0] == pytest.approx(0.5, abs=0.02) and 0.3 < state["pos"][0] < 0.5


def test_what_one_actor_is_told_is_brought_over_with_the_next_step(
    device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not at each call; and what is told later, to all or to one, is what counts."""
    (tmp_path / "cart.urdf").write_text(CART)
    sim = new_sim(device, dt=0.02)
    asset = GYM.load_asset(sim, str(tmp_path), "cart.urdf", gymapi.AssetOptions(fix_base_link=True))
    envs = [GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 3) for _ in range(3)]
    for env in envs:
        cart = GYM.create_actor(env, asset, at(0, 0, 1), "cart")
        drive = GYM.get_actor_dof_properties(env, cart)
        drive["driveMode"], drive["stiffness"], drive["damping"] = gymapi.DOF_MODE_POS, 200.0, 40.0
        GYM.set_actor_dof_properties(env, cart, drive)
    GYM.set_actor_dof_position_targets(envs[2], 0, [0.6])
    GYM.prepare_sim(sim)
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim))

    def tell(env: int, target: Any) -> None:
        with monkeypatch.context() as patch:
            for name in ("numpy", "assign"):
                patch.setattr(wp.array, name, None)
            assert GYM.set_actor_dof_position_targets(envs[env], 0, target)

    def reached() -> np.ndarray:
        for _ in range(60):
            GYM.simulate(sim)
        GYM.refresh_dof_state_tensor(sim)
        return dofs[:, 0].cpu().numpy()

    tell(0, torch.tensor((9.0,), device=dofs.device))
    tell(0, torch.tensor((0.5,), device=dofs.device, dtype=torch.bfloat16, requires_grad=True))
    tell(1, (-0.25,))
    np.testing.assert_allclose(reached(), (0.5, -0.25, 0.6), atol=0.05)
    tell(0, [9.0])
    GYM.set_dof_position_target_tensor(sim, gymtorch.unwrap_tensor(torch.tensor((0.1, 0.2, 0.3), device=dofs.device)))
    tell(1, np.array([0.0]))
    np.testing.assert_allclose(reached(), (0.1, 0.0, 0.3), atol=0.05)


def test_after_a_teleport_the_image_is_that_of_a_fresh_one(device: wp.Device) -> None:
    moved, fresh = walls(device, fixed=False), walls(device, fixed=False)
    moved.render()
    for world in (moved, fresh):
        states = wrapped(GYM.acquire_actor_root_state_tensor(world.sim))
        states[:, 0] += 0.7
        GYM.set_actor_root_state_tensor(world.sim, gymtorch.unwrap_tensor(states))
        world.render()
    for env in range(3):
        for kind in KINDS:
            np.testing.assert_array_equal(moved.image(env, kind), fresh.image(env, kind))
        np.testing.assert_allclose(moved.image(env, DEPTH), -2.7 - 0.1 * env, rtol=1e-5)


@pytest.mark.parametrize("solver", ["mujoco", "xpbd"])
def test_what_falls_is_seen_to_fall(
    device: wp.Device, solver: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    if solver == "xpbd":  # what is left where MuJoCo cannot

        def refuse(*_: Any, **__: Any) -> None:
            raise ImportError("mujoco")

        monkeypatch.setattr(newton.solvers, "SolverMuJoCo", refuse)
    sim = new_sim(device, dt=0.01, substeps=2)
    GYM.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1)))
    plate = GYM.create_box(sim, 1.0, 1.0, 0.2)
    still = GYM.create_box(sim, 1.0, 1.0, 0.2, gymapi.AssetOptions(disable_gravity=True))
    images = []
    for index in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        GYM.create_actor(env, plate, at(0, 0, 0.3 + 0.5 * index), "plate", 0, 0, 1)
        GYM.create_actor(env, still, at(0, 1.5, 0.3), "still", 0, 0, 1)
        for y in (0.0, 1.5):
            camera = GYM.create_camera_sensor(env, props(horizontal_fov=20.0))
            GYM.set_camera_location(camera, env, gymapi.Vec3(0, y, 3), gymapi.Vec3(0, y, 0))
            images.append(tensors_of(sim, env, camera, (DEPTH,))[DEPTH])

    def depths() -> np.ndarray:
        GYM.fetch_results(sim, True)
        GYM.step_graphics(sim)
        GYM.render_all_camera_sensors(sim)
        GYM.start_access_image_tensors(sim)
        seen = np.array([image.mean().item() for image in images])
        GYM.end_access_image_tensors(sim)
        return seen

    np.testing.assert_allclose(depths(), (-2.6, -2.6, -2.1, -2.6), rtol=1e-4)
    for _ in range(10):
        GYM.simulate(sim)
    assert GYM.get_sim_time(sim) == pytest.approx(0.1)
    fallen = 0.5 * 9.81 * 0.1**2
    np.testing.assert_allclose(depths(), (-2.6 - fallen, -2.6, -2.1 - fallen, -2.6), atol=0.01)
    for _ in range(60):
        GYM.simulate(sim)
    np.testing.assert_allclose(depths(), (-2.8, -2.6, -2.8, -2.6), atol=0.02)  # on the ground
    assert ("by XPBD, as MuJoCo cannot: " in caplog.text) == (solver == "xpbd")


def test_drives_move_joints(device: wp.Device, tmp_path: Path) -> None:
    (tmp_path / "cart.urdf").write_text(CART)
    sim = new_sim(device, dt=0.02)
    asset = GYM.load_asset(sim, str(tmp_path), "cart.urdf", gymapi.AssetOptions(fix_base_link=True))
    for _ in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 2)
        actor = GYM.create_actor(env, asset, at(0, 0, 1), "cart")
        drive = GYM.get_actor_dof_properties(env, actor)
        drive["driveMode"], drive["stiffness"], drive["damping"] = gymapi.DOF_MODE_POS, 200.0, 40.0
        GYM.set_actor_dof_properties(env, actor, drive)
    GYM.prepare_sim(sim)
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim))
    targets = torch.tensor((0.5, -0.25), device=dofs.device)
    GYM.set_dof_position_target_tensor(sim, gymtorch.unwrap_tensor(targets))
    for _ in range(60):
        GYM.simulate(sim)
    GYM.fetch_results(sim, True)
    GYM.refresh_dof_state_tensor(sim)
    np.testing.assert_allclose(dofs[:, 0].cpu(), targets.cpu(), atol=0.05)


def test_environments_may_differ(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    sim = new_sim(device, dt=0.01)
    images = []
    for index in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        if index:
            GYM.create_actor(env, GYM.create_sphere(sim, 0.5), at(2.5, 0, 0), "ball", 0, 0, 2)
        GYM.create_actor(env, GYM.create_box(sim, 1, 9, 9), at(3.5, 0, 0), "wall", 0, 0, 1)
        camera = GYM.create_camera_sensor(env, props())
        GYM.set_camera_transform(camera, env, gymapi.Transform())
        images.append(tensors_of(sim, env, camera, (SEGMENTATION,))[SEGMENTATION])
    GYM.render_all_camera_sensors(sim)
    assert images[0].unique().tolist() == [1] and images[1].unique().tolist() == [1, 2]
    GYM.simulate(sim)
    roots = wrapped(GYM.acquire_actor_root_state_tensor(sim))
    np.testing.assert_allclose(roots[:, 9].cpu(), -0.0981, atol=0.02)
    assert "by XPBD, as MuJoCo cannot: " in caplog.text  # whose worlds are alike


@pytest.mark.parametrize("name", ["arm.usda", "arm.xml", "cart.urdf"])
def test_files_that_are_not_there_or_cannot_be_read(device: wp.Device, tmp_path: Path, name: str) -> None:
    sim = new_sim(device)
    with pytest.raises(wc.WarpcamError, match="there is no file"):
        GYM.load_asset(sim, str(tmp_path), name)
    (tmp_path / name).write_text("nonsense")
    with pytest.raises(wc.WarpcamError, match="cannot be read"):
        GYM.load_asset(sim, str(tmp_path), name)


def test_state_tensors_are_on_the_host_without_the_gpu_pipeline(device: wp.Device) -> None:
    sim = new_sim(device, use_gpu_pipeline=False)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_box(sim, 1, 9, 9), at(2.5, 0, 0), "wall", 0, 0, 1)
    camera = GYM.create_camera_sensor(env, props())
    GYM.set_camera_transform(camera, env, gymapi.Transform())
    image = tensors_of(sim, env, camera, (DEPTH,))[DEPTH]
    roots = wrapped(GYM.acquire_actor_root_state_tensor(sim))
    assert roots.device.type == "cpu" and str(image.device) == wp.device_to_torch(device)
    for x in (2.5, 3.5):
        roots[0, 0] = x
        GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(roots))
        roots.zero_()
        GYM.refresh_actor_root_state_tensor(sim)
        assert roots[0, 0].item() == x
        GYM.render_all_camera_sensors(sim)
        np.testing.assert_allclose(image.cpu(), 0.5 - x, rtol=1e-5)


def test_what_cannot_be_set_says_so(device: wp.Device, tmp_path: Path) -> None:
    sim = arms(device, tmp_path, 1)
    with pytest.raises(
        wc.WarpcamError, match=r"torch\.float32 of shape \(3, 2\) is needed, got torch.float32 of \(2, 2\)"
    ):
        GYM.set_dof_state_tensor(sim, gymtorch.unwrap_tensor(torch.zeros(2, 2)))
    with pytest.raises(wc.WarpcamError, match=r"gymtorch.unwrap_tensor\(tensor\) is needed, got Tensor"):
        GYM.set_dof_state_tensor(sim, torch.zeros(3, 2))
    with pytest.raises(wc.WarpcamError, match="not contiguous"):
        gymtorch.unwrap_tensor(torch.zeros(4, 4)[:, :2])
    with pytest.raises(wc.WarpcamError, match="the simulation has no environments"):
        GYM.prepare_sim(new_sim(device))
    with pytest.raises(wc.WarpcamError, match=r"compute_device 99 came|use_gpu_pipeline is set, but"):
        GYM.create_sim(99, 99, gymapi.SIM_PHYSX, gymapi.SimParams(use_gpu_pipeline=True))
