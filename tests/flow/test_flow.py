"""Flow: where what is seen was in the last image, by definition, and what is said to be known of it."""

from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp
from flow_cases import (
    BALL,
    BOX,
    HEIGHT,
    LENSES,
    WALL,
    WIDTH,
    Moving,
    expected,
    np_to,
    turn,
    warped,
    write_sizes,
)

import warpcam as wc

EXACT = 1e-3  # pixels


def quaternion(*axis_angle: float) -> np.ndarray:
    flat = np.zeros(4)
    scenes.mujoco.mju_mat2Quat(flat, turn(*axis_angle).reshape(9))
    return flat


@pytest.mark.parametrize("lens", ["pinhole", "orthographic"])
def test_camera_slides_along_a_wall(lens: str, device: wp.Device) -> None:
    moving = Moving(lens, world='<geom type="plane" size="0 0 1" pos="0 0 -4"/>')
    moving.see()
    moving.move_camera((0.11, -0.07, 0.0))
    seen = moving.see()
    focal = 0.5 * HEIGHT / np.tan(np.radians(30.0)) / 4.0 if lens == "pinhole" else HEIGHT / 4.0
    np.testing.assert_allclose(seen["flow"][0, ..., 0], -0.11 * focal, atol=EXACT)
    np.testing.assert_allclose(seen["flow"][0, ..., 1], -0.07 * focal, atol=EXACT)


def test_camera_comes_nearer(device: wp.Device) -> None:
    moving = Moving(world='<geom type="plane" size="0 0 1" pos="0 0 -4"/>')
    moving.see()
    moving.move_camera((0.0, 0.0, -1.0))
    flow = moving.see()["flow"][0]
    column, row = np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2
    np.testing.assert_allclose(flow[..., 0], np.broadcast_to(0.25 * column, (HEIGHT, WIDTH)), atol=EXACT)
    np.testing.assert_allclose(flow[..., 1], np.broadcast_to(0.25 * row[:, None], (HEIGHT, WIDTH)), atol=EXACT)


def test_camera_rolls(device: wp.Device) -> None:
    angle = 0.2
    moving = Moving()
    moving.see()
    moving.move_camera(rotation=quaternion(0.0, 0.0, angle))
    flow = moving.see()["flow"][0]
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    x, y = column - WIDTH / 2, row - HEIGHT / 2
    # The camera turns to the left, what it sees to the right; rows run down.
    was_x, was_y = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    np.testing.assert_allclose(flow, np.stack((x - was_x, y - was_y), -1), atol=EXACT)


MOTIONS: dict[str, Any] = {
    "box shifts": lambda moving: moving.move(BOX, by=(0.1, -0.05, 0.2)),
    "box turns": lambda moving: moving.move(BOX, turned=(0.1, 0.2, -0.3)),
    "ball turns": lambda moving: moving.move(BALL, turned=(0.5, -0.2, 0.1)),
    "all move": lambda moving: (
        moving.move(WALL, by=(0.3, 0.2, 0.1), turned=(0.05, 0.02, 0.1)),
        moving.move(BOX, by=(0.1, 0.1, 0.1), turned=(0.1, 0.1, 0.1)),
        moving.move(BALL, by=(-0.1, 0.1, 0.3), turned=(0.1, -0.1, 0.1)),
    ),
    "camera moves": lambda moving: moving.move_camera((0.1, 0.05, -0.1), quaternion(0.05, -0.03, 0.1)),
    "zoom": lambda moving: [
        getattr(moving.arrays, name).mul_(1.1)
        for name in ("fovy", "height", "intrinsics")
        if hasattr(moving.arrays, name)
    ],
    "everything": lambda moving: [change(moving) for name, change in MOTIONS.items() if name != "everything"],
    "ball grows": lambda moving: write_sizes(moving.m, BALL, (0.6, 0.0, 0.0)),
    "box grows": lambda moving: write_sizes(moving.m, BOX, (0.6, 0.3, 0.4)),
}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("lens", LENSES)
def test_flow_leads_to_where_the_surface_was(lens: str, motion: str, device: wp.Device) -> None:
    moving = Moving(lens)
    moving.see()
    then = moving.state()
    MOTIONS[motion](moving)
    seen = moving.see()
    truth = expected(seen, moving.state(), then)
    assert np.abs(truth).max() > 0.2
    np.testing.assert_allclose(seen["flow"][0], truth, atol=EXACT)
    # Where it leads the surface was there and is said to have been, but at edges.
    assert 0.6 < seen["flow_valid"].mean() < 1.0 or motion == "ball turns"


