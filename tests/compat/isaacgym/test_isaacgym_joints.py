"""Joints and degrees of freedom by name and by handle, as Isaac Gym's own examples ask for them."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim

from warpcam.compat.isaacgym import gymapi

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
LINK = """<link name="{}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>"""
JOINT = """<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="0 0 0.5" rpy="{} 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="2"/></joint>"""
CART = f"""
<robot name="cart">{"".join(LINK.format(name) for name in ("rail", "cart", "pole", "flag"))}
  {JOINT.format("slide", "prismatic", "rail", "cart", 0)}{JOINT.format("hinge", "revolute", "cart", "pole", 0)}
  {JOINT.format("screw", "fixed", "pole", "flag", 1.5707963267948966)}
</robot>
"""


@pytest.fixture
def carts(tmp_path: Path) -> gymapi.Sim:
    """Two environments with a box, without joints, and two carts each."""
    (tmp_path / "cart.urdf").write_text(CART)
    sim = new_sim(wp.get_device("cpu"))
    options = gymapi.AssetOptions(fix_base_link=True, disable_gravity=True)
    cart, box = GYM.load_urdf(sim, str(tmp_path), "cart.urdf", options), GYM.create_box(sim, 0.1, 0.1, 0.1)
    for _ in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(-1, -1, 0), gymapi.Vec3(1, 1, 1), 2)
        GYM.create_actor(env, box, at(0, 0, 3), "box")
        for index in range(2):
            actor = GYM.create_actor(env, cart, at(index, 0, 0), f"cart {index}")
            drives = GYM.get_actor_dof_properties(env, actor)
            drives["driveMode"], drives["stiffness"], drives["damping"] = gymapi.DOF_MODE_POS, 400.0, 40.0
            GYM.set_actor_dof_properties(env, actor, drives)
    return sim


def test_what_an_asset_is_made_of_is_printed(carts: gymapi.Sim) -> None:
    asset = GYM.get_actor_asset(GYM.get_env(carts, 0), 1)
    kinds = [GYM.get_asset_joint_type(asset, index) for index in range(GYM.get_asset_joint_count(asset))]
    assert kinds == [gymapi.JOINT_PRISMATIC, gymapi.JOINT_REVOLUTE, gymapi.JOINT_FIXED]
    assert [GYM.get_joint_type_string(kind) for kind in kinds] == ["Prismatic", "Revolute", "Fixed"]
    assert [GYM.get_asset_joint_name(asset, index) for index in range(3)] == ["slide", "hinge", "screw"]
    kinds = [GYM.get_asset_dof_type(asset, index) for index in range(2)]
    assert [GYM.get_dof_type_string(kind) for kind in kinds] == ["Translation", "Rotation"]
    assert GYM.find_asset_joint_index(asset, "screw") == 2
    assert GYM.find_asset_joint_index(asset, "gear") == gymapi.INVALID_HANDLE
    # In the order in which Isaac Gym has them.
    assert gymapi.DofProperties.dtype.names == (
        "hasLimits", "lower", "upper", "driveMode", "velocity", "effort", "stiffness", "damping", "friction", "armature"
    )  # fmt: skip
    assert GYM.get_asset_dof_properties(asset)[0].tolist()[:6] == (True, -1.0, 1.0, 0, 2.0, 9.0)


def test_handles_count_what_an_environment_has(carts: gymapi.Sim) -> None:
    env = GYM.get_env(carts, 1)
    assert GYM.get_actor_joint_names(env, 2) == ["slide", "hinge", "screw"]
    domains = (gymapi.DOMAIN_ACTOR, gymapi.DOMAIN_ENV, gymapi.DOMAIN_SIM)
    assert [GYM.get_actor_dof_index(env, 2, 1, domain) for domain in domains] == [1, 3, 7]
    assert [GYM.find_actor_joint_index(env, 2, "hinge", domain) for domain in domains] == [1, 4, 10]
    assert [GYM.get_actor_joint_index(env, 2, 1, domain) for domain in domains] == [1, 4, 10]
    handle = GYM.get_joint_handle(env, "cart 1", "hinge")
    assert handle == GYM.find_actor_joint_handle(env, 2, "hinge") == GYM.get_actor_joint_handle(env, 2, 1) == 4
    assert GYM.get_joint_name(env, handle) == "hinge" and GYM.get_rigid_name(env, 7) == "pole"
    assert GYM.get_joint_handle(env, "cart 2", "hinge") == GYM.get_joint_handle(env, "cart 1", "gear") == -1


