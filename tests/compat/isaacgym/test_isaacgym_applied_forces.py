"""Isaac Gym's forces of a program's own: they act for one step, in the frame they are given in."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim, wrapped  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
DT, MASS, SIDES = 0.01, 0.6, np.array((0.1, 0.2, 0.3))
INERTIA = MASS / 12.0 * (np.sum(SIDES**2) - SIDES**2)
QUARTER = gymapi.Quat.from_axis_angle(gymapi.Vec3(0, 0, 1), 0.5 * np.pi)  # x to y, y to -x
SWING = """
<mujoco model="swing">
  <worldbody>
    <body name="post">
      <geom type="box" size="0.05 0.05 0.05" mass="1"/>
      <body name="a" pos="0 0.5 0"><joint name="swing" axis="0 0 1"/>
        <geom type="sphere" size="0.05" pos="0.4 0 0" mass="2"/></body>
      <body name="b" pos="0 -0.5 0"><joint name="slide" type="slide" axis="1 0 0"/>
        <geom type="sphere" size="0.05" mass="0.5"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def floating(device: wp.Device, count: int) -> tuple[gymapi.Sim, torch.Tensor]:
    """A ball and a box, a quarter turned, that nothing pulls, and states of all bodies."""
    sim = new_sim(device, dt=DT, substeps=2)
    options = gymapi.AssetOptions(disable_gravity=True, density=MASS / float(np.prod(SIDES)), angular_damping=0.0)
    box, ball = GYM.create_box(sim, *SIDES, options), GYM.create_sphere(sim, 0.1, options)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 1)
        GYM.create_actor(env, ball, at(0, 5, 1), "ball", index, 0)
        GYM.create_actor(env, box, gymapi.Transform(gymapi.Vec3(1, 2, 3), QUARTER), "box", index, 0)
    GYM.prepare_sim(sim)
    return sim, wrapped(GYM.acquire_rigid_body_state_tensor(sim)).view(count, 2, 13)


def gained(sim: gymapi.Sim, bodies: torch.Tensor) -> np.ndarray:
    """Velocities that a step gives, (env, body, 6)."""
    GYM.refresh_rigid_body_state_tensor(sim)
    before = bodies[..., 7:].clone()
    GYM.simulate(sim)
    GYM.refresh_rigid_body_state_tensor(sim)
    return (bodies[..., 7:] - before).cpu().numpy()


def described(rows: Any, bodies: torch.Tensor) -> gymapi.Tensor:
    return gymtorch.unwrap_tensor(torch.tensor(np.array(rows, np.float32), device=bodies.device))


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_forces_and_torques_act_for_one_step(device: wp.Device, count: int) -> None:
    sim, bodies = floating(device, count)
    forces, torques = np.zeros((count, 2, 3)), np.zeros((count, 2, 3))
    forces[:, 1] = [(1.0 + env, 2.0, -3.0) for env in range(count)]
    torques[:, 1] = (0.001, -0.002, 0.0015)
    turned = INERTIA[[1, 0, 2]]  # as it lies
    expected = np.zeros((count, 2, 6))
    expected[:, 1, :3], expected[:, 1, 3:] = forces[:, 1] * DT / MASS, torques[:, 1] * DT / turned
    assert GYM.apply_rigid_body_force_tensors(sim, described(forces, bodies), described(torques, bodies))
    np.testing.assert_allclose(gained(sim, bodies), expected, rtol=2e-3, atol=1e-5)
    np.testing.assert_allclose(gained(sim, bodies)[..., :3], 0.0, atol=1e-5)
    # In its own frame, and twice is the sum of both.
    for _ in range(2):
        GYM.apply_rigid_body_force_tensors(sim, described(0.5 * forces, bodies), None, gymapi.LOCAL_SPACE)
    along = forces[:, 1][:, [1, 0, 2]] * (-1.0, 1.0, 1.0)
    np.testing.assert_allclose(gained(sim, bodies)[:, 1, :3], along * DT / MASS, rtol=5e-3, atol=1e-4)


