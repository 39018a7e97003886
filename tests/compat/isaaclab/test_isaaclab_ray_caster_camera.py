"""Ray-caster cameras in Isaac Lab's words, beside MuJoCo's rays through the centres of their pixels."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from lidar_scenes import around, posed

import warpcam as wc
from warpcam.compat.isaaclab import RayCaster, RayCasterCamera

TURN = np.array((0.9, 0.15, -0.2, 0.4))
OFFSET, OFFSET_TURN = (0.1, -0.2, 0.4), (0.05, 0.25, -0.1, 0.95)  # x y z w of the frame with x ahead and z up
KINDS = ["distance_to_camera", "distance_to_image_plane", "normals"]
WIDTH, HEIGHT = 24, 18
# Columns: where a camera's x (right), y (down) and z (ahead) point in the frame of each convention.
AXES = {
    "ros": np.eye(3),
    "opengl": np.diag((1.0, -1.0, -1.0)),
    "world": np.array(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))),
}


def pattern(**more: Any) -> SimpleNamespace:
    lens = {"focal_length": 12.0, "horizontal_aperture": 20.0, "vertical_aperture": None, "width": WIDTH}
    shift = {"horizontal_aperture_offset": 0.05, "vertical_aperture_offset": -0.1, "height": HEIGHT}
    return SimpleNamespace(**(lens | shift | more))


def rotation_in(convention: str) -> tuple[float, ...]:
    """The offset's rotation as a quaternion x y z w of the frame of a convention: the camera looks the same way."""
    numbers = np.zeros(4)
    mujoco.mju_mat2Quat(numbers, (matrix(*OFFSET_TURN) @ AXES["world"] @ AXES[convention].T).ravel())
    return (*numbers[1:], numbers[0])


def matrix(x: float, y: float, z: float, w: float) -> np.ndarray:
    return scenes.matrix((w, x, y, z))


def config(convention: str = "ros", **more: Any) -> SimpleNamespace:
    offset = SimpleNamespace(pos=OFFSET, rot=rotation_in(convention), convention=convention)
    fields = {"prim_path": "/World/envs/env_.*/base", "pattern_cfg": pattern(), "offset": offset, "data_types": KINDS}
    return SimpleNamespace(**(fields | more))


def scene_of(device: wp.Device) -> tuple[wc.Scene, mujoco.MjModel, list[mujoco.MjData]]:
    mjm = around(tuple(kind for kind in scenes.TYPES if kind != "hfield"))
    mjds = [posed(mjm, (-2.6, 0.1, 1.0)), posed(mjm, (0.4, -0.2, 0.3), TURN)]
    return wc.from_mujoco(mjm, mjds, device=device), mjm, mjds