@pytest.mark.parametrize("prepared", [False, True])
def test_joints_are_read_and_driven_one_by_one(carts: gymapi.Sim, prepared: bool) -> None:
    env = GYM.get_env(carts, 1)
    states = GYM.get_actor_dof_states(env, 2, gymapi.STATE_ALL)
    states["pos"], states["vel"] = (0.25, 0.5), (0.1, 0.2)
    if prepared:
        GYM.prepare_sim(carts)
    GYM.set_actor_dof_states(env, 2, states, gymapi.STATE_ALL)
    hinge = GYM.get_actor_dof_handle(env, 2, 1)
    assert GYM.get_dof_position(env, hinge) == pytest.approx(0.5)
    assert GYM.get_dof_velocity(env, hinge) == pytest.approx(0.2)
    joint = GYM.get_joint_handle(env, "cart 1", "slide")
    assert GYM.get_joint_position(env, joint) == pytest.approx(0.25)
    assert GYM.get_joint_velocity(env, joint) == pytest.approx(0.1)

    # Where they are: the slide has moved the hinge along y.
    frame = GYM.get_dof_frame(env, hinge)
    assert tuple(frame.origin) == pytest.approx((1.0, 0.25, 1.0), abs=1e-6)
    assert tuple(frame.axis) == pytest.approx((0, 1, 0), abs=1e-6)
    frames = GYM.get_actor_dof_frames(env, 2)
    assert frames.dtype == gymapi.DofFrame.dtype and frames["origin"][1].tolist() == pytest.approx(tuple(frame.origin))
    poses = GYM.get_actor_joint_transforms(env, 2)
    assert poses.shape == (3,) and poses.dtype == gymapi.Transform.dtype
    flag = gymapi.Transform.from_buffer(poses[2])
    screw = GYM.get_joint_transform(env, GYM.get_joint_handle(env, "cart 1", "screw"))
    assert (*flag.p, *flag.r) == pytest.approx((*screw.p, *screw.r), abs=1e-6)
    tip = gymapi.Vec3(1.0 + 0.5 * np.sin(0.5), 0.25, 1.0 + 0.5 * np.cos(0.5))
    assert tuple(flag.p) == pytest.approx(tuple(tip), abs=1e-6)
    ahead = flag.transform_vector(gymapi.Vec3(0, 0, 1))
    assert tuple(ahead) == pytest.approx((0, -1, 0), abs=1e-6)  # a quarter turn about x

    GYM.set_dof_target_position(env, hinge, 0.75)
    GYM.set_joint_target_velocity(env, joint, 0.125)
    assert GYM.get_actor_dof_position_targets(env, 2).tolist() == [0.0, 0.75]
    assert GYM.get_actor_dof_velocity_targets(env, 2).tolist() == [0.125, 0.0]
    assert GYM.get_dof_target_position(env, hinge) == 0.75 and GYM.get_joint_target_velocity(env, joint) == 0.125
    GYM.set_joint_target_position(env, joint, 0.5)
    for _ in range(60):
        GYM.simulate(carts)
    assert GYM.get_joint_target_position(env, joint) == 0.5
    assert GYM.get_joint_position(env, joint) == pytest.approx(0.5, abs=0.05)
    assert GYM.get_dof_position(env, hinge) == pytest.approx(0.75, abs=0.05)