PLACES = {
    # A force along x, 0.1 m above the centre, turns about y; along its own x it is along y here, and turns about -x.
    gymapi.ENV_SPACE: ((1.0, 2.0, 3.1), (1, 0, 0), (0, 1, 0)),
    gymapi.GLOBAL_SPACE: ((1.0, 2.0, 3.1), (1, 0, 0), (0, 1, 0)),
    gymapi.LOCAL_SPACE: ((0.0, 0.0, 0.1), (0, 1, 0), (-1, 0, 0)),
}


@pytest.mark.parametrize("space", list(PLACES))
@pytest.mark.parametrize("one", [False, True], ids=["all", "one"])
def test_forces_act_where_they_are_put(device: wp.Device, space: gymapi.CoordinateSpace, one: bool) -> None:
    sim, bodies = floating(device, 1 if one else 3)
    count = len(bodies)
    place, direction, about = PLACES[space]
    places, forces = np.zeros((count, 2, 3)), np.zeros((count, 2, 3))
    places[:, 1], forces[:, 1, 0] = place, 0.5
    if space == gymapi.GLOBAL_SPACE:
        origins = [tuple(GYM.get_env_origin(GYM.get_env(sim, index))) for index in range(count)]
        assert one or np.ptp(origins) > 3.0
        places += np.array(origins)[:, None]
    if one:
        env, vectors = GYM.get_env(sim, 0), [gymapi.Vec3(*rows[0, 1]) for rows in (forces, places)]
        GYM.apply_body_force_at_pos(env, 1, *vectors, space)
    else:
        GYM.apply_rigid_body_force_at_pos_tensors(sim, described(forces, bodies), described(places, bodies), space)
    expected = np.zeros((count, 2, 6))
    expected[:, 1, :3] = 0.5 * DT / MASS * np.array(direction)
    expected[:, 1, 3:] = 0.5 * 0.1 * DT / INERTIA[[1, 0, 2]] * np.array(about)
    np.testing.assert_allclose(gained(sim, bodies), expected, rtol=0.02, atol=2e-4)


@pytest.mark.parametrize("placed", [False, True])
@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_a_force_at_the_centre_of_mass_turns_nothing(device: wp.Device, count: int, placed: bool) -> None:
    """The centre of mass is beside the body's origin."""
    sim, bodies = floating(device, count)
    for index in range(count):
        env = GYM.get_env(sim, index)
        properties = GYM.get_actor_rigid_body_properties(env, 1)
        properties[0].com = gymapi.Vec3(0.05, 0.0, 0.1)
        GYM.set_actor_rigid_body_properties(env, 1, properties)
    forces, places = np.zeros((count, 2, 3)), np.zeros((count, 2, 3))
    forces[:, 1], places[:, 1] = (0.5, -1.0, 0.7), (1.0, 2.05, 3.1)  # a quarter turned
    where = described(places, bodies) if placed else None
    assert GYM.apply_rigid_body_force_at_pos_tensors(sim, described(forces, bodies), where)
    expected = np.zeros((count, 2, 6))
    expected[:, 1, :3] = forces[:, 1] * DT / MASS
    np.testing.assert_allclose(gained(sim, bodies), expected, rtol=2e-3, atol=1e-4)


def test_one_body_is_pushed_alone(device: wp.Device) -> None:
    sim, bodies = floating(device, 2)
    env = GYM.get_env(sim, 1)
    GYM.apply_body_forces(env, 1, gymapi.Vec3(0, 0, 1.2), gymapi.Vec3(0, 0, 0.001))
    GYM.apply_body_forces(env, 0, torque=None)
    expected = np.zeros((2, 2, 6))
    expected[1, 1, 2], expected[1, 1, 5] = 1.2 * DT / MASS, 0.001 * DT / INERTIA[2]
    np.testing.assert_allclose(gained(sim, bodies), expected, rtol=2e-3, atol=1e-5)


