"""Live parts of Newton's scenes: states, arrays that are written in place, cameras on bodies."""

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


def test_states_are_swapped_without_rebuilding(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, first = finalize(builder, device)
    second = model.state()
    poses = second.body_q.numpy()
    poses[:, 2] += 0.4
    second.body_q.assign(poses)
    scene = wc.from_newton(model, first)
    renderer = wc.Renderer(scene, [eye()])
    low = scenes.on_host(renderer.render()["eye"])
    tables, recorded = scene.tables(), []
    for _ in range(3):
        scene.bind(second)
        high = scenes.on_host(renderer.render()["eye"])
        scene.bind(first)
        assert (scenes.on_host(renderer.render()["eye"])["depth"] == low["depth"]).all()
        recorded.append(list(renderer._recordings.values()))
    assert (high["depth"] != low["depth"]).any()
    fresh = scenes.look(wc.from_newton(model, second), eye())
    assert (high["depth"] == fresh["depth"]).all() and (high["segmentation"] == fresh["segmentation"]).all()
    assert scene.tables() is tables
    assert recorded[0] == recorded[1] == recorded[2] and len(recorded[0]) == 2
    for _ in range(20):
        scene.bind(model.state())
        renderer.render()
    assert len(renderer._recordings) <= 4


def change(array: wp.array, rows: Any, value: Any) -> None:
    scenes.write(array, rows, value)


LIVE = {
    "colour": (lambda m, s: change(m.shape_color, 0, (1.0, 0.0, 0.0)), "albedo"),
    "scale": (lambda m, s: change(m.shape_scale, 0, (0.1, 0.0, 0.0)), "depth"),
    "scale of a mesh": (lambda m, s: change(m.shape_scale, 7, (1.0, 1.0, -1.0)), "depth"),
    "transform": (lambda m, s: change(m.shape_transform, (1, 2), 1.2), "depth"),
    "flags": (lambda m, s: change(m.shape_flags, 2, 6), "segmentation"),
    "opacity": (lambda m, s: change(m.shape_opacity, 3, 0.0), "segmentation"),
    "pose": (lambda m, s: change(s.body_q, (0, 2), 0.5), "depth"),
}


@pytest.mark.parametrize("what", LIVE)
def test_what_changes_in_place_is_seen(device: wp.Device, what: str) -> None:
    write, output = LIVE[what]
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    camera = eye(outputs=("depth", "segmentation", "albedo"))
    renderer = wc.Renderer(wc.from_newton(model, state), [camera])
    before = scenes.on_host(renderer.render()["eye"])
    write(model, state)
    after = scenes.on_host(renderer.render()["eye"])
    assert (after[output][0] != before[output][0]).any()
    assert (after[output][1] == before[output][1]).all()
    fresh = scenes.look(wc.from_newton(model, state), camera)
    assert all((after[name] == fresh[name]).all() for name in after)


def test_a_graph_of_ones_own_reads_live_poses(device: wp.Device) -> None:
    model, state = finalize(newton_scenes.zoo(), device)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    before = scenes.on_host(renderer.render()["eye"])
    with wp.ScopedCapture(device) as capture:
        renderer.render()
    change(state.body_q, (0, 2), 0.5)
    wp.capture_launch(capture.graph)
    wp.synchronize_device(device)
    after = scenes.on_host(renderer.images["eye"])
    assert (after["depth"] != before["depth"]).any()
    assert (after["depth"] == scenes.look(wc.from_newton(model, state), eye())["depth"]).all()


@pytest.mark.parametrize("prefix", ["", "env"])
def test_a_camera_rides_on_a_body_of_each_world(device: wp.Device, prefix: str) -> None:
    builder = newton.ModelBuilder()
    for world, kinds in enumerate((("arm", "base"), ("base", "arm"), ("base", "leg"))):
        part = newton.ModelBuilder()
        for place, name in enumerate(kinds):
            body = part.add_body(label=name, xform=pose(0.0, 0.0, 1.0 + world if name == "arm" else 9.0))
            part.add_shape_box(body, hx=0.1, hy=0.1, hz=0.1, xform=pose(0.0, 0.0, 20.0 + place))
        builder.add_world(part, label_prefix=f"{prefix}{world}" if prefix else None)
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    first = model.body_label[0]
    for parent in (first, "arm", 0, 3):
        renderer = wc.Renderer(scene, [eye(position=(0, 0, 0), rotation=(1, 0, 0, 0), parent=parent)])
        depth = renderer.render()["eye"]["depth"][:, 32, 48, 0].tolist()
        assert depth == pytest.approx([1.0, 2.0, np.inf])
        assert renderer.faulty.tolist() == [0, 0, 1]
    with pytest.raises(
        wc.WarpcamError, match=r"eye.*parent: the scene has no body 'tail'; it has: 'arm', 'base', 'leg'"
    ):
        wc.Renderer(scene, [eye(parent="tail")])
    with pytest.raises(wc.WarpcamError, match="no body 6; it has indices 0 to 5"):
        wc.Renderer(scene, [eye(parent=6)])


@pytest.mark.parametrize("prefix", ["", "env_"])
@pytest.mark.parametrize("more", [(0, 1), (1, 0)])
def test_a_camera_rides_on_one_robot_beside_other_things(device: wp.Device, prefix: str, more: tuple[int, int]) -> None:
    """The labels of one world begin with more that is alike if only the other has a thing beside the robot."""
    builder = newton.ModelBuilder()
    for world, things in enumerate(more):
        part = newton.ModelBuilder()
        part.add_body(label="robot/base", xform=pose(0.0, 0.0, 9.0))
        part.add_body(label="robot/arm/hand", xform=pose(0.0, 0.0, 1.0 + world))
        for thing in range(things):
            part.add_body(label=f"cube_{thing}")
        builder.add_world(part, label_prefix=f"{prefix}{world}" if prefix else None)
    builder.add_ground_plane()
    model, state = finalize(builder, device)
    scene = wc.from_newton(model, state)
    for parent in (model.body_label[1], "robot/arm/hand", 1):
        renderer = wc.Renderer(scene, [eye(position=(0, 0, 0), rotation=(1, 0, 0, 0), parent=parent)])
        assert renderer.render()["eye"]["depth"][:, 32, 48, 0].tolist() == pytest.approx([1.0, 2.0])
        assert renderer.faulty.tolist() == [0, 0]


def test_poses_of_another_number_put_into_a_state_are_told(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(builder.add_body(xform=pose(0.0, 0.0, 1.0)), radius=0.3)
    model, state = finalize(builder, device)
    renderer, kept = wc.Renderer(wc.from_newton(model, state), [eye()]), state.body_q
    for poses, count in ((None, 0), (wp.zeros(2, dtype=wp.transform, device=device), 2)):
        state.body_q = poses
        with pytest.raises(wc.WarpcamError, match=f"it has {count} bodies, model has 1"):
            renderer.render()
    state.body_q = kept
    assert (renderer.render()["eye"]["segmentation"] == 0).any()


def test_a_broken_pose_is_its_own_worlds(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.zoo(), 2)
    model, state = finalize(builder, device)
    change(state.body_q, (0, 0), np.nan)
    renderer = wc.Renderer(wc.from_newton(model, state), [eye()])
    seen = scenes.on_host(renderer.render()["eye"])
    assert renderer.faulty.tolist() == [1, 0]
    assert (seen["segmentation"][0] == -1).all() and (seen["segmentation"][1] >= 0).any()
