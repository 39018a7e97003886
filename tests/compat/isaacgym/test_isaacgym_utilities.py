"""Utilities beside Isaac Gym's calls in its package: command lines, rotations, rough ground, random properties."""
# ruff: noqa: NPY002, as programs do

import importlib
import sys
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from scipy.spatial.transform import Rotation

import warpcam as wc

pytest.importorskip("newton")
from gym_worlds import GYM, at, new_sim

from warpcam.compat import isaacgym as package
from warpcam.compat.isaacgym import gymapi, gymutil, terrain_utils, torch_utils
from warpcam.compat.isaacgym.api.math_types import matrix_of
from warpcam.compat.isaacgym.terrain import heightfield_from_mesh

RNG = np.random.default_rng(4)
TURNS, OTHERS = Rotation.random(6, rng=RNG), Rotation.random(6, rng=RNG)
VECTORS, MORE = RNG.normal(size=(2, 6, 3))


def tensor(values: Any) -> torch.Tensor:
    return torch_utils.to_torch(values, device="cpu")


Q, P, V, W = tensor(TURNS.as_quat()), tensor(OTHERS.as_quat()), tensor(VECTORS), tensor(MORE)


def close(found: torch.Tensor, expected: Any) -> None:
    torch.testing.assert_close(found, tensor(np.asarray(expected)), atol=1e-5, rtol=1e-5)


def same_turns(found: torch.Tensor, expected: Rotation) -> None:
    close((found * tensor(expected.as_quat())).sum(dim=-1).abs(), np.ones(len(found)))


def test_import_isaacgym_is_this_package() -> None:
    assert "isaacgym" not in sys.modules
    package.install()
    package.install()
    try:
        assert importlib.import_module("isaacgym") is package
        for name in ("gymapi", "gymtorch", "gymutil", "terrain_utils", "torch_utils"):
            assert importlib.import_module(f"isaacgym.{name}") is getattr(package, name)
    finally:
        package.uninstall()
    assert not [name for name in sys.modules if name.startswith("isaacgym")]


def test_another_isaacgym_is_not_put_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "isaacgym", importlib.import_module("warpcam"))
    with pytest.raises(wc.WarpcamError, match="isaacgym has been imported already"):
        package.install()
    package.uninstall()
    assert sys.modules["isaacgym"] is wc


def test_rotations_are_those_of_scipy() -> None:
    close(torch_utils.quat_rotate(Q, V), TURNS.apply(VECTORS))
    close(torch_utils.quat_rotate_inverse(Q, V), TURNS.inv().apply(VECTORS))
    close(torch_utils.get_basis_vector(Q, V), TURNS.apply(VECTORS))
    close(torch_utils.tf_vector(Q, V), TURNS.apply(VECTORS))
    same_turns(torch_utils.quat_mul(Q, P), TURNS * OTHERS)
    same_turns(torch_utils.quat_conjugate(Q), TURNS.inv())
    same_turns(torch_utils.quat_unit(3.0 * Q), TURNS)
    angle = torch.linspace(-2.0, 2.0, 6)
    axis = VECTORS / np.linalg.norm(VECTORS, axis=1, keepdims=True)
    same_turns(torch_utils.quat_from_angle_axis(angle, 2.0 * V), Rotation.from_rotvec(angle.numpy()[:, None] * axis))
    angles = torch_utils.get_euler_xyz(Q)
    close(torch.stack(angles, dim=-1), TURNS.as_euler("xyz") % (2.0 * np.pi))
    same_turns(torch_utils.quat_from_euler_xyz(*angles), TURNS)


def test_many_vectors_are_turned_by_each() -> None:
    """Rotate points about each robot, as programs do."""
    points = V[None].repeat(6, 1, 1)
    turned = torch_utils.quat_apply(Q.repeat(1, 6), points)
    assert turned.shape == points.shape
    close(turned[2], TURNS[2].apply(VECTORS))