@pytest.mark.parametrize("prepared", [False, True])
def test_single_joints_are_told(device: wp.Device, tmp_path: Path, prepared: bool) -> None:
    """Forces, and where drives go; the others of the actor are left."""
    (tmp_path / "swing.xml").write_text(SWING)
    sim = new_sim(device, dt=DT, substeps=1)
    asset = GYM.load_asset(sim, str(tmp_path), "swing.xml", gymapi.AssetOptions(fix_base_link=True))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    for index in range(2):
        GYM.create_actor(env, asset, at(0, 3 * index, 1), f"swing{index}", index, 0)
    drives = GYM.get_actor_dof_properties(env, 1)
    drives["driveMode"], drives["damping"] = gymapi.DOF_MODE_VEL, 500.0
    GYM.set_actor_dof_properties(env, 1, drives)
    if prepared:
        GYM.prepare_sim(sim)
    assert GYM.apply_actor_dof_efforts(env, 0, np.array((0.8, 0.3), np.float32))
    GYM.apply_dof_effort(env, 1, 0.4)
    for told in (np.array((0.1, np.nan)), np.array((np.inf, 0.0))):
        with pytest.raises(wc.WarpcamError, match="apply_actor_dof_efforts: finite numbers are needed, got"):
            GYM.apply_actor_dof_efforts(env, 0, told)
    with pytest.raises(wc.WarpcamError, match="set_dof_target_velocity: a finite number is needed, got inf"):
        GYM.set_dof_target_velocity(env, 2, np.inf)
    GYM.set_dof_target_velocity(env, 2, 0.25)
    GYM.set_dof_target_velocity(env, 3, -0.5)
    GYM.simulate(sim)
    found = GYM.get_actor_dof_states(env, 0)["vel"]
    swung = 2.0 * (0.4**2 + 0.4 * 0.05**2)
    np.testing.assert_allclose(found, (0.8 * DT / swung, 0.4 * DT / 0.5), rtol=2e-3)
    for _ in range(20):
        GYM.simulate(sim)
    np.testing.assert_allclose(GYM.get_actor_dof_states(env, 1)["vel"], (0.25, -0.5), rtol=0.05)
    drives["driveMode"], drives["stiffness"], drives["damping"] = gymapi.DOF_MODE_POS, 400.0, 60.0
    GYM.set_actor_dof_properties(env, 1, drives)
    GYM.set_actor_dof_position_targets(env, 1, [0.3, 0.2])
    GYM.set_dof_target_position(env, 3, -0.1)
    for _ in range(100):
        GYM.simulate(sim)
    np.testing.assert_allclose(GYM.get_actor_dof_states(env, 1)["pos"], (0.3, -0.1), atol=0.01)
    GYM.set_dof_target_position(env, 2, 0.1)
    for _ in range(100):
        GYM.simulate(sim)
    np.testing.assert_allclose(GYM.get_actor_dof_states(env, 1)["pos"], (0.1, -0.1), atol=0.01)
    assert sim.physics._pushes is None  # no memory for what is never pushed


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_gravity_and_steps_may_change(device: wp.Device, count: int) -> None:
    sim = new_sim(device, dt=DT, substeps=2)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 3)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1), at(0, 0, 1), "ball", index, 0)
        floats = gymapi.AssetOptions(disable_gravity=True)
        GYM.create_actor(env, GYM.create_sphere(sim, 0.1, floats), at(0, 5, 1), "cloud", index, 0)
    bodies = wrapped(GYM.acquire_rigid_body_state_tensor(sim)).view(count, 2, 13)
    np.testing.assert_allclose(gained(sim, bodies)[:, 0, :3], [(0, 0, -9.81 * DT)] * count, atol=1e-5)
    params = GYM.get_sim_params(sim)
    params.gravity.x, params.gravity.z, params.dt = 1.0, -3.0, 2.0 * DT
    before = GYM.get_sim_params(sim)  # not yet: each is a copy
    assert (before.gravity.x, before.gravity.z, before.dt) == (0.0, pytest.approx(-9.81), DT)
    GYM.set_sim_params(sim, params)
    params.gravity.z, params.dt = 7.0, 7.0
    np.testing.assert_allclose(gained(sim, bodies)[:, 0, :3], [(2.0 * DT, 0, -6.0 * DT)] * count, atol=1e-5)
    np.testing.assert_allclose(bodies[:, 1, 7:10].cpu(), 0.0, atol=1e-6)
    with pytest.raises(wc.WarpcamError, match="up_axis is another than that of create_sim"):
        GYM.set_sim_params(sim, gymapi.SimParams(up_axis=gymapi.UP_AXIS_Y))


