"""Isaac Gym's surfaces, masses, motors and contact forces, and how programs of the field make their environments."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim, props, tensors_of  # noqa: E402, newton may be missing

from warpcam.compat.isaacgym import gymapi, gymtorch  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
NUM_ENVS = 3
LOWER, UPPER = gymapi.Vec3(-2.0, -2.0, 0.0), gymapi.Vec3(2.0, 2.0, 2.0)
LEG = """
<body name="{0}_leg" pos="{1} {2} 0">
  <joint name="hip_{0}" axis="0 0 1" range="-40 40"/>
  <geom type="capsule" fromto="0 0 0 {1} {2} 0" size="0.06"/>
  <body name="{0}_foot" pos="{1} {2} 0">
    <joint name="ankle_{0}" axis="{2} {3} 0" range="-40 40"/>
    <geom type="capsule" fromto="0 0 0 {1} {2} -0.2" size="0.06"/>
  </body>
</body>
"""
CORNERS = ((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2))
LEGS = "".join(LEG.format(f"leg{index}", x, y, -x) for index, (x, y) in enumerate(CORNERS))
MOTORS = "".join(f'<motor joint="{part}_leg{index}"/>' for index in range(4) for part in ("hip", "ankle"))
ANT = f"""
<mujoco model="ant">
  <default><motor gear="15" ctrllimited="true" ctrlrange="-1 1"/></default>
  <worldbody>
    <body name="torso" pos="0 0 0.5"><freejoint name="root"/><geom type="sphere" size="0.2"/>{LEGS}</body>
  </worldbody>
  <actuator>{MOTORS}</actuator>
</mujoco>
"""
SHIN = """
<link name="{0}_foot"><inertial><mass value="0.4"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius="0.08"/></geometry><origin xyz="0 0 -0.3"/></collision></link>
<joint name="{0}_hip" type="revolute"><parent link="base"/><child link="{0}_foot"/><origin xyz="{1} {2} 0"/>
<axis xyz="0 1 0"/><limit lower="-0.8" upper="0.8" effort="30" velocity="20"/></joint>
"""
DOG = f"""
<robot name="dog">
  <link name="base">
    <inertial><mass value="6"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.6 0.3 0.1"/></geometry></collision>
  </link>
  {"".join(SHIN.format(name, x, y) for name, (x, y) in zip(("FL", "RL", "RR", "FR"), CORNERS, strict=True))}
</robot>
"""
INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
POLE = f"""
<robot name="cartpole">
  <link name="slider"><inertial><mass value="1"/>{INERTIA}</inertial></link>
  <link name="cart"><inertial><mass value="1"/>{INERTIA}</inertial>
    <visual><geometry><box size="0.2 0.4 0.2"/></geometry></visual></link>
  <link name="pole"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>{INERTIA}</inertial>
    <visual><geometry><box size="0.05 0.05 1"/></geometry><origin xyz="0 0 0.5"/></visual></link>
  <joint name="slider_to_cart" type="prismatic"><parent link="slider"/><child link="cart"/><axis xyz="0 1 0"/>
    <limit lower="-4" upper="4" effort="1000" velocity="100"/></joint>
  <joint name="cart_to_pole" type="continuous"><parent link="cart"/><child link="pole"/><axis xyz="1 0 0"/>
    <limit effort="1000" velocity="8"/></joint>