def test_poses_are_combined_and_inverted() -> None:
    turns, places = torch_utils.tf_combine(Q, V, P, W)
    same_turns(turns, TURNS * OTHERS)
    close(torch_utils.tf_apply(turns, places, V), TURNS.apply(OTHERS.apply(VECTORS) + MORE) + VECTORS)
    back = torch_utils.tf_inverse(Q, V)
    close(torch_utils.tf_apply(*back, torch_utils.tf_apply(Q, V, W)), MORE)


def test_numbers_are_scaled_and_clamped() -> None:
    low, high = torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0])
    x = torch.tensor([[-1.0, 1.0], [0.5, 0.0]])
    scaled = torch_utils.scale(x, low, high)
    close(scaled, [[-2.0, 1.0], [1.0, 0.5]])
    close(torch_utils.unscale(scaled, low, high), x)
    np.testing.assert_allclose(torch_utils.unscale_np(scaled.numpy(), low.numpy(), high.numpy()), x)
    close(torch_utils.tensor_clamp(3.0 * x, low, high), [[-2.0, 1.0], [1.5, 0.0]])
    close(torch_utils.normalize(torch.zeros(1, 3)), [[0.0, 0.0, 0.0]])
    close(torch_utils.normalize_angle(torch.tensor([3.5, -3.5])), [3.5 - 2.0 * np.pi, 2.0 * np.pi - 3.5])
    close(torch_utils.copysign(-2.0, torch.tensor([-1.0, 3.0])), [-2.0, 2.0])
    assert torch_utils.get_axis_params(9.8, 2) == [0.0, 0.0, 9.8]
    assert torch_utils.get_axis_params(-1.0, 1, x_value=0.5) == [0.5, -1.0, 0.0]
    some = torch_utils.torch_rand_float(-3.0, -1.0, (500, 2), "cpu")
    assert some.shape == (500, 2) and -3.0 <= some.min() < -2.9 < -1.1 < some.max() <= -1.0
    aside = torch_utils.torch_random_dir_2((500, 1), "cpu")
    close(aside.norm(dim=-1), np.ones(500))
    assert (aside.mean(dim=0).abs() < 0.2).all()


@pytest.mark.filterwarnings("ignore")  # torch's, about TorchScript
def test_a_programs_own_script_may_call_them() -> None:
    names = [name for name in torch_utils.__all__ if name not in ("np", "torch", "to_torch", "get_axis_params")]
    for name in names:
        if name != "unscale_np":
            torch.jit.script(getattr(torch_utils, name))
    close(torch.jit.script(torch_utils.tf_combine)(Q, V, P, W)[1], TURNS.apply(MORE) + VECTORS)


def parsed(monkeypatch: pytest.MonkeyPatch, line: str, **more: Any) -> Any:
    monkeypatch.setattr(sys, "argv", ["program", *line.split()])
    return gymutil.parse_arguments(**more)


