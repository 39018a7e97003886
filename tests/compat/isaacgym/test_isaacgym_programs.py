"""Behaviour of Isaac Gym's calls that programs of the field rely on, beyond what its pages say."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

import warpcam as wc

pytest.importorskip("newton")
import newton
from gym_worlds import GYM, at, new_sim, props

from warpcam.compat.isaacgym import gymapi, gymtorch

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own
INERTIAL = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LINK = '<link name="{}">' + INERTIAL + "</link>"
LINKS = "".join(LINK.format(name, mass) for name, mass in (("trunk", 4), ("shank", 1), ("foot", 0.5), ("lamp", 1)))
HELD = f"""
<robot name="dog">{LINKS}
  <joint name="hip" type="revolute"><parent link="trunk"/><child link="shank"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="ankle" type="fixed" dont_collapse="true"><parent link="shank"/><child link="foot"/></joint>
  <joint name="screw" type="fixed"><parent link="trunk"/><child link="lamp"/></joint>
</robot>
"""


def test_bodies_that_are_not_to_be_collapsed_stay(tmp_path: Path) -> None:
    """Bodies such as feet with sensors stay; their masses stay with them."""
    (tmp_path / "dog.urdf").write_text(HELD)
    sim, bodies, masses = new_sim(wp.get_device("cpu")), {}, {}
    for collapse in (False, True):
        asset = GYM.load_asset(sim, str(tmp_path), "dog.urdf", gymapi.AssetOptions(collapse_fixed_joints=collapse))
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        actor = GYM.create_actor(env, asset, at(0, 0, 0.4), "dog", 0, 0)
        bodies[collapse] = GYM.get_asset_rigid_body_names(asset)
        masses[collapse] = [one.mass for one in GYM.get_actor_rigid_body_properties(env, actor)]
    assert bodies == {False: ["trunk", "shank", "foot", "lamp"], True: ["trunk", "shank", "foot"]}
    np.testing.assert_allclose(masses[True], (5.0, 1.0, 0.5))
    np.testing.assert_allclose(masses[False], (4.0, 1.0, 0.5, 1.0))


@pytest.mark.parametrize("kind", ["urdf", "xml"])
def test_a_base_that_is_held_stays_a_body(tmp_path: Path, kind: str) -> None:
    """Bases such as walls and furniture of one link, and of several, stay bodies."""
    lamp = '<body name="lamp" pos="0 0 0.5"><geom size="0.1" mass="1"/></body>'
    texts = {
        "urdf": f"""<robot name="wall">{LINK.format("wall", 2)}{LINK.format("lamp", 1)}
        <joint name="screw" type="fixed"><parent link="wall"/><child link="lamp"/></joint></robot>""",
        "xml": f'<mujoco><worldbody><body name="wall"><geom size="0.2" mass="2"/>{lamp}</body></worldbody></mujoco>',
    }
    (tmp_path / f"wall.{kind}").write_text(texts[kind])
    sim = new_sim(wp.get_device("cpu"))
    options = gymapi.AssetOptions(collapse_fixed_joints=True, fix_base_link=True)
    asset = GYM.load_asset(sim, str(tmp_path), f"wall.{kind}", options)
    assert GYM.get_asset_rigid_body_names(asset) == ["wall"] and GYM.get_asset_dof_count(asset) == 0
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    wall = GYM.create_actor(env, asset, at(0, 0, 2), "wall", 0, 0)
    assert GYM.get_actor_rigid_body_properties(env, wall)[0].mass == pytest.approx(3.0)
    GYM.simulate(sim)
    assert GYM.get_rigid_transform(env, GYM.get_actor_rigid_body_handle(env, wall, 0)).p == gymapi.Vec3(0, 0, 2)


APART = {
    "no filter, one group": ((0, 0), (0, 0), True),
    "one bit": ((0, 0), (1, 1), False),
    "one bit of two": ((0, 0), (1, 3), False),
    "other bits": ((0, 0), (1, 2), True),
    "one has none": ((0, 0), (1, 0), True),
    "the asset's own": ((0, 0), (1, -1), True),
    "other groups": ((4, 5), (0, 0), False),
    "all groups": ((-1, 5), (0, 0), True),
}


def test_filters_and_groups_keep_actors_apart() -> None:
    """Balls are let fall upon others."""
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    held = GYM.create_sphere(sim, 0.1, gymapi.AssetOptions(fix_base_link=True))
    ball = GYM.create_sphere(sim, 0.1)
    for place, (groups, filters, _) in enumerate(APART.values()):
        # Apart from those of other cases by their places.
        GYM.create_actor(env, held, at(2.0 * place, 0, 0.1), "held", groups[0], filters[0])
        GYM.create_actor(env, ball, at(2.0 * place, 0, 0.35), "ball", groups[1], filters[1])
    GYM.prepare_sim(sim)
    roots = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    for _ in range(20):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    found = {case: bool(height > 0.25) for case, height in zip(APART, roots[1::2, 2], strict=True)}
    assert found == {case: rests for case, (_, _, rests) in APART.items()}


ALIKE = {((0, 0), (0, 1)): True, ((7, 7), (0, 4)): True, ((-1, 3), (0, 2)): True}
OTHER = {((0, 5), (0, 0)): False, ((1, 0), (0, 0)): False, ((0, 0), (2, 3)): False, ((-1, 0), (0, 0)): True}


@pytest.mark.parametrize(("cases", "by_xpbd"), [({**ALIKE, **OTHER}, True), (ALIKE, False)])
def test_environments_may_differ_in_groups_and_filters(
    cases: dict[tuple[tuple[int, int], ...], bool], by_xpbd: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Balls are let fall upon others. MuJoCo would keep apart in all environments what is apart in the first."""
    sim = new_sim(wp.get_device("cpu"))
    held = GYM.create_sphere(sim, 0.1, gymapi.AssetOptions(fix_base_link=True))
    ball = GYM.create_sphere(sim, 0.1)
    for groups, filters in cases:
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        GYM.create_actor(env, held, at(0, 0, 0.1), "held", groups[0], filters[0])
        GYM.create_actor(env, ball, at(0, 0, 0.35), "ball", groups[1], filters[1])
    GYM.prepare_sim(sim)
    roots = gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim))
    for _ in range(20):
        GYM.simulate(sim)
    GYM.refresh_actor_root_state_tensor(sim)
    assert {case: bool(height > 0.25) for case, height in zip(cases, roots[1::2, 2], strict=True)} == cases
    assert ("by XPBD, as MuJoCo cannot: groups and filters keep other actors apart" in caplog.text) == by_xpbd