def test_joints_that_cannot_be_are_named(carts: gymapi.Sim) -> None:
    env = GYM.get_env(carts, 0)
    screw = GYM.get_joint_handle(env, "cart 0", "screw")
    for call, said in (
        (lambda: GYM.get_joint_position(env, screw), "joint 'screw' has 0 degrees of freedom; one is needed"),
        (lambda: GYM.get_joint_name(env, 6), "get_joint_name: joint 6 came, environment 0 has 6"),
        (lambda: GYM.get_dof_position(env, 4), "get_dof_position: degree of freedom 4 came, environment 0 has 4"),
        (lambda: GYM.get_actor_dof_handle(env, 0, 0), "get_actor_dof_index: index 0 came"),
        (lambda: GYM.get_dof_type_string(7), "get_dof_type_string: type 7 came; allowed are DOF_INVALID"),
        (lambda: GYM.set_rigid_transform(env, 0, at(0, 0, 0)), "Gym.set_rigid_transform is not here"),
    ):
        with pytest.raises(wc.WarpcamError, match=said):
            call()


def test_velocities_and_contact_forces_of_bodies() -> None:
    sim = new_sim(wp.get_device("cpu"))
    GYM.add_ground(sim, gymapi.PlaneParams(normal=gymapi.Vec3(0, 0, 1)))
    ball = GYM.create_sphere(sim, 0.1)
    envs = [GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1) for _ in range(2)]
    for env, height in zip(envs, (5.0, 0.1), strict=True):
        GYM.create_actor(env, ball, at(0, 0, height), "ball")
    for _ in range(30):
        GYM.simulate(sim)
    assert tuple(GYM.get_rigid_linear_velocity(envs[0], 0)) == pytest.approx((0, 0, -9.81 * 0.5), abs=0.01)
    assert tuple(GYM.get_rigid_angular_velocity(envs[0], 0)) == pytest.approx((0, 0, 0), abs=1e-6)
    forces = GYM.get_rigid_contact_forces(sim)
    weight = 9.81 * GYM.get_actor_rigid_body_properties(envs[1], 0)[0].mass
    assert forces.dtype == gymapi.Vec3.dtype and forces["z"].tolist() == pytest.approx([0.0, weight], rel=0.02)
    assert GYM.get_env_rigid_contact_forces(envs[1])["z"].tolist() == [forces["z"][1]]


def test_a_bodys_joints_of_a_urdf_file_come_by_name(tmp_path: Path) -> None:
    legs = ("FR", "FL", "RR", "RL")  # as in the file of a robot of Unitree's; hips first, then the rest
    links = "".join(
        LINK.format(name) for name in ("trunk", *(f"{leg}_{part}" for part in ("hip", "calf") for leg in legs))
    )
    joints = [JOINT.format(f"{leg}_calf_joint", "revolute", f"{leg}_hip", f"{leg}_calf", 0) for leg in legs]
    joints += [JOINT.format(f"{leg}_hip_joint", "revolute", "trunk", f"{leg}_hip", 0) for leg in legs]
    (tmp_path / "dog.urdf").write_text(f'<robot name="dog">{joints[0]}{links}{"".join(joints[1:])}</robot>')
    asset = GYM.load_asset(new_sim(wp.get_device("cpu")), str(tmp_path), "dog.urdf", gymapi.AssetOptions())
    ordered = [f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "calf")]
    assert GYM.get_asset_rigid_body_names(asset) == ["trunk", *ordered]
    assert GYM.get_asset_dof_names(asset) == [f"{name}_joint" for name in ordered]


@pytest.mark.parametrize(
    "named", ["plate.obj", "meshes/plate.obj", "../dog/meshes/plate.obj", "package://dog/meshes/plate.obj"]
)
def test_meshes_of_a_urdf_file_are_found(tmp_path: Path, named: str) -> None:
    folder = tmp_path / "dog"
    path = folder / "meshes" / "plate.obj" if "meshes" in named else folder / "plate.obj"
    path.parent.mkdir(parents=True)
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shape = f'<collision><geometry><mesh filename="{named}"/></geometry></collision>'
    (folder / "dog.urdf").write_text(f'<robot name="dog"><link name="plate">{shape}</link></robot>')
    asset = GYM.load_asset(new_sim(wp.get_device("cpu")), str(folder), "dog.urdf", gymapi.AssetOptions(density=30.0))
    assert GYM.get_asset_rigid_shape_count(asset) == 1
    assert asset.masses["mass"].sum() == pytest.approx(30.0 * 8.0 / 6.0, rel=1e-3)