def test_command_lines_name_devices(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    own = [
        {"name": "--task", "type": str, "default": "walk", "help": "which"},
        {"name": "--seed", "type": int},
        {"name": "--resume", "action": "store_true", "default": False},
    ]
    args = parsed(monkeypatch, "--seed 3 --sim_device cuda:1 --subscenes 2", custom_parameters=own)
    assert (args.task, args.seed, args.resume) == ("walk", 3, False)
    assert (args.sim_device_type, args.compute_device_id, args.graphics_device_id) == ("cuda", 1, 0)
    assert args.use_gpu and args.use_gpu_pipeline and args.physics_engine is gymapi.SIM_PHYSX and args.slices == 2
    assert not hasattr(args, "headless")
    args = parsed(monkeypatch, "--sim_device cpu --flex --nographics", headless=True, no_graphics=True)
    assert (args.sim_device_type, args.compute_device_id, args.use_gpu) == ("cpu", 0, False)
    assert not args.use_gpu_pipeline and args.headless and args.physics_engine is gymapi.SIM_FLEX
    assert "--pipeline becomes cpu" in capsys.readouterr().out
    assert parsed(monkeypatch, "").sim_device == ("cuda:0" if wp.is_cuda_available() else "cpu")
    for line, more, message in (
        ("--pipeline tpu", {}, "--pipeline 'tpu' came"),
        ("--sim_device gpu", {}, "parse_device_str: 'gpu' came"),
        ("", {"custom_parameters": [{"name": "--a"}]}, "a name, a type or an action"),
        ("", {"custom_parameters": [{"name": "--a", "type": int, "hlep": ""}]}, "a name, a type or an action"),
    ):
        with pytest.raises(wc.WarpcamError, match=message):
            parsed(monkeypatch, line, **more)
    for device in ("cpu:1", "cuda:", "cuda:first"):
        with pytest.raises(wc.WarpcamError, match=f"'{device}' came"):
            gymutil.parse_device_str(device)
    assert gymutil.parse_bool("Yes") and not gymutil.parse_bool("0")
    with pytest.raises(wc.WarpcamError, match="parse_bool: 'maybe' came"):
        gymutil.parse_bool("maybe")


def test_tables_become_simulation_parameters() -> None:
    params = gymapi.SimParams()
    physx = {"num_threads": 10, "contact_collection": 1, "rest_offset": 0}
    table = {"dt": 0.005, "substeps": 1, "up_axis": 1, "gravity": [0.0, 0.0, -9.81], "physx": physx}
    gymutil.parse_sim_config({**table, "flex": {"num_outer_iterations": 4}}, params)
    assert (params.dt, params.substeps, params.up_axis) == (0.005, 1, gymapi.UP_AXIS_Z)
    assert params.gravity == gymapi.Vec3(0, 0, -9.81) and params.physx.num_threads == 10
    assert params.physx.contact_collection is gymapi.CC_LAST_SUBSTEP and params.physx.rest_offset == 0.0
    assert params.flex.num_outer_iterations == 4
    for name, value in (
        ("gravity", [0.0, -9.8]), ("gravity", 9.8), ("substeps", 2.5), ("use_gpu_pipeline", "False"),
        ("use_gpu_pipeline", 2), ("up_axis", "z"), ("dt", None),
    ):  # fmt: skip
        with pytest.raises(wc.WarpcamError, match=f"{name} of SimParams must be as .* is, a .*, got"):
            gymutil.parse_sim_config({name: value}, params)
    gymutil.parse_sim_config({"dt": "1e-3", "use_gpu_pipeline": 1}, params)  # 1e-3 is a word in YAML
    assert params.dt == 0.001 and params.use_gpu_pipeline is True
    with pytest.raises(wc.WarpcamError, match="PhysXParams has no 'num_threds'"):
        gymutil.parse_physx_config({"num_threds": 2}, params)


def test_a_programs_own_asset_is_written_in_lines() -> None:
    tree = ElementTree.fromstring("<a><b><c/></b></a>")
    gymutil._indent_xml(tree)
    assert ElementTree.tostring(tree) == b"<a>\n  <b>\n    <c />\n  </b>\n</a>"


def test_lines_are_where_their_pose_is_and_no_window_is_there() -> None:
    pose = gymapi.Transform(gymapi.Vec3(1, 2, 3), gymapi.Quat.from_axis_angle(gymapi.Vec3(0, 0, 1), np.pi / 2))
    axes = gymutil.AxesGeometry(0.5, pose)
    assert axes.num_lines() == 3 and axes.colors()["y"].tolist() == [0.0, 1.0, 0.0]
    ends = axes.instance_verts(pose)[:, 1]
    expected = [pose.transform_point(pose.transform_point(gymapi.Vec3(*(0.5 * axis)))) for axis in np.eye(3)]
    np.testing.assert_allclose([list(end) for end in ends], [tuple(each) for each in expected], atol=1e-6)
    turned = pose.transform_vectors(np.array([(1.0, 0.0, 0.5)], gymapi.Vec3.dtype))
    np.testing.assert_allclose(list(turned[0]), matrix_of(pose.r) @ (1.0, 0.0, 0.5), atol=1e-6)

    box = gymutil.WireframeBoxGeometry(2.0, 4.0, 6.0, None, (0, 0, 1))
    corners = {tuple(end) for line in box.vertices() for end in line}
    assert box.num_lines() == 12 and corners == {(x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)}
    apart = [sum(a != b for a, b in zip(*line, strict=True)) for line in box.vertices()]
    assert apart == [1] * 12 and len({frozenset(map(tuple, line)) for line in box.vertices()}) == 12
    some = gymutil.WireframeBBoxGeometry(torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 2.0]]))
    assert some.vertices()["z"].max() == 2.0 and some.colors()["x"].min() == 1.0
    with pytest.raises(wc.WarpcamError, match=r"bbox must be two corners, \(2, 3\), got shape \(1, 3\)"):
        gymutil.WireframeBBoxGeometry(np.zeros((1, 3)))

    ball = gymutil.WireframeSphereGeometry(0.3, 4, 5, None, (1, 1, 0), (0, 1, 1))
    places = np.array([list(end) for line in ball.vertices() for end in line])
    assert ball.num_lines() == 40 and {color.item() for color in ball.colors()} == {(1, 1, 0), (0, 1, 1)}
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 0.3, rtol=1e-6)
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    with pytest.raises(wc.WarpcamError, match="add_lines is not here: there is no window"):
        gymutil.draw_lines(ball, GYM, None, env, pose)
    with pytest.raises(wc.WarpcamError, match="add_lines is not here: there is no window"):
        gymutil.draw_line(gymapi.Vec3(), gymapi.Vec3(1, 0, 0), gymapi.Vec3(), GYM, None, env)


