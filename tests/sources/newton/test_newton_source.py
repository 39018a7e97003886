"""Newton's scenes as a whole: bounds, labels, and what is refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton")
import newton_scenes  # noqa: E402, newton may be missing
from newton_scenes import eye, finalize, pose  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own


def test_bounds_are_those_of_what_is_seen(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_mesh(-1, mesh=newton_scenes.tetrahedron((1, 1, 1)), scale=(-2.0, 1.0, 3.0))
    builder.add_shape_cone(-1, radius=0.5, half_height=1.0, xform=pose(0.0, 4.0, 0.0))
    builder.add_shape_cylinder(-1, radius=0.3, half_height=0.5, barrel_radius=0.5, xform=pose(0.0, 6.0, 0.0))
    hidden = newton.ModelBuilder.ShapeConfig(is_visible=False)
    builder.add_shape_sphere(-1, radius=50.0, cfg=hidden)
    model, state = finalize(builder, device)
    low, high = wc.from_newton(model, state).bounds()
    assert low == pytest.approx((-2.0, 0.0, -1.0), abs=1e-5)
    assert high == pytest.approx((0.8, 6.8, 3.0), abs=1e-5)


def test_an_empty_model_shows_nothing(device: wp.Device) -> None:
    model, state = finalize(newton.ModelBuilder(), device)
    seen = scenes.look(wc.from_newton(model, state), eye())
    assert np.isinf(seen["depth"]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (lambda m, s: ("model", s), "model must be a newton.Model, got str"),
        (lambda m, s: (m, m), "state must be a newton.State, got Model"),
        (
            lambda m, s: (m, newton.ModelBuilder().finalize(device=m.device).state()),
            "state was made from another model",
        ),
    ],
)
def test_bad_arguments(device: wp.Device, arguments: Any, message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(*arguments(model, state))
    scene = wc.from_newton(model, state)
    with pytest.raises(wc.WarpcamError, match=r"state must be a newton\.State, got int"):
        scene.bind(3)


@pytest.mark.parametrize("what", ["bodies", "particles", "joint coordinates", "joint degrees of freedom"])
def test_a_state_of_another_model_is_refused_by_what_it_has(device: wp.Device, what: str) -> None:
    """The other model has as many of all else.

    A state keeps no link to its model: one that has as many of everything cannot be told.
    """

    def made(other: bool) -> tuple[Any, Any]:
        builder = newton.ModelBuilder()
        links = [builder.add_link(mass=1.0) for _ in range(2)]
        for link in links:
            builder.add_shape_sphere(link, radius=0.1)
        ball = other and what.startswith("joint")
        first = builder.add_joint_revolute(-1, links[0])
        if ball:  # of three degrees of freedom and four coordinates
            second = builder.add_joint_ball(links[0], links[1])
        else:
            second = builder.add_joint_revolute(links[0], links[1])
        builder.add_articulation([first, second])
        if other and what == "bodies":
            builder.add_body()
        for _ in range(3 if other and what == "particles" else 2):
            builder.add_particle(wp.vec3(0.0, -1.0, 1.0), wp.vec3(), 0.1, radius=0.1)
        return finalize(builder, device)

    model, state = made(False)
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [eye()])
    before = scenes.on_host(renderer.render()["eye"])["depth"]
    other = made(True)[1]
    if what == "joint degrees of freedom":  # the coordinates are looked at before
        other.joint_q = wp.clone(state.joint_q)
    if what == "bodies":
        other.joint_q = other.joint_qd = None
    with pytest.raises(wc.WarpcamError, match=f"state was made from another model: it has . {what}, model has ."):
        scene.bind(other)
    assert (scenes.on_host(renderer.render()["eye"])["depth"] == before).all()


@pytest.mark.skipif(len(wp.get_devices()) < 2, reason="there is one device")
def test_a_model_and_a_state_on_two_devices() -> None:
    model, _ = finalize(newton_scenes.zoo(), wp.get_device("cpu"))
    _, state = finalize(newton_scenes.zoo(), wp.get_device("cuda:0"))
    with pytest.raises(wc.WarpcamError, match="device: state is on cuda:0, but model is on cpu; both must be on one"):
        wc.from_newton(model, state)


@pytest.mark.parametrize("what", ["body_q", "particle_q"])
def test_a_state_on_another_device_is_refused_and_the_old_one_kept(device: wp.Device, what: str) -> None:
    """The other device is made up, so that one is enough."""
    builder = newton_scenes.zoo()
    builder.add_particle(wp.vec3(0.0, -1.0, 1.0), wp.vec3(), 0.1, radius=0.1)
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    renderer = wc.Renderer(scene, [eye()])
    before = scenes.on_host(renderer.render()["eye"])["depth"]
    other = model.state()
    elsewhere = SimpleNamespace(alias="cuda:7")
    setattr(other, what, SimpleNamespace(shape=getattr(state, what).shape, device=elsewhere))
    message = f"device: state is on cuda:7, but model is on {device.alias}; both must be on one"
    with pytest.raises(wc.WarpcamError, match=message):
        scene.bind(other)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, other)
    assert (scenes.on_host(renderer.render()["eye"])["depth"] == before).all()


def test_a_mesh_with_bad_indices_is_named(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    mesh = newton_scenes.tetrahedron()
    builder.add_shape_mesh(-1, mesh=mesh, label="broken")
    model, state = finalize(builder, device)
    mesh.indices[4] = 77
    with pytest.raises(wc.WarpcamError, match=r"mesh of shape 'broken'.*from 0 to 3, got \[0, 77, 3\] at face 1"):
        wc.from_newton(model, state)


def test_a_joint_that_closes_a_loop_takes_no_body_from_its_articulation(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    links = [builder.add_link(xform=wp.transform((x, 0.0, 0.0), wp.quat_identity())) for x in (-0.5, 0.5)]
    for link in links:
        builder.add_shape_sphere(link, radius=0.4)
    joints = [builder.add_joint_revolute(-1, links[0]), builder.add_joint_revolute(links[0], links[1])]
    builder.add_articulation(joints, label="arm")
    builder.add_joint_ball(-1, links[1])
    model, state = newton_scenes.finalize(builder, device)
    scene = wc.from_newton(model, state, semantics={"arm": 5})
    seen = scenes.look(scene, eye(outputs=("segmentation", "instances", "semantics")))
    there = seen["segmentation"] >= 0
    assert set(np.unique(seen["segmentation"][there])) == {0, 1}
    assert (seen["instances"][there] == 0).all() and (seen["semantics"][there] == 5).all()


def test_labels_of_articulations_bodies_and_paths(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    robot = newton.ModelBuilder()
    hand = robot.add_link(label="robot/arm/hand", xform=pose(0.0, 0.0, 1.0))
    arm = robot.add_link(label="robot/arm", xform=pose(0.8, 0.0, 1.0))
    joints = [robot.add_joint_fixed(-1, arm), robot.add_joint_fixed(arm, hand)]
    robot.add_articulation(joints, label="robot")
    robot.add_shape_sphere(arm, radius=0.2, label="robot/arm/upper")
    robot.add_shape_sphere(hand, radius=0.2, label="robot/arm/hand/palm")
    robot.add_shape_box(robot.add_body(label="mug", xform=pose(-0.8, 0.0, 1.0)), hx=0.1, hy=0.1, hz=0.1)
    bare = newton.ModelBuilder()
    bare.add_shape_box(bare.add_body(label="mug", xform=pose(0.0, 0.0, 1.0)), hx=0.1, hy=0.1, hz=0.1, label="lid")
    builder = newton.ModelBuilder()
    builder.add_world(robot)
    builder.add_world(bare)
    builder.add_world(robot)
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    numbers = {"arm": 1, "hand": 2, "arm/hand": 3, "mug": 4, "lid": 5, "ground_plane": 6, "tail": 7}
    scene = wc.from_newton(model, state, semantics=numbers)
    assert caplog.messages == ["from_newton: semantics has names that no shape is part of: 'tail'"]
    seen = scenes.look(scene, eye(outputs=("segmentation", "instances", "semantics")))
    expected = {"upper": 1, "palm": 3, "mug": 4, "lid": 5, "ground_plane": 6}
    for world in range(3):
        for shape in np.unique(seen["segmentation"][world]):
            there = seen["segmentation"][world] == shape
            body = int(model.shape_body.numpy()[shape]) if shape >= 0 else -1
            names = {model.shape_label[shape].split("/")[-1], model.body_label[body] if body >= 0 else ""}
            of = [expected[name] for name in expected if shape >= 0 and name in names]
            assert set(np.unique(seen["semantics"][world][there])) == {max(of) if of else 0}, (world, shape)
            articulation = {"robot/arm": 0, "robot/arm/hand": 0, "mug": 1}.get(model.body_label[body], -1)
            instance = -1 if body < 0 else (articulation, 2, 3 + articulation)[world]
            assert set(np.unique(seen["instances"][world][there])) == {instance}, (world, shape)
    assert set(np.unique(seen["semantics"])) == {0, 1, 3, 4, 5, 6}
    assert set(np.unique(seen["instances"])) == {-1, 0, 1, 2, 3, 4}
    for outputs in (("instances",), ("semantics", "instances"), ("semantics", "flow_valid", "rgb")):
        alone = scenes.look(scene, eye(outputs=outputs))
        for name in {"instances", "semantics"} & set(outputs):
            np.testing.assert_array_equal(alone[name], seen[name])
    plain = scenes.look(wc.from_newton(model, state), eye(outputs=("semantics",)))
    assert (plain["semantics"] == 0).all()


@pytest.mark.parametrize(
    ("semantics", "message"),
    [
        (("mug",), "semantics must map labels to whole numbers, got tuple"),
        ({"mug": "one"}, "semantics: must map labels to whole numbers, got 'mug': 'one'"),
    ],
)
def test_bad_labels(device: wp.Device, semantics: Any, message: str) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    with pytest.raises(wc.WarpcamError, match=message):
        wc.from_newton(model, state, semantics=semantics)