@pytest.mark.parametrize("lens", LENSES)
def test_what_rests_is_exactly_zero_and_known(lens: str, device: wp.Device) -> None:
    moving = Moving(lens, rotation=quaternion(0.4, 0.2, 0.3))
    first = moving.see()
    assert not first["flow"].any() and not first["flow_valid"].any()
    for _ in range(3):
        seen = moving.see()
        assert not seen["flow"].any()
        np.testing.assert_array_equal(seen["flow_valid"] == 1, seen["segmentation"] >= 0)
    moving.move(BALL, by=(0.0, 0.1, 0.0))
    seen = moving.see()
    assert not seen["flow"][seen["segmentation"] != BALL].any()
    assert (seen["flow"][seen["segmentation"] == BALL] != 0.0).any()


@pytest.mark.parametrize("size", [(45, 27), (80, 72)])
def test_images_of_any_size(size: tuple[int, int], device: wp.Device) -> None:
    moving = Moving(width=size[0], height=size[1])
    moving.see()
    seen = moving.see()
    np.testing.assert_array_equal(seen["flow_valid"] == 1, seen["segmentation"] >= 0)
    moving.move(BALL, by=(0.3, 0.2, 0.0))
    before, seen = seen, moving.see()
    newly = (seen["segmentation"] == WALL) & (before["segmentation"] == BALL)
    rests = (seen["segmentation"] != BALL) & (seen["segmentation"] == before["segmentation"])
    assert newly.sum() > 20
    assert not seen["flow_valid"][newly].any()
    assert seen["flow_valid"][rests].all()


def test_nothing_is_hit(device: wp.Device) -> None:
    moving = Moving(world='<geom size=".5" pos="0 0 -3"/>')
    for _ in range(2):
        moving.move_camera((0.01, 0.0, 0.0))
        seen = moving.see()
        nothing = seen["segmentation"] < 0
        assert nothing.any() and not seen["flow"][nothing].any() and not seen["flow_valid"][nothing].any()


def test_what_newly_appears_is_flagged(device: wp.Device) -> None:
    moving = Moving()
    before = moving.see()
    moving.move(BALL, by=(0.3, 0.2, 0.0))
    seen = moving.see()
    wall, was_ball = seen["segmentation"] == WALL, before["segmentation"] == BALL
    assert (wall & was_ball).sum() > 20
    assert not seen["flow_valid"][wall & was_ball].any()  # it rests, so it was behind the ball
    assert seen["flow_valid"][wall & ~was_ball].all()
    assert not seen["flow"][wall].any()


def test_other_sides_are_flagged(device: wp.Device) -> None:
    moving = Moving("orthographic")
    moving.move(BOX, turned=(0.0, 0.1, 0.0))
    moving.see()
    then = moving.state()
    moving.move(BOX, turned=(0.0, -0.7, 0.0))
    seen = moving.see()
    box, now = seen["segmentation"][0] == BOX, moving.state()
    local = (seen["points"][0] - now["positions"][0, BOX]) @ now["rotations"][0, BOX]
    new = box & (np.abs(np.abs(local[..., 0]) - 0.5) < 1e-4)  # a side along x: seen now, turned away before
    old = box & (np.abs(local[..., 2] - 0.3) < 1e-4)
    assert new.sum() > 10 and old.sum() > 10
    assert np.abs(seen["flow"][0] - expected(seen, now, then))[box].max() < EXACT
    assert seen["flow_valid"][0][new].mean() < 0.2  # but for what lay next to the edge
    assert seen["flow_valid"][0][old].mean() > 0.8