</robot>
"""


def ground(sim: gymapi.Sim) -> None:
    plane = gymapi.PlaneParams()
    plane.normal = gymapi.Vec3(0.0, 0.0, 1.0)
    plane.static_friction = plane.dynamic_friction = 0.2
    GYM.add_ground(sim, plane)


def wrapped(tensor: gymapi.Tensor) -> torch.Tensor:
    return gymtorch.wrap_tensor(tensor)


def resting(device: wp.Device, count: int, mass: float = 2.0) -> gymapi.Sim:
    """Boxes that lie on the ground."""
    sim = new_sim(device, dt=0.01, substeps=2)
    ground(sim)
    asset = GYM.create_box(sim, 0.4, 0.4, 0.2, gymapi.AssetOptions(density=mass / 0.032))
    place, options = at(0.1, 0.0, 0.0), gymapi.ForceSensorProperties()
    GYM.create_asset_force_sensor(asset, 0, place, options)
    place.p.x, options.enable_constraint_solver_forces = 9.0, False  # they are copied
    for index in range(count):
        env = GYM.create_env(sim, LOWER, UPPER, 2)
        GYM.create_actor(env, asset, at(0, 0, 0.1), "box", index, 0)
    return sim


def test_an_ant(device: wp.Device, tmp_path: Path) -> None:
    """Make and read environments as IsaacGymEnvs' task of that name does."""
    (tmp_path / "ant.xml").write_text(ANT)
    sim = new_sim(device, dt=0.0166, substeps=2)
    ground(sim)
    options = gymapi.AssetOptions()
    options.default_dof_drive_mode = gymapi.DOF_MODE_NONE
    options.angular_damping = 0.0
    asset = GYM.load_asset(sim, str(tmp_path), "ant.xml", options)
    num_dofs, num_bodies = GYM.get_asset_dof_count(asset), GYM.get_asset_rigid_body_count(asset)
    efforts = [motor.motor_effort for motor in GYM.get_asset_actuator_properties(asset)]
    assert efforts == [15.0] * num_dofs == [15.0] * 8
    names = [GYM.get_asset_rigid_body_name(asset, index) for index in range(num_bodies)]
    feet = [GYM.find_asset_rigid_body_index(asset, name) for name in names if "foot" in name]
    assert [GYM.create_asset_force_sensor(asset, body, gymapi.Transform()) for body in feet] == [0, 1, 2, 3]
    start = gymapi.Transform()
    start.p = gymapi.Vec3(0.0, 0.0, 0.44)
    envs = []
    for index in range(NUM_ENVS):
        env = GYM.create_env(sim, LOWER, UPPER, 2)
        actor = GYM.create_actor(env, asset, start, "ant", index, 1, 0)
        for body in range(num_bodies):
            GYM.set_rigid_body_color(env, actor, body, gymapi.MESH_VISUAL, gymapi.Vec3(0.97, 0.38, 0.06))
        envs.append(env)
    limits = GYM.get_actor_dof_properties(envs[0], 0)
    assert (limits["lower"] < limits["upper"]).all()
    roots, dofs = wrapped(GYM.acquire_actor_root_state_tensor(sim)), wrapped(GYM.acquire_dof_state_tensor(sim))
    sensors = wrapped(GYM.acquire_force_sensor_tensor(sim)).view(NUM_ENVS, -1)
    assert sensors.shape == (NUM_ENVS, 24) and not sensors.any()
    assert GYM.get_sim_force_sensor_count(sim) == 4 * NUM_ENVS
    first = dofs.clone()
    for _ in range(60):
        forces = torch.full((NUM_ENVS * num_dofs,), 1.5, device=dofs.device)
        GYM.set_dof_actuation_force_tensor(sim, gymtorch.unwrap_tensor(forces))
        GYM.simulate(sim)
        GYM.fetch_results(sim, True)
    for refresh in (GYM.refresh_dof_state_tensor, GYM.refresh_actor_root_state_tensor, GYM.refresh_force_sensor_tensor):
        refresh(sim)
    assert torch.isfinite(roots).all() and (dofs - first).abs().max() > 0.1
    assert roots[0, 2] > 0.1 and sensors.abs().max() > 1.0  # it stands on its feet