def ground(width: int = 60, length: int = 40) -> terrain_utils.SubTerrain:
    return terrain_utils.SubTerrain("some", width, length, vertical_scale=0.005, horizontal_scale=0.1)


def test_hills_and_stairs_are_as_high_as_they_are_told_to_be() -> None:
    hill = terrain_utils.pyramid_sloped_terrain(ground(40, 40), slope=0.5, platform_size=1.0).height_field_raw
    assert hill[20, 20] == hill[16, 22] == hill[15:25, 15:25].min() == hill.max() and hill[0].max() == 0
    rises = np.diff(hill[:12, 20].astype(int))
    np.testing.assert_allclose(rises * 0.005 / 0.1, 0.5, atol=0.06)
    hole = terrain_utils.pyramid_sloped_terrain(ground(40, 40), slope=-0.5).height_field_raw
    assert hole.max() == 0 and hole[20, 20] == hole.min() < 0
    slope = terrain_utils.sloped_terrain(ground(), slope=0.25).height_field_raw
    assert slope[-1, 0] - slope[0, 0] == int(0.25 * 20 * 60 * 59 / 60) and (slope == slope[:, :1]).all()
    stairs = terrain_utils.stairs_terrain(ground(), 0.55, 0.1).height_field_raw
    assert stairs[:5].max() == stairs[:5].min() == 20 and stairs[5, 0] == 40 and stairs[59, 3] == 12 * 20
    pyramid = terrain_utils.pyramid_stairs_terrain(ground(40, 40), 0.31, -0.05, 1.0).height_field_raw
    assert pyramid[0, 0] == 0 and pyramid[3, 20] == -10 and pyramid[20, 20] == -50 and pyramid[2].max() == 0
    waves = terrain_utils.wave_terrain(ground(40, 40), num_waves=2, amplitude=0.2).height_field_raw
    assert waves.max() == 40 and waves.min() == -40 and np.abs(waves[5] - waves[25]).max() <= 1
    assert not terrain_utils.wave_terrain(ground(), 0).height_field_raw.any()
    for call, message in (
        (lambda: terrain_utils.stairs_terrain(ground(), 0.05, 0.1), "step_width must be at least the 0.1 m"),
        (lambda: terrain_utils.stepping_stones_terrain(ground(), 0.0, 0.1, 0.1), "stone_size must be at least"),
        (lambda: terrain_utils.random_uniform_terrain(ground(), -0.1, 0.1, 0.001), "step must be at least vertical"),
        (lambda: terrain_utils.discrete_obstacles_terrain(ground(), 0.1, 2.0, 2.0, 3), "less than max_size"),
    ):
        with pytest.raises(wc.WarpcamError, match=message):
            call()