def test_out_of_the_image_and_behind_the_camera(device: wp.Device) -> None:
    moving = Moving(world='<geom type="plane" size="0 0 1" pos="0 0 -4"/>')
    moving.see()
    moving.move_camera((0.25 * 4.0 * 2.0 * np.tan(np.radians(30.0)) * WIDTH / HEIGHT, 0.0, 0.0))
    seen = moving.see()
    new = np.arange(WIDTH) >= 0.75 * WIDTH
    np.testing.assert_array_equal(seen["flow_valid"][0], np.broadcast_to(~new, (HEIGHT, WIDTH)))
    assert (seen["flow"][0][:, new, 0] < -0.2 * WIDTH).all()  # where it was, nobody has seen
    moving.move_camera((0.0, 0.0, -5.0), quaternion(0.0, np.pi, 0.0))
    moving.see()
    moving.move_camera((0.0, 0.0, 5.0), quaternion(0.0, 0.0, 0.0))
    seen = moving.see()
    assert (seen["segmentation"] == WALL).all()
    assert not seen["flow_valid"].any() and np.isfinite(seen["flow"]).all()


@pytest.mark.parametrize("shapes", [255, 256])
def test_the_last_of_many_shapes_is_not_taken_for_nothing(shapes: int, device: wp.Device) -> None:
    crowd = "".join(f'<geom size=".01" pos="0 {5 + i} 0"/>' for i in range(shapes - 1))
    moving = Moving(world=crowd + '<geom size=".5" pos="0 0 -3"/>', near=5.0, far=10.0)
    assert (moving.see()["segmentation"] < 0).all()
    moving.arrays.near.fill_(0.0)
    seen = moving.see()
    ball = seen["segmentation"] == shapes - 1
    assert ball.sum() > 50 and not seen["flow_valid"].any()
    seen = moving.see()
    np.testing.assert_array_equal(seen["flow_valid"] == 1, ball)
    assert moving.renderer.memory.past == 1 + 76 + 128 * shapes + (4 if shapes < 256 else 8) * WIDTH * HEIGHT


def test_nearer_than_the_camera_saw(device: wp.Device) -> None:
    moving = Moving(near=3.5, far=10.0)
    seen = moving.see()
    assert set(np.unique(seen["segmentation"])) == {WALL}
    moving.arrays.near.fill_(0.0)
    seen = moving.see()
    assert (seen["segmentation"] == BOX).any() and not seen["flow_valid"][seen["segmentation"] == BOX].any()
    seen = moving.see()
    assert seen["flow_valid"].all()


RESETS: dict[str, Any] = {
    "ids": lambda device: [1, 3],
    "mask": lambda device: torch.tensor([0, 1, 0, 1], dtype=torch.bool, device=wp.device_to_torch(device)),
    "ids there": lambda device: torch.tensor([1, 3], device=wp.device_to_torch(device)),
}


@pytest.mark.parametrize("which", RESETS)
def test_reset_worlds_know_nothing(which: str, device: wp.Device) -> None:
    moving = Moving(num_worlds=4)
    moving.see()
    moving.move(BOX, by=(0.1, 0.0, 0.0))
    moving.renderer.reset(RESETS[which](device))
    seen = moving.see()
    for world in (1, 3):
        assert not seen["flow"][world].any() and not seen["flow_valid"][world].any()
    for world in (0, 2):
        assert seen["flow"][world].any() and seen["flow_valid"][world].mean() > 0.8
    assert moving.see()["flow_valid"].all()
    moving.renderer.reset()
    assert not moving.see()["flow_valid"].any()
    assert moving.see()["flow_valid"].all()


def test_reset_checks_its_worlds(device: wp.Device) -> None:
    moving = Moving(num_worlds=4)
    with pytest.raises(wc.WarpcamError, match="reset: worlds has id 4; allowed are 0 to 3"):
        moving.renderer.reset([4])
    with pytest.raises(wc.WarpcamError, match="render: worlds has id 4"):
        moving.renderer.render(worlds=[4])
    wc.Renderer(moving.scene, [scenes.own_camera()]).reset([0])  # nothing to forget