def test_tasks_are_randomized(device: wp.Device) -> None:
    """Randomise as IsaacGymEnvs does: it looks up all calls, and starts from the gravity of the first time."""
    sim, _ = floating(device, 2)
    setters = {
        name: (getattr(GYM, f"get_{call}"), getattr(GYM, f"set_{call}"))
        for name, call in (
            ("dof_properties", "actor_dof_properties"),
            ("tendon_properties", "actor_tendon_properties"),
            ("rigid_body_properties", "actor_rigid_body_properties"),
            ("rigid_shape_properties", "actor_rigid_shape_properties"),
            ("sim_params", "sim_params"),
        )
    }
    with pytest.raises(wc.WarpcamError, match=r"Gym\.get_actor_tendon_properties is not here: tendons pull nothing"):
        setters["tendon_properties"][0](GYM.get_env(sim, 0), 0)
    get, put = setters["sim_params"]
    first = get(sim)
    original = {name: getattr(first, name) for name in dir(first)}
    for count in range(3):
        assert GYM.get_frame_count(sim) == count
        params = get(sim)
        params.gravity.z = original["gravity"].z + np.float64(1.0)
        put(sim, params)
        GYM.simulate(sim)
    assert get(sim).gravity.z == pytest.approx(-9.81 + 1.0)