def test_random_ground_has_the_heights_that_are_allowed() -> None:
    np.random.seed(3)
    rough = terrain_utils.random_uniform_terrain(ground(), -0.05, 0.05, 0.02, 0.5).height_field_raw.astype(int)
    assert -10 <= rough.min() < -6 and 6 < rough.max() <= 10
    assert np.abs(np.diff(rough, axis=0)).max() <= 20 / 5 + 1  # straight lines from one to the next
    fine = terrain_utils.random_uniform_terrain(ground(), -0.05, 0.05, 0.05).height_field_raw
    assert set(np.unique(fine)) == {-10, 0, 10}
    assert terrain_utils.random_uniform_terrain(ground(), 0.0, 0.1, 0.005, 0.075).height_field_raw.shape == (60, 40)
    blocks = terrain_utils.discrete_obstacles_terrain(ground(80, 80), 0.1, 1.0, 2.0, 30, 2.0).height_field_raw
    assert set(np.unique(blocks)) == {-20, -10, 0, 10, 20} and not blocks[30:50, 30:50].any()
    for shape in ((60, 40), (40, 60)):
        stones = terrain_utils.stepping_stones_terrain(ground(*shape), 0.5, 0.2, 0.01, 1.0, -1.0).height_field_raw
        assert set(np.unique(stones)) == {-200, -3, -2, -1, 0, 1}
        middle = tuple(slice(count // 2 - 5, count // 2 + 5) for count in shape)
        assert not stones[middle].any() and 0.15 < (stones == -200).mean() < 0.6
        rows = stones if shape[0] > shape[1] else stones.T
        assert (rows[5:7] == -200).all() and not (rows[:5] == -200).all()


def test_triangles_of_samples_are_found_again_as_heights() -> None:
    """Upright walls are where the higher samples are."""
    samples = np.zeros((12, 9), np.int16)
    samples[4:8, 3:6], samples[10, 7] = 30000, -30000
    for threshold in (None, 0.75):
        vertices, triangles = terrain_utils.convert_heightfield_to_trimesh(samples, 0.1, 0.005, threshold)
        assert vertices.shape == (108, 3) and triangles.shape == (2 * 11 * 8, 3) and triangles.dtype == np.uint32
        a, b, c = (vertices[triangles[:, corner], :2] for corner in range(3))
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        assert (area > -1e-6).all()  # they look up
        found = heightfield_from_mesh.heights_of(vertices, triangles.astype(np.int64))
        assert found is not None
        np.testing.assert_allclose(found[0] / 0.005, samples, atol=1e-2)
        walls = (area < 1e-6).sum()
        assert walls == 0 if threshold is None else walls > 20


TABLE = {"range": [0.5, 1.5], "operation": "scaling", "distribution": "uniform"}


def test_random_numbers_follow_their_table() -> None:
    np.random.seed(5)

    def some(step: int = 0, **changes: Any) -> np.ndarray:
        return gymutil.generate_random_samples({**TABLE, **changes}, 2000, step)

    assert 0.5 <= some().min() < 0.55 and 1.45 < some().max() <= 1.5
    late = {"schedule": "linear", "schedule_steps": 100}
    assert (some(0, **late) == 1.0).all() and np.ptp(some(50, **late)) == pytest.approx(0.5, abs=0.02)
    assert np.ptp(some(400, **late)) > 0.9
    held = {"schedule": "constant", "schedule_steps": 10, "operation": "additive"}
    assert (some(9, **held) == 0.0).all() and some(10, **held).mean() == pytest.approx(1.0, abs=0.05)
    normal = some(distribution="gaussian", range=[2.0, 0.1])
    assert normal.mean() == pytest.approx(2.0, abs=0.01) and normal.std() == pytest.approx(0.1, abs=0.01)
    logs = np.log(some(distribution="loguniform", range=[0.01, 100.0]))
    assert logs.mean() == pytest.approx(0.0, abs=0.3) and logs.std() == pytest.approx(np.log(1e4) / 12**0.5, abs=0.2)
    assert gymutil.generate_random_samples({**TABLE, **late}, 1, 25, extern_sample=3.0) == 1.5
    for name, value in (("distribution", "even"), ("operation", "times"), ("schedule", "later")):
        with pytest.raises(wc.WarpcamError, match=f"{name} '{value}' came; allowed are"):
            some(**{"schedule_steps": 1, name: value})


def test_random_properties_reach_actors() -> None:
    sim = new_sim(wp.get_device("cpu"))
    env = GYM.create_env(sim, gymapi.Vec3(), gymapi.Vec3(), 1)
    box = GYM.create_actor(env, GYM.create_box(sim, 0.1, 0.1, 0.1), at(0, 0, 1), "box", 0, 0)
    get, put = gymutil.get_property_getter_map(GYM), gymutil.get_property_setter_map(GYM)
    more, table = gymutil.get_default_setter_args(GYM), {**TABLE, "range": [2.0, 2.0]}
    for kind, attribute in (("rigid_body_properties", "mass"), ("rigid_shape_properties", "friction")):
        properties = get[kind](env, box)
        first = {attribute: getattr(properties[0], attribute)}
        gymutil.apply_random_samples(properties[0], first, attribute, table, 0)
        put[kind](env, box, properties, *more[kind])
        assert getattr(get[kind](env, box)[0], attribute) == pytest.approx(2.0 * first[attribute])
    buckets = {**TABLE, "range": [0.0, 1.0], "operation": "additive", "num_buckets": 4}
    friction = get["rigid_shape_properties"](env, box)[0]
    gymutil.apply_random_samples(friction, {"friction": 0.0}, "friction", buckets, 0, extern_sample=0.6)
    assert friction.friction == 0.5
    drives = np.zeros(3, [("stiffness", "f4")])
    gymutil.apply_random_samples(drives, {"stiffness": np.full(3, 4.0)}, "stiffness", table, 0)
    assert drives["stiffness"].tolist() == [8.0] * 3
    params = get["sim_params"](sim)
    gymutil.apply_random_samples(params, {"gravity": gymapi.Vec3(0, 0, -5)}, "gravity", table, 0)
    gymutil.apply_random_samples(params, {}, "rest_offset", table, 0)
    put["sim_params"](sim, params)
    assert get["sim_params"](sim).gravity == gymapi.Vec3(0, 0, -10) and params.physx.rest_offset == 2.0
    with pytest.raises(wc.WarpcamError, match="gravity and rest_offset may change, not 'dt'"):
        gymutil.apply_random_samples(params, {}, "dt", table, 0)

    def check(count: int) -> None:
        shapes = {"friction": {"num_buckets": count}, "restitution": {"num_buckets": count}}
        gymutil.check_buckets(GYM, [env], {"actor_params": {"box": {"rigid_shape_properties": shapes}}})

    check(0)
    check(250)
    with pytest.raises(wc.WarpcamError, match="at most 64000 surfaces may differ, got 65536"):
        check(256)