def test_bodies_of_an_actor_collide_unless_it_has_a_filter(tmp_path: Path) -> None:
    """Bodies that no joint connects collide, also if environments differ in this alone."""
    ball = "<collision><geometry><sphere radius='0.3'/></geometry></collision>"
    links = "".join(f'<link name="l{i}">{INERTIAL.format(1)}{ball}</link>' for i in range(3))
    joints = "".join(
        f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0.15 0 0"/>'
        '<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
        for i in range(2)
    )
    (tmp_path / "chain.urdf").write_text(f'<robot name="chain">{links}{joints}</robot>')
    sim = new_sim(wp.get_device("cpu"))
    asset = GYM.load_asset(sim, str(tmp_path), "chain.urdf", gymapi.AssetOptions(fix_base_link=True))
    for filters in (0, 1):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        GYM.create_actor(env, asset, at(0, 0, 1), "chain", 0, filters)
    model = sim.physics.model
    pairs = {tuple(sorted(pair)) for pair in model.shape_collision_filter_pairs}
    groups = model.shape_collision_group.numpy()
    assert (0, 2) not in pairs and (0, 1) in pairs
    assert groups[0] == groups[2] > 0 and (groups[3:] == -1).all()


def test_groups_and_filters_that_cannot_be_are_named() -> None:
    sim = new_sim(wp.get_device("cpu"))
    env, ball = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1), GYM.create_sphere(sim, 0.1)
    for name in ("group", "filter"):
        for value in (-2, 0.5, 2**31):
            with pytest.raises(wc.WarpcamError, match=f"create_actor: {name} must be a whole number, at least -1, got"):
                GYM.create_actor(env, ball, at(0, 0, 0), **{name: value})