def test_each_world_has_its_own_last_frame(device: wp.Device) -> None:
    moving, alone = Moving(num_worlds=3), Moving()
    moving.see()
    alone.see()
    then = moving.state()
    before = moving.see()
    for step in range(2):
        for each in (moving, alone):
            each.move(BOX, by=(0.05, 0.02, 0.0), turned=(0.0, 0.0, 0.1))
        moving.move(BALL, by=(0.1, 0.0, 0.0), world=2)
        if step == 0:
            moving.see(worlds=[0])
            first = alone.see()
    seen, last = moving.see(), alone.see()
    assert (seen["flow"][0] == last["flow"][0]).all() and (seen["flow_valid"][0] == last["flow_valid"][0]).all()
    assert (first["flow"] != last["flow"]).any()
    for world in (1, 2):  # both steps at once
        truth = expected(seen, moving.state(), then, world)
        assert np.abs(truth).max() > 1.0
        np.testing.assert_allclose(seen["flow"][world], truth, atol=EXACT)
    assert not before["flow"].any()


def test_a_broken_world_harms_no_other(device: wp.Device) -> None:
    moving = Moving(num_worlds=3)
    moving.see()
    good = moving.d.geom_xpos.numpy().copy()
    scenes.write(moving.d.geom_xpos, (1, BALL), np.nan)
    seen = moving.see()
    assert not seen["flow"][1].any() and not seen["flow_valid"][1].any()
    assert seen["flow_valid"][[0, 2]].all()
    moving.d.geom_xpos.assign(good)
    moving.move(BOX, by=(0.1, 0.0, 0.0))
    seen = moving.see()
    assert np.isfinite(seen["flow"]).all() and not seen["flow_valid"][1].any()
    assert moving.see()["flow_valid"].all()


def test_captured_frames_go_on_from_each_other(device: wp.Device) -> None:
    captured, eager = Moving(num_worlds=2), Moving(num_worlds=2, graph=False)
    worlds = torch.tensor([0, 1], dtype=torch.uint8, device=wp.device_to_torch(device))
    captured.see()
    eager.see()
    with wp.ScopedCapture(device) as capture:
        captured.renderer.render()
    with wp.ScopedCapture(device) as of_reset:
        captured.renderer.reset(worlds)
    for step in range(5):
        for each in (captured, eager):
            each.move(BOX, by=(0.02 * step, 0.0, 0.03), turned=(0.0, 0.1, 0.0))
            each.move(WALL, turned=(0.01, 0.0, 0.0))
            each.move_camera((0.01, 0.0, 0.0))
        if step == 3:
            wp.capture_launch(of_reset.graph)
            eager.renderer.reset(worlds)
        wp.capture_launch(capture.graph)
        seen, same = scenes.on_host(captured.images), eager.see()
        for name in seen:
            np.testing.assert_array_equal(seen[name], same[name], err_msg=f"{name} {step}")
        assert seen["flow"].any() and seen["flow_valid"][0].mean() > 0.7
        assert seen["flow_valid"][1].any() == (step != 3)


def test_each_output_alone_is_the_same(device: wp.Device) -> None:
    together, alone = Moving(), [Moving(outputs=(name,)) for name in ("flow", "flow_valid")]
    other = wc.Camera("b", width=9, height=8, outputs=("flow",), lens=LENSES["pinhole"], position=(0, 0, 0))
    two = wc.Renderer(together.scene, [scenes.own_camera(outputs=("flow_valid",)), other])
    for _ in range(3):
        for each in (together, *alone):
            each.move(BOX, by=(0.1, 0.05, 0.0), turned=(0.0, 0.0, 0.2))
        seen = together.see()
        for each in alone:
            for name, image in each.see().items():
                # Kernels of other outputs may round otherwise.
                np.testing.assert_allclose(image, seen[name], rtol=0.0, atol=1e-5, err_msg=name)
        two.render()
    assert two.images["b"]["flow"].abs().max() > 0.1 and two.images["eye"]["flow_valid"].any()