def test_a_cartpole(device: wp.Device, tmp_path: Path) -> None:
    """Make and read environments as IsaacGymEnvs' cart-pole does, with a camera for each."""
    (tmp_path / "cartpole.urdf").write_text(POLE)
    sim = new_sim(device, dt=0.0166, substeps=2)
    options = gymapi.AssetOptions()
    options.fix_base_link = True
    asset = GYM.load_asset(sim, str(tmp_path), "cartpole.urdf", options)
    images = []
    for index in range(NUM_ENVS):
        env = GYM.create_env(sim, LOWER, UPPER, 2)
        cart = GYM.create_actor(env, asset, at(0, 0, 2), "cartpole", index, 1, 1)
        drives = GYM.get_actor_dof_properties(env, cart)
        drives["driveMode"][0], drives["driveMode"][1] = gymapi.DOF_MODE_EFFORT, gymapi.DOF_MODE_NONE
        drives["stiffness"][:], drives["damping"][:] = 0.0, 0.0
        GYM.set_actor_dof_properties(env, cart, drives)
        camera = GYM.create_camera_sensor(env, props())
        GYM.set_camera_location(camera, env, gymapi.Vec3(3, 0, 2.2), gymapi.Vec3(0, 0, 2.2))
        images.append(tensors_of(sim, env, camera)[gymapi.IMAGE_SEGMENTATION])
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim)).view(NUM_ENVS, 2, 2)
    forces = torch.zeros((NUM_ENVS, 2), device=dofs.device)
    forces[:, 0] = torch.tensor((-20.0, 0.0, 20.0), device=dofs.device)
    for _ in range(20):
        GYM.set_dof_actuation_force_tensor(sim, gymtorch.unwrap_tensor(forces))
        GYM.simulate(sim)
    GYM.refresh_dof_state_tensor(sim)
    assert dofs[0, 0, 0] < -0.1 < dofs[1, 0, 0] < 0.1 < dofs[2, 0, 0]
    GYM.step_graphics(sim)
    GYM.render_all_camera_sensors(sim)
    middles = [float((image == 1).nonzero()[:, 1].float().mean()) for image in images]
    assert abs(middles[0] - middles[1]) > 1.0 and abs(middles[2] - middles[1]) > 1.0


def test_a_legged_robot(device: wp.Device, tmp_path: Path) -> None:
    """Follow legged_gym's base task: frictions of the asset before each actor, masses of each actor, contact forces."""
    (tmp_path / "dog.urdf").write_text(DOG)
    sim = new_sim(device, dt=0.005, substeps=1)
    ground(sim)
    options = gymapi.AssetOptions()
    options.default_dof_drive_mode, options.collapse_fixed_joints = 3, True
    options.replace_cylinder_with_capsule, options.flip_visual_attachments = True, True
    options.density, options.angular_damping, options.linear_damping = 0.001, 0.0, 0.0
    options.max_angular_velocity = options.max_linear_velocity = 1000.0
    options.armature, options.thickness, options.disable_gravity = 0.0, 0.01, False
    asset = GYM.load_asset(sim, str(tmp_path), "dog.urdf", options)
    limits, surfaces = GYM.get_asset_dof_properties(asset), GYM.get_asset_rigid_shape_properties(asset)
    feet = [name for name in GYM.get_asset_rigid_body_names(asset) if "foot" in name]
    envs, actors, frictions = [], [], (0.3, 0.9, 1.5)
    for index in range(NUM_ENVS):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), int(np.sqrt(NUM_ENVS)))
        for surface in surfaces:
            surface.friction = frictions[index]
        GYM.set_asset_rigid_shape_properties(asset, surfaces)
        actor = GYM.create_actor(env, asset, at(0, 0, 0.4), "dog", index, 0, 0)
        GYM.set_actor_dof_properties(env, actor, limits)
        bodies = GYM.get_actor_rigid_body_properties(env, actor)
        bodies[0].mass += float(index)
        GYM.set_actor_rigid_body_properties(env, actor, bodies, recomputeInertia=True)
        envs.append(env)
        actors.append(actor)
    found = [GYM.find_actor_rigid_body_handle(envs[0], actors[0], name) for name in feet]
    GYM.prepare_sim(sim)
    dofs = wrapped(GYM.acquire_dof_state_tensor(sim)).view(NUM_ENVS, -1, 2)
    forces = wrapped(GYM.acquire_net_contact_force_tensor(sim)).view(NUM_ENVS, -1, 3)
    assert forces.shape == (NUM_ENVS, 5, 3) and not forces.any()
    for env, actor, friction in zip(envs, actors, frictions, strict=True):
        assert {surface.friction for surface in GYM.get_actor_rigid_shape_properties(env, actor)} == {friction}
    for _ in range(100):
        GYM.refresh_dof_state_tensor(sim)
        torques = -40.0 * dofs[..., 0] - 1.0 * dofs[..., 1]
        GYM.set_dof_actuation_force_tensor(sim, gymtorch.unwrap_tensor(torques.contiguous()))
        GYM.simulate(sim)
    GYM.refresh_net_contact_force_tensor(sim)
    # It stands: the feet alone carry it, and each robot is as heavy as it was made.
    weight = forces[..., 2].sum(dim=1).cpu().numpy()
    np.testing.assert_allclose(weight, 9.81 * (7.6 + np.arange(NUM_ENVS)), rtol=0.05)
    assert (forces[:, found, 2] > 1.0).all() and not forces[:, 0].any()