def test_what_cannot_push_is_named() -> None:
    sim, bodies = floating(wp.get_device("cpu"), 1)
    env, force = GYM.get_env(sim, 0), described(np.zeros((2, 3)), torch.zeros(1))
    mistakes: list[tuple[Any, str]] = [
        (lambda: GYM.apply_rigid_body_force_tensors(sim, described(np.zeros((3, 3)), bodies)), r"\(2, 3\) is needed"),
        (lambda: GYM.apply_rigid_body_force_tensors(sim, force, None, 7), "space 7 came; allowed are ENV_SPACE"),
        (lambda: GYM.apply_rigid_body_force_at_pos_tensors(sim, force, bodies), "places: gymtorch.unwrap_tensor"),
        (lambda: GYM.apply_body_forces(env, 2, gymapi.Vec3()), "body 2 came, environment 0 has 0 to 1"),
        (lambda: GYM.apply_body_force_at_pos(env, 0, (1, 2, 3)), r"vectors must be Vec3, got \(1, 2, 3\)"),
        (lambda: GYM.apply_dof_effort(env, 0, 1.0), "degree of freedom 0 came, environment 0 has 0"),
        (lambda: GYM.set_sim_params(sim, None), "SimParams are needed, got NoneType"),
        (lambda: GYM.set_sim_params(sim, gymapi.SimParams(dt=0.0, up_axis=gymapi.UP_AXIS_Z)), "dt must be positive"),
        (
            lambda: GYM.set_sim_params(sim, gymapi.SimParams(gravity=(0, 0, -9.8), up_axis=gymapi.UP_AXIS_Z)),
            r"set_sim_params: SimParams.gravity must be a Vec3 of finite numbers, got \(0, 0, -9.8\)",
        ),
    ]
    for call, message in mistakes:
        with pytest.raises(wc.WarpcamError, match=message):
            call()


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_contacts_are_where_bodies_were(device: wp.Device, count: int) -> None:
    """A ball that slides fast, and is elsewhere before anybody asks; sensors and contacts are of the step."""
    sim = new_sim(device, dt=DT, substeps=1)
    GYM.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1)))
    ball = GYM.create_sphere(sim, 0.1)
    GYM.create_asset_force_sensor(ball, 0, gymapi.Transform(), gymapi.ForceSensorProperties(use_world_frame=True))
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 3)
        GYM.create_actor(env, ball, at(1.0, 2.0, 0.1), "ball", index, 0)
    roots = wrapped(GYM.acquire_actor_root_state_tensor(sim))
    sensors = wrapped(GYM.acquire_force_sensor_tensor(sim))
    for _ in range(60):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    states = roots.clone()
    states[:, 7] = 4.0
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(states))
    GYM.simulate(sim)
    states[:, :3] += 3.0
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(states))
    GYM.refresh_force_sensor_tensor(sim)
    contacts = GYM.get_rigid_contacts(sim)
    assert len(contacts) == count
    for contact in contacts:
        side = "0" if contact["body0"] == 0 else "1"
        assert np.linalg.norm(tuple(contact["localPos" + side])) == pytest.approx(0.1, abs=2e-3)
    # What rubs turns it, about its centre.
    forces, torques = sensors[:, :3].cpu().numpy(), sensors[:, 3:].cpu().numpy()
    assert (forces[:, 0] < -5.0).all()
    np.testing.assert_allclose(torques, np.cross((0.0, 0.0, -0.1), forces), atol=0.02 * np.abs(forces).max() * 0.1)


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_contacts_are_told_one_by_one(device: wp.Device, count: int) -> None:
    """A ball on a plate on the ground, which is turned: what each carries, and where they touch."""
    sim = new_sim(device, dt=DT, substeps=2)
    ground = gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1), static_friction=0.4, dynamic_friction=0.4)
    GYM.add_ground(sim, ground)
    plate = GYM.create_box(sim, 1.0, 2.0, 0.2, gymapi.AssetOptions(density=10.0))
    ball = GYM.create_sphere(sim, 0.1)
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 3)
        GYM.create_actor(env, plate, gymapi.Transform(gymapi.Vec3(1, 2, 0.1), QUARTER), "plate", index, 0)
        GYM.create_actor(env, ball, at(1.0, 2.25, 0.3), "ball", index, 0)
    assert GYM.get_rigid_contacts(sim).dtype == gymapi.RigidContact.dtype and len(GYM.get_rigid_contacts(sim)) == 0
    for _ in range(60):
        GYM.simulate(sim)
    carried = 9.81 * 1000.0 * 4.0 / 3.0 * np.pi * 0.1**3
    assert len(GYM.get_rigid_contacts(sim)) == 5 * count
    for index in range(count):
        contacts = GYM.get_env_rigid_contacts(GYM.get_env(sim, index))
        between = [contact for contact in contacts if {contact["body0"], contact["body1"]} == {0, 1}]
        below = [contact for contact in contacts if {contact["body0"], contact["body1"]} == {0, -1}]
        assert len(between) == 1 and len(below) == 4 == len(contacts) - 1
        (touch,) = between
        assert touch["env0"] == touch["env1"] == index
        assert touch["lambda"] == pytest.approx(carried, rel=0.02)
        assert sum(contact["lambda"] for contact in below) == pytest.approx(carried + 9.81 * 4.0, rel=0.02)
        upper, lower = ("0", "1") if touch["body0"] == 1 else ("1", "0")
        np.testing.assert_allclose(tuple(touch["localPos" + lower]), (0.25, 0.0, 0.1), atol=0.01)
        assert np.linalg.norm(tuple(touch["localPos" + upper])) == pytest.approx(0.1, abs=0.005)
        assert touch["normal"]["z"] == pytest.approx(1.0 if lower == "0" else -1.0, abs=1e-3)
        assert touch["minDist"] < 0.0 and touch["initialOverlap"] == -touch["minDist"]
        for contact in below:
            side = "0" if contact["body0"] == -1 else "1"
            assert contact["env" + side] == -1 and contact["friction"] == pytest.approx(1.0)  # the larger one
    contacts["lambda"] = 0.0  # a copy
    assert GYM.get_env_rigid_contacts(GYM.get_env(sim, count - 1))["lambda"].all()


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_contacts_of_the_last_step_stay_whatever_is_changed(device: wp.Device, tmp_path: Path, count: int) -> None:
    """A joint that is driven otherwise needs another solver from the next step on, the rest is told to the same."""
    (tmp_path / "swing.xml").write_text(SWING)
    sim = new_sim(device, dt=DT, substeps=1)
    GYM.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1)))
    swing = GYM.load_asset(sim, str(tmp_path), "swing.xml", gymapi.AssetOptions(fix_base_link=True))
    ball = GYM.create_sphere(sim, 0.1)
    GYM.create_asset_force_sensor(ball, 0, gymapi.Transform(), gymapi.ForceSensorProperties(use_world_frame=True))
    for index in range(count):
        env = GYM.create_env(sim, gymapi.Vec3(-2, -2, 0), gymapi.Vec3(2, 2, 2), 3)
        GYM.create_actor(env, swing, at(0, 0, 3), "swing", index, 0)
        GYM.create_actor(env, ball, at(1.0, 2.0, 0.1), "ball", index, 0)
    GYM.prepare_sim(sim)
    forces, sensors = wrapped(GYM.acquire_net_contact_force_tensor(sim)), wrapped(GYM.acquire_force_sensor_tensor(sim))
    GYM.acquire_mass_matrix_tensor(sim, "swing")
    along = wrapped(GYM.acquire_dof_force_tensor(sim))

    def read() -> list[Any]:
        for refresh in (
            GYM.refresh_mass_matrix_tensors,  # which brings the model up to date
            GYM.refresh_net_contact_force_tensor,
            GYM.refresh_force_sensor_tensor,
            GYM.refresh_dof_force_tensor,
        ):
            refresh(sim)
        single = GYM.get_rigid_contacts(sim)["lambda"]
        return [forces.cpu().numpy().copy(), sensors.cpu().numpy().copy(), along.cpu().numpy().copy(), single.copy()]

    def drive(mode: Any) -> None:
        env = GYM.get_env(sim, count - 1)
        drives = GYM.get_actor_dof_properties(env, 0)
        drives["driveMode"], drives["stiffness"], drives["damping"] = mode, 40.0, 4.0
        GYM.set_actor_dof_properties(env, 0, drives)

    def weigh() -> None:
        bodies = GYM.get_actor_rigid_body_properties(GYM.get_env(sim, 0), 1)
        bodies[0].mass *= 1.5
        GYM.set_actor_rigid_body_properties(GYM.get_env(sim, 0), 1, bodies)

    def rub() -> None:
        shapes = GYM.get_actor_rigid_shape_properties(GYM.get_env(sim, 0), 1)
        shapes[0].friction = 0.3
        GYM.set_actor_rigid_shape_properties(GYM.get_env(sim, 0), 1, shapes)

    def pull() -> None:
        params = GYM.get_sim_params(sim)
        params.gravity.z = -4.0
        GYM.set_sim_params(sim, params)

    def stay() -> None:
        roots = wrapped(GYM.acquire_actor_root_state_tensor(sim))
        GYM.refresh_actor_root_state_tensor(sim)
        GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(roots))

    changes = (lambda: drive(gymapi.DOF_MODE_POS), weigh, lambda: drive(gymapi.DOF_MODE_VEL), rub, pull, stay)
    gravity, mass = 9.81, 1000.0 * 4.0 / 3.0 * np.pi * 0.1**3  # what was changed before counts by the next turn
    for change in changes:
        for _ in range(60):
            GYM.apply_dof_effort(GYM.get_env(sim, 0), 0, 0.3)
            GYM.simulate(sim)
        before = read()
        assert len(before[3]) == count and all(part.any() for part in before)
        assert GYM.get_env_rigid_contacts(GYM.get_env(sim, 0))["lambda"] == pytest.approx(gravity * mass, rel=0.02)
        change()
        for found, expected in zip(read(), before, strict=True):
            np.testing.assert_array_equal(found, expected)
        gravity, mass = (4.0 if change is pull else gravity), mass * (1.5 if change is weigh else 1.0)