def test_motors_are_read_though_a_material_is_missing(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text("""
    <mujoco><worldbody>
      <geom type="plane" size="9 9 1" material="nowhere"/>
      <body name="arm"><joint name="hinge"/><geom size="0.1" material="nowhere"/><site material="nowhere"/></body>
    </worldbody><actuator><motor joint="hinge" gear="45"/></actuator></mujoco>""")
    asset = GYM.load_asset(new_sim(wp.get_device("cpu")), str(tmp_path), "arm.xml", gymapi.AssetOptions())
    assert [motor.motor_effort for motor in GYM.get_asset_actuator_properties(asset)] == [45.0]


def test_motors_are_read_of_old_files_in_parts(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(
        '<mujoco><body name="arm"><joint name="hinge"/><geom size="0.1"/></body></mujoco>'
    )
    (tmp_path / "motors.xml").write_text('<mujoco><motor joint="hinge" gear="45"/></mujoco>')
    (tmp_path / "arm.xml").write_text("""
    <mujoco><option timestep="0.002" apirate="200"/><worldbody><include file="robot.xml"/></worldbody>
      <!-- <include file="nowhere.xml"/> --><actuator><include file="motors.xml"/></actuator></mujoco>""")
    asset = GYM.load_asset(new_sim(wp.get_device("cpu")), str(tmp_path), "arm.xml", gymapi.AssetOptions())
    assert [motor.joint for motor in GYM.get_asset_actuator_properties(asset)] == ["hinge"]


def test_states_that_there_are_none_of_are_none() -> None:
    """By which programs tell whether their robots have joints."""
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    GYM.create_actor(env, GYM.create_box(sim, 0.1, 0.1, 0.1), at(0, 0, 1), "box", 0, 0)
    assert gymtorch.wrap_tensor(GYM.acquire_dof_state_tensor(sim)) is None
    assert gymtorch.wrap_tensor(GYM.acquire_actor_root_state_tensor(sim)).shape == (1, 13)


def test_actors_and_joints_are_counted(tmp_path: Path) -> None:
    (tmp_path / "dog.urdf").write_text(HELD)
    sim = new_sim(wp.get_device("cpu"))
    dog, box = GYM.load_asset(sim, str(tmp_path), "dog.urdf", gymapi.AssetOptions()), GYM.create_box(sim, 1, 1, 1)
    for _ in range(2):
        env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
        for asset, name in ((box, "box"), (dog, "dog")):
            GYM.create_actor(env, asset, at(0, 0, 1), name, 0, 0)
    assert GYM.find_actor_index(env, "dog", gymapi.DOMAIN_ENV) == 1
    assert GYM.find_actor_index(env, "dog", gymapi.DOMAIN_SIM) == 3
    assert GYM.find_actor_index(env, "cat", gymapi.DOMAIN_SIM) == gymapi.INVALID_HANDLE
    counts = [GYM.get_actor_joint_count(env, 0), GYM.get_actor_joint_count(env, 1), GYM.get_env_joint_count(env)]
    assert [*counts, GYM.get_sim_joint_count(sim)] == [0, 3, 3, 6]


def test_names_that_are_not_here_say_why() -> None:
    for name, reason in (("KEY_ESCAPE", "there is no window"), ("AttractorProperties", "there are no attractors")):
        with pytest.raises(AttributeError, match=f"gymapi.{name} is not here: {reason}"):
            getattr(gymapi, name)
    with pytest.raises(AttributeError, match="gymapi has no 'KYE'"):
        gymapi.KYE  # noqa: B018, it is what raises


def test_meshes_of_collada_files_are_seen(tmp_path: Path) -> None:
    """Most of the field's robots have them."""
    collada = pytest.importorskip("collada")
    points = np.array([(0, -0.5, -0.5), (0, 0.5, -0.5), (0, 0, 0.5)], np.float32)
    mesh = collada.Collada()
    source = collada.source.FloatSource("points", points.flatten(), ("X", "Y", "Z"))
    form = collada.geometry.Geometry(mesh, "form", "form", [source])
    inputs = collada.source.InputList()
    inputs.addInput(0, "VERTEX", "#points")
    form.primitives.append(form.createTriangleSet(np.array([0, 1, 2, 0, 2, 1]), inputs, "paint"))
    mesh.geometries.append(form)
    mesh.scene = collada.scene.Scene("all", [collada.scene.Node("one", [collada.scene.GeometryNode(form, [])])])
    mesh.scenes.append(mesh.scene)
    mesh.write(str(tmp_path / "wedge.dae"))
    (tmp_path / "wedge.urdf").write_text(
        f'<robot name="wedge"><link name="wedge">{INERTIAL.format(1)}'
        '<visual><geometry><mesh filename="wedge.dae" scale="2 2 2"/></geometry></visual></link></robot>'
    )
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    asset = GYM.load_asset(sim, str(tmp_path), "wedge.urdf", gymapi.AssetOptions())
    GYM.create_actor(env, asset, at(2, 0, 0), "wedge", 0, 0, 5)
    camera = GYM.create_camera_sensor(env, props())
    GYM.set_camera_location(camera, env, gymapi.Vec3(0, 0, 0), gymapi.Vec3(1, 0, 0))
    GYM.render_all_camera_sensors(sim)
    ids = GYM.get_camera_image(sim, env, camera, gymapi.IMAGE_SEGMENTATION)
    # A triangle of 2 m by 2 m, 2 m away, beside a picture of 4 m by 3 m.
    assert set(np.unique(ids)) == {0, 5} and (ids == 5).mean() == pytest.approx(2.0 / 12.0, abs=0.02)


def test_numbers_may_be_arrays_of_one() -> None:
    """Accept arrays of one number, as programs draw random ones."""
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    box = GYM.create_actor(env, GYM.create_box(sim, 0.1, 0.1, 0.1), at(0, 0, 1), "box", 0, 0)
    bodies, surfaces = GYM.get_actor_rigid_body_properties(env, box), GYM.get_actor_rigid_shape_properties(env, box)
    bodies[0].mass, bodies[0].com = np.array([2.5]), gymapi.Vec3(np.array([0.1]), torch.tensor([0.2]), np.float32(0.25))
    surfaces[0].friction = torch.tensor([0.75])
    GYM.set_actor_rigid_body_properties(env, box, bodies)
    GYM.set_actor_rigid_shape_properties(env, box, surfaces)
    after = GYM.get_actor_rigid_body_properties(env, box)[0]
    assert after.mass == 2.5 and tuple(after.com) == pytest.approx((0.1, 0.2, 0.25))
    assert GYM.get_actor_rigid_shape_properties(env, box)[0].friction == 0.75
    pose = gymapi.Transform()
    pose.p.x, pose.r.w = np.array([3.0]), torch.tensor(0.5)
    assert pose == gymapi.Transform(gymapi.Vec3(3, 0, 0), gymapi.Quat(0, 0, 0, 0.5))
    with pytest.raises(wc.WarpcamError, match="Vec3 has no 'w'; it has x, y, z"):
        pose.p.w = 1.0
    bodies[0].mass = np.array([2.5, 3.0])
    with pytest.raises(wc.WarpcamError, match="mass must be finite and not negative"):
        GYM.set_actor_rigid_body_properties(env, box, bodies)


def test_shapes_that_only_look_are_not_among_rigid_shapes(tmp_path: Path) -> None:
    """By whose places programs set frictions of feet and fingers, also of bodies that were made one."""
    seen, felt = (f"<{kind}><geometry><sphere radius='0.1'/></geometry></{kind}>" for kind in ("visual", "collision"))
    shapes = {"trunk": seen + seen + felt, "lamp": seen, "foot": seen + felt, "bump": felt}
    links = "".join(f'<link name="{name}">{INERTIAL.format(1)}{both}</link>' for name, both in shapes.items())
    joints = "".join(
        f'<joint name="{place}" type="{kind}"><parent link="trunk"/><child link="{name}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        for place, (name, kind) in enumerate((("lamp", "revolute"), ("foot", "revolute"), ("bump", "fixed")))
    )
    (tmp_path / "dog.urdf").write_text(f'<robot name="dog">{links}{joints}</robot>')
    sim = new_sim(wp.get_device("cpu"))
    asset = GYM.load_asset(sim, str(tmp_path), "dog.urdf", gymapi.AssetOptions(collapse_fixed_joints=True))
    ranges = GYM.get_asset_rigid_body_shape_indices(asset)
    assert GYM.get_asset_rigid_shape_count(asset) == len(GYM.get_asset_rigid_shape_properties(asset)) == 3
    assert [one.count for one in ranges] == [2, 0, 1] and (ranges[0].start, ranges[2].start) == (0, 2)
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    dog = GYM.create_actor(env, asset, at(0, 0, 1), "dog")
    properties = GYM.get_actor_rigid_shape_properties(env, dog)
    assert len(properties) == GYM.get_actor_rigid_shape_count(env, dog) == 3
    properties[GYM.get_actor_rigid_body_shape_indices(env, dog)[2].start].friction = 0.25
    GYM.set_actor_rigid_shape_properties(env, dog, properties)
    GYM.simulate(sim)
    model = sim.physics.model
    solid = model.shape_flags.numpy() & int(newton.ShapeFlags.COLLIDE_SHAPES) != 0
    assert model.shape_material_mu.numpy()[solid].tolist() == [1.0, 0.25, 1.0]


def test_joints_of_urdf_files_are_driven_by_nothing_unless_told(tmp_path: Path) -> None:
    (tmp_path / "dog.urdf").write_text(HELD)
    sim = new_sim(wp.get_device("cpu"))
    for mode in (gymapi.DOF_MODE_NONE, gymapi.DOF_MODE_POS, gymapi.DOF_MODE_EFFORT):
        asset = GYM.load_asset(sim, str(tmp_path), "dog.urdf", gymapi.AssetOptions(default_dof_drive_mode=mode))
        assert GYM.get_asset_dof_properties(asset)["driveMode"].tolist() == [mode]
    assert gymapi.AssetOptions().default_dof_drive_mode == gymapi.DOF_MODE_NONE


def test_rows_of_states_become_poses() -> None:
    """Convert rows as programs draw and compare them, one by one or as an array of one."""
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    pose = gymapi.Transform(gymapi.Vec3(1, 2, 3), gymapi.Quat(0, 1, 0, 0))
    box = GYM.create_actor(env, GYM.create_box(sim, 0.1, 0.1, 0.1), pose, "box")
    states = GYM.get_actor_rigid_body_states(env, box, gymapi.STATE_POS)
    assert gymapi.Transform.from_buffer(states["pose"][0]) == gymapi.Transform.from_buffer(states["pose"]) == pose
    assert gymapi.Vec3.from_buffer(states["pose"]["p"][0].tobytes()) == pose.p
    assert gymapi.Quat.from_buffer(memoryview(np.array([0, 1, 0, 0], np.float32))) == pose.r
    for row in (states[0], [1, 2, 3], "pose", None):
        with pytest.raises(wc.WarpcamError, match=r"Transform\.from_buffer: 7 numbers of float32 are needed, got"):
            gymapi.Transform.from_buffer(row)
    speed = gymapi.Velocity()
    speed.linear.x = 2.0
    assert tuple(speed.linear) == (2, 0, 0) and tuple(speed.angular) == (0, 0, 0)


def test_ids_of_segmentation_may_be_given_by_their_name() -> None:
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    box = GYM.create_actor(env, GYM.create_box(sim, 0.1, 0.1, 0.1), at(0, 0, 0), "box", 0, 0, segmentationId=11)
    assert GYM.get_rigid_body_segmentation_id(env, box, 0) == 11


@pytest.mark.parametrize("prepared", [False, True])
def test_flags_of_bodies_switch_gravity_off_and_on(prepared: bool) -> None:
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    for light in (False, True):
        ball = GYM.create_sphere(sim, 0.1, gymapi.AssetOptions(disable_gravity=light))
        for index in range(2):
            GYM.create_actor(env, ball, at(index, light, 5), "ball")
    if prepared:
        GYM.simulate(sim)
    for actor, flags in ((1, gymapi.RIGID_BODY_DISABLE_GRAVITY), (3, gymapi.RIGID_BODY_NONE)):
        bodies = GYM.get_actor_rigid_body_properties(env, actor)
        assert bodies[0].flags == 1 - flags
        bodies[0].flags = flags
        GYM.set_actor_rigid_body_properties(env, actor, bodies)
        assert GYM.get_actor_rigid_body_properties(env, actor)[0].flags == flags
    before = GYM.get_env_rigid_body_states(env, gymapi.STATE_VEL)["vel"]["linear"]["z"]
    GYM.simulate(sim)
    after = GYM.get_env_rigid_body_states(env, gymapi.STATE_VEL)["vel"]["linear"]["z"]
    np.testing.assert_allclose(after - before, -9.81 / 60.0 * np.array((1, 0, 0, 1)), atol=1e-4)
    bodies[0].flags = gymapi.RIGID_BODY_DISABLE_SIMULATION
    with pytest.raises(wc.WarpcamError, match="flags 2 came; of the flags RIGID_BODY_DISABLE_GRAVITY"):
        GYM.set_actor_rigid_body_properties(env, 3, bodies)


@pytest.mark.parametrize("kind", ["urdf", "xml"])
def test_bodies_without_masses_have_the_density_of_their_options(tmp_path: Path, kind: str) -> None:
    texts = {
        "urdf": '<robot name="can"><link name="can"><collision><geometry><box size="0.2 0.2 0.5"/></geometry>'
        "</collision></link></robot>",
        "xml": '<mujoco><worldbody><body name="can"><geom type="box" size="0.1 0.1 0.25"/></body></worldbody></mujoco>',
    }
    (tmp_path / f"can.{kind}").write_text(texts[kind])
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    for density in (1000.0, 50.0):
        asset = GYM.load_asset(sim, str(tmp_path), f"can.{kind}", gymapi.AssetOptions(density=density))
        can = GYM.create_actor(env, asset, at(0, 0, 0), "can")
        assert GYM.get_actor_rigid_body_properties(env, can)[0].mass == pytest.approx(0.02 * density)
    for density in (-1.0, float("nan"), "much"):
        with pytest.raises(wc.WarpcamError, match=r"load_asset: AssetOptions\.density must be finite"):
            GYM.load_asset(sim, str(tmp_path), f"can.{kind}", gymapi.AssetOptions(density=density))


def test_aggregates_that_would_keep_actors_apart_say_that_they_do_not() -> None:
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert GYM.begin_aggregate(env, 4, 4, True) and GYM.end_aggregate(env)
    with pytest.warns(RuntimeWarning, match="begin_aggregate: actors of an aggregate collide all the same"):
        assert GYM.begin_aggregate(env, 4, 4, False)