CROWD = "".join(f'<geom size=".1" pos="{i % 20 * 0.2 - 1.9} {i // 20 * 0.2 - 1.4} -5"/>' for i in range(280))


def test_more_shapes_than_one_pass_draws(device: wp.Device) -> None:
    moving = Moving(world=CROWD)
    moving.see()
    then = moving.state()
    scenes.write(moving.d.geom_xpos, slice(None), moving.d.geom_xpos.numpy() + np.float32((0.05, 0.02, 0.1)))
    seen = moving.see()
    np.testing.assert_allclose(seen["flow"][0], expected(seen, moving.state(), then), atol=EXACT)
    assert (seen["flow"][seen["segmentation"] < 0] == 0.0).all()
    seen = moving.see()
    assert not seen["flow"].any()
    np.testing.assert_array_equal(seen["flow_valid"] == 1, seen["segmentation"] >= 0)


TEXTURED = """
  <geom type="plane" size="3 3 1" pos="0 0 -4" material="paint"/>
  <body pos="-.6 .1 -3"><freejoint/><geom type="box" size=".5 .4 .3" material="paint"/></body>
  <body pos=".8 -.2 -2.8"><freejoint/><geom size=".45" material="paint"/></body>
"""
PAINT = """
  <texture name="paint" type="2d" builtin="flat" width="64" height="64" rgb1=".5 .5 .5"/>
  <material name="paint" texture="paint" texrepeat="1 1"/>
"""


@pytest.mark.parametrize("motion", ["box shifts", "all move", "camera moves", "zoom"])
def test_the_last_image_warped_is_this_one(motion: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = scenes.compile_xml

    def painted(*args: Any, **options: Any) -> Any:
        mjm = compiled(*args, **options)
        random = np.random.default_rng(0).uniform(0.0, 255.0, (64, 64, 3))
        for _ in range(4):
            random = sum(np.roll(random, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)) / 9.0
        random = (random - random.min()) / (random.max() - random.min())
        mjm.tex_data[:] = np.round(255.0 * random).astype(np.uint8).reshape(-1)
        return mjm

    monkeypatch.setattr(scenes, "compile_xml", painted)
    moving = Moving(outputs=("albedo", "flow", "flow_valid"), world=TEXTURED, assets=PAINT, width=96, height=64)
    before = moving.see()
    MOTIONS[motion](moving)
    seen = moving.see()
    valid = seen["flow_valid"][0] == 1
    assert valid.mean() > 0.6
    off = (warped(before["albedo"][0], seen["flow"][0]) - seen["albedo"][0])[valid]
    assert np.std(seen["albedo"][0][valid]) > 20.0
    noise = 10.0 * np.log10(255.0**2 / np.mean(off**2))
    assert noise > 35.0
    still = (before["albedo"][0].astype(float) - seen["albedo"][0])[valid]
    assert 10.0 * np.log10(255.0**2 / np.mean(still**2)) < noise - 3.0


def test_a_camera_on_a_body_sees_it_rest(device: wp.Device) -> None:
    moving = Moving()
    camera = scenes.own_camera(
        width=WIDTH, height=HEIGHT, outputs=("flow", "flow_valid", "segmentation"), position=(0.0, 0.0, 1.5), parent=1
    )
    renderer = wc.Renderer(moving.scene, [camera])
    for _ in range(3):
        positions = moving.d.xpos.numpy().copy()
        positions[:, 1] += (0.1, 0.05, 0.0)
        moving.d.xpos.assign(positions)
        moving.move(BOX, by=(0.1, 0.05, 0.0))
        seen = scenes.on_host(renderer.render()["eye"])
    box = seen["segmentation"] == BOX
    assert box.any() and np.abs(seen["flow"][box]).max() < EXACT and seen["flow_valid"][box].mean() > 0.95
    assert np.abs(seen["flow"][seen["segmentation"] == WALL]).max() > 0.5
    assert np_to(moving.arrays.position, 1.0).device == moving.arrays.position.device