@pytest.mark.parametrize("count", [1, 2], ids=["MuJoCo", "MuJoCo-Warp"])
def test_contacts_carry_what_lies(device: wp.Device, count: int) -> None:
    sim = resting(device, count)
    forces, sensors = wrapped(GYM.acquire_net_contact_force_tensor(sim)), wrapped(GYM.acquire_force_sensor_tensor(sim))
    for _ in range(60):
        GYM.simulate(sim)
    GYM.refresh_net_contact_force_tensor(sim)
    GYM.refresh_force_sensor_tensor(sim)
    np.testing.assert_allclose(forces.cpu().numpy(), [(0.0, 0.0, 19.62)] * count, atol=0.2)
    # Felt 0.1 m beside the middle: a torque of a tenth.
    np.testing.assert_allclose(sensors.cpu().numpy(), [(0.0, 0.0, 19.62, 0.0, 1.962, 0.0)] * count, atol=0.2)


def slid(sim: Any, roots: torch.Tensor) -> list[float]:
    """Return how far a push of 1 m/s moves the actors."""
    begin = torch.zeros_like(roots)
    begin[:, 2], begin[:, 6], begin[:, 7] = 0.1, 1.0, 1.0
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(begin))
    for _ in range(40):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    return [float(x) for x in roots[:, 0]]


def test_friction_and_mass_count_at_any_time(device: wp.Device) -> None:
    sim = resting(device, 2)
    GYM.prepare_sim(sim)
    envs = [GYM.get_env(sim, index) for index in range(2)]
    roots = wrapped(GYM.acquire_actor_root_state_tensor(sim))
    for slippery in (1, 0):  # the second time the solver is there already
        for index, env in enumerate(envs):
            surfaces = GYM.get_actor_rigid_shape_properties(env, 0)
            surfaces[0].friction = 0.0 if index == slippery else 1.5
            GYM.set_actor_rigid_shape_properties(env, 0, surfaces)
        far = slid(sim, roots)
        assert far[slippery] > 2.0 * far[1 - slippery], far  # the ground's own friction is 0.2
    bodies = GYM.get_actor_rigid_body_properties(envs[1], 0)
    before = bodies[0]
    bodies[0].mass, bodies[0].com = 5.0, gymapi.Vec3(0.0, 0.0, -0.05)
    GYM.set_actor_rigid_body_properties(envs[1], 0, bodies, recomputeInertia=True)
    after = GYM.get_actor_rigid_body_properties(envs[1], 0)[0]
    assert after.mass == 5.0 and after.invMass == 0.2 and after.com == before.com
    np.testing.assert_allclose(after.inertia.numbers(), 2.5 * before.inertia.numbers(), rtol=1e-6)
    np.testing.assert_allclose(after.invInertia.numbers() @ after.inertia.numbers(), np.eye(3), atol=1e-6)
    GYM.set_actor_root_state_tensor(sim, gymtorch.unwrap_tensor(roots.clone()))
    for _ in range(60):
        GYM.simulate(sim)
    forces = wrapped(GYM.acquire_net_contact_force_tensor(sim))
    np.testing.assert_allclose(forces[:, 2].cpu().numpy(), (19.62, 49.05), rtol=0.03)


def test_friction_counts_at_any_time_in_a_single_environment(device: wp.Device) -> None:
    """MuJoCo itself steps a single environment on a CPU."""
    sim = resting(device, 1)
    GYM.prepare_sim(sim)
    roots, far = wrapped(GYM.acquire_actor_root_state_tensor(sim)), {}
    for friction in (1.5, 0.0):
        surfaces = GYM.get_actor_rigid_shape_properties(GYM.get_env(sim, 0), 0)
        surfaces[0].friction = friction
        GYM.set_actor_rigid_shape_properties(GYM.get_env(sim, 0), 0, surfaces)
        (far[friction],) = slid(sim, roots)
    assert far[0.0] > 2.0 * far[1.5], far