def traced(
    mjm: mujoco.MjModel, mjd: mujoco.MjData, place: np.ndarray, axes: np.ndarray, lens: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances along rays and along the axis, and the rays, of a camera whose axes are columns in the world."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack((u, v, np.ones_like(u)), axis=-1).reshape(-1, 3) @ np.linalg.inv(lens).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    found, body = np.zeros(1, np.int32), mjd.body("base").id
    ahead = rays @ axes.T
    distances = np.array([mujoco.mj_ray(mjm, mjd, place, ray, None, True, body, found) for ray in ahead])
    distances[distances < 0.0] = np.inf
    return distances, distances * rays[:, 2], ahead


def pose_of(mjd: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Position and axes (right, down, ahead) of the camera with the offset of ``config``."""
    frame = mjd.body("base").xmat.reshape(3, 3)
    return mjd.body("base").xpos + frame @ OFFSET, frame @ matrix(*OFFSET_TURN) @ AXES["world"]


def assert_like(mine: torch.Tensor, expected: np.ndarray) -> np.ndarray:
    """All pixels but a few that graze an edge; return which."""
    with np.errstate(invalid="ignore"):
        off = ~np.isclose(mine.cpu().numpy().reshape(-1), expected, atol=1e-4, rtol=0.0)
    assert off.sum() <= 3
    return ~off


@pytest.mark.parametrize("convention", sorted(AXES))
def test_distances_are_those_of_mj_ray(device: wp.Device, convention: str) -> None:
    scene, mjm, mjds = scene_of(device)
    camera = RayCasterCamera(config(convention), scene, exclude_bodies=("base",))
    assert camera.image_shape == (HEIGHT, WIDTH) and camera.num_rays == WIDTH * HEIGHT
    data = camera.data
    assert {kind: tuple(image.shape) for kind, image in data.output.items()} == {
        kind: (2, HEIGHT, WIDTH, 3 if kind == "normals" else 1) for kind in KINDS
    }
    assert data.info == dict.fromkeys(KINDS) and data.image_shape == (HEIGHT, WIDTH)
    focal = 12.0 / 20.0 * WIDTH
    lens = np.array(((focal, 0, WIDTH / 2 + 0.05 * focal), (0, focal, HEIGHT / 2 - 0.1 * focal), (0, 0, 1)))
    np.testing.assert_allclose(data.intrinsic_matrices.cpu(), np.tile(lens, (2, 1, 1)), rtol=1e-6)
    for world, mjd in enumerate(mjds):
        place, axes = pose_of(mjd)
        along, planar, rays = traced(mjm, mjd, place, axes, lens)
        assert np.isfinite(along).any() and np.isinf(along).any()
        assert_like(data.output["distance_to_camera"][world], along)
        same = assert_like(data.output["distance_to_image_plane"][world], planar)
        normals = data.output["normals"][world].cpu().numpy().reshape(-1, 3)[same]
        hit = np.isfinite(planar[same])
        assert np.isinf(normals[~hit]).all()
        np.testing.assert_allclose(np.linalg.norm(normals[hit], axis=-1), 1.0, atol=1e-3)
        assert ((normals[hit] * rays[same][hit]).sum(axis=-1) < 1e-3).all()
        np.testing.assert_allclose(data.pos_w[world].cpu(), place, atol=1e-5)
        for name, own in AXES.items():
            turn = matrix(*getattr(data, f"quat_w_{name}")[world].cpu().double().tolist())
            np.testing.assert_allclose(turn @ own, axes, atol=1e-5)


def test_normals_are_those_of_a_floor(device: wp.Device) -> None:
    mjm = scenes.compile_xml('<body name="base" mocap="true"/><geom type="plane" size="0 0 1"/>')
    cfg = config("world", data_types=["normals"])
    cfg.offset.pos, cfg.offset.rot = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)
    normals = RayCasterCamera(cfg, wc.from_mujoco(mjm, posed(mjm), device=device)).data.output["normals"][0].cpu()
    assert torch.equal(normals[-1], torch.tensor((0.0, 0.0, 1.0)).expand(WIDTH, 3))
    assert torch.isinf(normals[0]).all()


@pytest.mark.parametrize(("behavior", "beyond"), [("none", None), ("max", 2.0), ("zero", 0.0)])
def test_clipping(device: wp.Device, behavior: str, beyond: float | None) -> None:
    """What is beyond the greatest distance is clipped, each image by its own numbers; normals stay."""
    scene, _, _ = scene_of(device)
    whole = RayCasterCamera(config(), scene, exclude_bodies=("base",)).data.output
    cfg = config(depth_clipping_behavior=behavior, max_distance=2.0)
    clipped = RayCasterCamera(cfg, scene, exclude_bodies=("base",)).data.output
    for kind in KINDS[:2]:
        far = whole[kind] > 2.0
        assert far.any() and not far.all() and torch.isfinite(whole[kind][far]).any()
        expected = whole[kind] if beyond is None else torch.where(far, beyond, whole[kind])
        assert torch.equal(clipped[kind], expected)
    assert torch.equal(clipped["normals"], whole["normals"])


def test_drifts_are_added_where_they_are_written(device: wp.Device) -> None:
    """That of the rays in the camera's frame, without what lies along the world's z, as Isaac Lab has it."""
    scene, mjm, mjds = scene_of(device)
    camera = RayCasterCamera(config("world"), scene, exclude_bodies=("base",))
    drift, aside = np.array((0.1, -0.05, 0.2)), np.array((0.15, 0.1, -0.1))
    camera.drift[1] = torch.tensor(drift)
    camera.ray_cast_drift[1] = torch.tensor(aside)
    data, mjd = camera.data, mjds[1]
    place, axes = pose_of(mjd)
    frame = axes @ AXES["world"].T
    start = place + drift + (frame @ aside) * (1.0, 1.0, 0.0)
    along, _, _ = traced(mjm, mjd, start, axes, data.intrinsic_matrices[1].cpu().double().numpy())
    assert_like(data.output["distance_to_camera"][1], along)
    np.testing.assert_allclose(data.pos_w[1].cpu(), place + drift, atol=1e-5)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_poses_in_the_world(device: wp.Device, order: str) -> None:
    """Cameras stand where they were put, whatever the convention, and follow their bodies from there."""
    scene, mjm, mjds = scene_of(device)
    roll = 1 if order == "wxyz" else 0
    cfg = config()
    cfg.offset.rot = tuple(np.roll(cfg.offset.rot, roll))
    camera = RayCasterCamera(cfg, scene, exclude_bodies=("base",), quaternions=order)
    before = camera.data.pos_w.clone()
    turn = np.array((0.3, -0.2, 0.5, 0.7))
    for convention in sorted(AXES):
        camera.set_world_poses([[0.2, 0.3, 0.9]], [np.roll(turn, roll).tolist()], [1], convention)
        data = camera.data
        found = np.roll(getattr(data, f"quat_w_{convention}")[1].cpu().numpy(), -roll)
        np.testing.assert_allclose(matrix(*found), matrix(*turn), atol=1e-5)
        np.testing.assert_allclose(data.pos_w[1].cpu(), (0.2, 0.3, 0.9), atol=1e-6)
        assert torch.equal(data.pos_w[0], before[0])
        camera.update()
        axes = matrix(*turn) @ AXES[convention]
        lens = data.intrinsic_matrices[1].cpu().double().numpy()
        along, _, _ = traced(mjm, mjds[1], np.array((0.2, 0.3, 0.9)), axes, lens)
        assert_like(data.output["distance_to_camera"][1], along)
    mjds[1].mocap_pos[0] += (0.0, 0.1, 0.2)
    mujoco.mj_forward(mjm, mjds[1])
    camera.update()
    np.testing.assert_allclose(data.pos_w[1].cpu(), (0.2, 0.4, 1.1), atol=1e-5)
    turned = data.quat_w_ros.clone()
    camera.set_world_poses(positions=torch.zeros(2, 3))
    np.testing.assert_allclose(data.pos_w.cpu(), 0.0, atol=1e-6)
    torch.testing.assert_close(data.quat_w_ros, turned)


def test_cameras_look_at_targets(device: wp.Device) -> None:
    scene, _, _ = scene_of(device)
    camera = RayCasterCamera(config(), scene)
    eyes, targets = np.array(((2.0, 1.0, 1.5), (0.0, 0.0, 3.0))), np.array(((0.0, 0.5, 0.2), (0.1, 0.0, 0.0)))
    camera.set_world_poses_from_view(eyes, targets)
    for world in range(2):
        axes = matrix(*camera.data.quat_w_ros[world].cpu().double().tolist())
        ahead = (targets - eyes)[world] / np.linalg.norm((targets - eyes)[world])
        np.testing.assert_allclose(axes[:, 2], ahead, atol=1e-5)
        assert abs(axes[2, 0]) < 1e-5 and axes[2, 1] < 0.0  # upright
    with pytest.raises(wc.WarpcamError, match="RayCasterCamera: targets must be elsewhere than eyes"):
        camera.set_world_poses_from_view(eyes, eyes)


def test_intrinsics_may_change(device: wp.Device) -> None:
    scene, mjm, mjds = scene_of(device)
    camera = RayCasterCamera(config(), scene, exclude_bodies=("base",))
    data = camera.data
    first = data.output["distance_to_camera"][0].clone()
    lens = np.array(((20.0, 0.0, 10.0), (0.0, 15.0, 9.5), (0.0, 0.0, 1.0)))
    camera.set_intrinsic_matrices(lens[None], env_ids=[1])
    camera.update()
    assert torch.equal(data.output["distance_to_camera"][0], first)
    along, _, _ = traced(mjm, mjds[1], *pose_of(mjds[1]), lens)
    assert_like(data.output["distance_to_camera"][1], along)
    np.testing.assert_allclose(data.intrinsic_matrices[1].cpu(), lens)
    lens[0, 1] = 0.1
    with pytest.raises(wc.WarpcamError, match="RayCasterCamera: matrices must be fx 0 cx, 0 fy cy, 0 0 1"):
        camera.set_intrinsic_matrices(lens[None])


def test_frames_are_counted_and_poses_follow_a_reset(device: wp.Device) -> None:
    scene, mjm, mjds = scene_of(device)
    camera = RayCasterCamera(config(), scene)
    for _ in range(3):
        camera.update(0.01)
    mjds[0].mocap_pos[0] += 0.2
    mujoco.mj_forward(mjm, mjds[0])
    before, image = camera.data.pos_w.clone(), camera.data.output[KINDS[0]].clone()
    camera.reset([0])
    assert camera.frame.tolist() == [0, 3]
    np.testing.assert_allclose((camera.data.pos_w - before).cpu(), [[0.2] * 3, [0.0] * 3], atol=1e-6)
    assert torch.equal(camera.data.output[KINDS[0]], image)
    camera.reset(env_mask=torch.tensor([False, True]))
    assert camera.frame.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"prim_path": "/World/nobody"}, "RayCasterCamera: prim_path"),
        ({"data_types": ["rgb"]}, "RayCasterCamera: data_types has 'rgb'; allowed are distance_to_image_plane"),
        ({"data_types": []}, "RayCasterCamera: data_types must have some of"),
        ({"depth_clipping_behavior": "far"}, "RayCasterCamera: depth_clipping_behavior is 'far'; allowed are 'max'"),
        ({"ray_alignment": "yaw"}, "RayCasterCamera: ray_alignment is 'yaw'; allowed are 'base'"),
        ({"update_period": 0.1}, "RayCasterCamera: update_period is 0.1; allowed is 0.0"),
        ({"update_mesh_ids": True}, "RayCasterCamera: update_mesh_ids is True; allowed is False"),
        ({"max_distance": 0.0}, r"RayCasterCamera: max_distance must be a positive number \[m\], got 0.0"),
        ({"pattern_cfg": SimpleNamespace()}, "RayCasterCamera: pattern_cfg has no focal_length"),
        ({"pattern_cfg": pattern(width=0)}, "RayCasterCamera: pattern_cfg.width must be a whole number of pixels"),
        ({"pattern_cfg": pattern(focal_length=-1.0)}, "RayCasterCamera: pattern_cfg.focal_length must be positive"),
        ({"offset": SimpleNamespace(convention="usd")}, "RayCasterCamera: offset.convention is 'usd'; allowed are"),
        ({"offset": SimpleNamespace(pos=(1.0, 2.0))}, "RayCasterCamera: offset.pos must be 3 numbers"),
    ],
)
def test_fields_that_cannot_be_used(device: wp.Device, change: dict[str, Any], text: str) -> None:
    with pytest.raises(wc.WarpcamError, match=text):
        RayCasterCamera(config(**change), scene_of(device)[0])


def test_what_is_unread_or_does_not_fit_is_told(device: wp.Device) -> None:
    scene, _, _ = scene_of(device)
    with pytest.warns(UserWarning, match="RayCasterCamera: mesh_prim_paths is not read"):
        RayCasterCamera(config(mesh_prim_paths=["/World/ground"]), scene)
    with pytest.warns(UserWarning, match="RayCasterCamera: drift_range and ray_cast_drift_range are not read"):
        camera = RayCasterCamera(config(drift_range=(-0.1, 0.1)), scene)
    with pytest.raises(wc.WarpcamError, match=r"RayCasterCamera: positions must be \(2, 3\), got \(3, 3\)"):
        camera.set_world_poses(torch.zeros(3, 3))
    with pytest.raises(wc.WarpcamError, match="RayCasterCamera: convention is 'usd'; allowed are 'opengl'"):
        camera.set_world_poses(convention="usd")  # type: ignore[arg-type]
    with pytest.raises(wc.WarpcamError, match="RayCaster: pattern_cfg is a pinhole camera's, which RayCasterCamera"):
        RayCaster(config(), scene)