def test_forces_that_nobody_knows_are_an_error(device: wp.Device) -> None:
    """Environments that differ are stepped by XPBD, which does not tell them."""
    sim = new_sim(device)
    ground(sim)
    asset = GYM.create_box(sim, 0.4, 0.4, 0.2, gymapi.AssetOptions())
    for count in (1, 2):
        env = GYM.create_env(sim, LOWER, UPPER, 2)
        for index in range(count):
            GYM.create_actor(env, asset, at(0, index, 0.1), f"box{index}", 0, 0)
    GYM.prepare_sim(sim)
    assert wrapped(GYM.acquire_force_sensor_tensor(sim)) is None
    GYM.simulate(sim)
    for ask in (GYM.acquire_net_contact_force_tensor,) * 2 + (GYM.refresh_force_sensor_tensor,):
        with pytest.raises(wc.WarpcamError, match="XPBD does not tell forces of contacts"):
            ask(sim)


def test_what_cannot_be_is_named(device: wp.Device) -> None:
    sim = resting(device, 1)
    env = GYM.get_env(sim, 0)
    asset = GYM.get_actor_asset(env, 0)
    surfaces, bodies = GYM.get_actor_rigid_shape_properties(env, 0), GYM.get_actor_rigid_body_properties(env, 0)
    assert GYM.get_asset_actuator_properties(asset) == []
    cases: list[tuple[Any, str]] = [
        (lambda: GYM.set_actor_rigid_shape_properties(env, 0, []), "a list of 1 RigidShapeProperties is needed"),
        (lambda: GYM.set_actor_rigid_body_properties(env, 0, surfaces), "a list of 1 RigidBodyProperties is needed"),
        (lambda: GYM.create_asset_force_sensor(asset, 1, at(0, 0, 0)), "body 1 came, the asset has 0 to 0"),
        (lambda: GYM.create_asset_force_sensor(asset, 0, None), "pose must be a Transform"),
    ]
    for call, message in cases:
        with pytest.raises(wc.WarpcamError, match=message):
            call()
    surfaces[0].friction = -1.0
    with pytest.raises(wc.WarpcamError, match="no friction negative"):
        GYM.set_actor_rigid_shape_properties(env, 0, surfaces)
    bodies[0].mass = float("nan")
    with pytest.raises(wc.WarpcamError, match="mass must be finite and not negative, got nan"):
        GYM.set_actor_rigid_body_properties(env, 0, bodies)
    for name, value, message in (("com", 3.0, "a Vec3, got float"), ("inertia", None, "a Mat33, got NoneType")):
        bodies = GYM.get_actor_rigid_body_properties(env, 0)
        setattr(bodies[0], name, value)
        with pytest.raises(wc.WarpcamError, match=f"{name} must be {message}"):
            GYM.set_actor_rigid_body_properties(env, 0, bodies)
    surfaces[0].friction, surfaces[0].restitution = 1.0, 0.5
    with pytest.warns(RuntimeWarning, match="restitution is held and changes nothing"):
        GYM.set_actor_rigid_shape_properties(env, 0, surfaces)
    surfaces[0].rolling_friction = 0.3
    with pytest.warns(RuntimeWarning, match="rolling_friction counts by XPBD alone"):
        GYM.set_actor_rigid_shape_properties(env, 0, surfaces)
    sim = new_sim(device)
    env, asset = GYM.create_env(sim, LOWER, UPPER, 2), GYM.create_box(sim, 0.4, 0.4, 0.2, gymapi.AssetOptions())
    GYM.set_asset_rigid_shape_properties(asset, surfaces)
    with pytest.warns(RuntimeWarning, match="set_asset_rigid_shape_properties: restitution is held"):
        GYM.create_actor(env, asset, at(0, 0, 0.1), "box", 0, 0)
    with pytest.raises(wc.WarpcamError, match="RigidShapeProperties has no 'frictoin'"):
        surfaces[0].frictoin = 1.0
