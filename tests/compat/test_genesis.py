"""Ray casters in Genesis's words, beside MuJoCo's rays."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from lidar_scenes import around, posed

import warpcam as wc
from warpcam.compat import genesis as gs

TURN = np.array((0.9, 0.15, -0.2, 0.4))
OFFSET, EULER = (0.1, -0.2, 0.1), (20.0, 12.0, 70.0)


def turned(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix of MuJoCo's own quaternion of angles about fixed axes."""
    quaternion, matrix = np.zeros(4), np.zeros(9)
    mujoco.mju_euler2Quat(quaternion, np.radians((roll, pitch, yaw)), "XYZ")
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


PATTERNS = {
    "grid": (gs.GridPattern(resolution=0.2), (11, 11)),
    "sphere": (gs.SphericalPattern(n_points=(24, 12)), (24, 12)),
    "camera": (gs.DepthCameraPattern(res=(20, 16)), (16, 20)),
}


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("world_frame", [False, True])
def test_rays_are_those_of_mj_ray(device: wp.Device, name: str, world_frame: bool) -> None:
    mjm = around(tuple(kind for kind in scenes.TYPES if kind != "hfield"))
    places = ((2.1, 0.1, 1.7), (2.2, -0.2, 1.8)) if name == "grid" else ((0.0, 0.0, 0.2), (0.3, -0.2, 0.1))
    mjds = [posed(mjm, places[0]), posed(mjm, places[1], TURN)]
    pattern, shape = PATTERNS[name]
    settings: dict[str, Any] = {"no_hit_value": -2.0, "return_world_frame": world_frame, "max_range": 4.0}
    caster = gs.Raycaster(
        wc.from_mujoco(mjm, mjds, device=device), pattern=pattern, link="base", pos_offset=OFFSET, euler_offset=EULER,
        exclude_bodies=("base",), **settings,
    )  # fmt: skip
    points, distances = caster.read()
    assert distances.shape == (2, *shape) and points is not None and points.shape == (2, *shape, 3)
    seen, found = 0, np.zeros(1, np.int32)
    for world, mjd in enumerate(mjds):
        body = mjd.body("base")
        frame, mount = body.xmat.reshape(3, 3), turned(*EULER)
        rays = pattern.ray_dirs.reshape(-1, 3) @ mount.T
        starts = body.xpos + (pattern.ray_starts.reshape(-1, 3) @ mount.T + OFFSET) @ frame.T
        true = np.array([
            mujoco.mj_ray(mjm, mjd, start, frame @ ray, None, True, body.id, found)
            for start, ray in zip(starts, rays, strict=True)
        ])  # fmt: skip
        hit = (true >= 0.0) & (true < 4.0)
        mine = distances[world].cpu().numpy().reshape(-1)
        off = np.abs(np.where(hit, true, -2.0) - mine) > 1e-4
        assert off.sum() <= 3  # where a ray grazes an edge
        ends = starts + true[:, None] * (rays @ frame.T) if world_frame else true[:, None] * rays
        ends = np.where(hit[:, None], ends, 0.0)
        np.testing.assert_allclose(points[world].cpu().numpy().reshape(-1, 3)[~off], ends[~off], atol=2e-4)
        seen += int(hit.sum())
    assert 0.05 < seen / (2 * np.prod(shape)) < 1.0


def test_defaults_are_genesis_own(device: wp.Device) -> None:
    assert gs.GridPattern().return_shape == (21, 21)
    assert gs.SphericalPattern().return_shape == (128, 64)
    assert gs.DepthCameraPattern().return_shape == (96, 128)
    mjm = around(("box",))
    camera = gs.DepthCamera(
        wc.from_mujoco(mjm, posed(mjm), device=device), pattern=gs.DepthCameraPattern(res=(8, 6)), return_points=False
    )
    points, distances = camera.read()
    assert points is None and (distances[distances > 10.0] == 20.0).all() and (distances == 20.0).any()
    assert torch.equal(camera.read_image(), distances) and camera.read_image() is distances
    assert camera.read([0]).distances.shape == (1, 6, 8)


def test_angles_of_spheres() -> None:
    """A whole turn does not close; steps and given angles come before counts."""
    dirs = gs.SphericalPattern(fov=(360.0, 0.0), n_points=(4, 1)).ray_dirs[:, 0]
    np.testing.assert_allclose(dirs, [(-1, 0, 0), (0, -1, 0), (1, 0, 0), (0, 1, 0)], atol=1e-12)
    stepped = gs.SphericalPattern(fov=((-30.0, 30.0), (0.0, 10.0)), angular_resolution=(15.0, 10.0))
    assert stepped.return_shape == (5, 2)
    np.testing.assert_allclose(stepped.ray_dirs[0, 0], (math.cos(math.pi / 6), -0.5, 0.0), atol=1e-12)
    given = gs.SphericalPattern(angles=((0.0, 90.0), (45.0,)))
    np.testing.assert_allclose(given.ray_dirs[1, 0], (0.0, math.sqrt(0.5), math.sqrt(0.5)), atol=1e-12)


def test_fields_of_view_of_depth_cameras() -> None:
    wide = gs.DepthCameraPattern(res=(4, 2)).ray_dirs
    np.testing.assert_allclose(wide[0, 0] / wide[0, 0, 0], (1.0, 0.75, 0.25))  # x ahead, y left, z up
    tall = gs.DepthCameraPattern(res=(4, 2), fov_horizontal=None, fov_vertical=90.0).ray_dirs
    np.testing.assert_allclose(tall[0, 0] / tall[0, 0, 0], (1.0, 1.5, 0.5))
    both = gs.DepthCameraPattern(res=(4, 2), fov_vertical=90.0).ray_dirs
    np.testing.assert_allclose(both[0, 0] / both[0, 0, 0], (1.0, 0.75, 0.5))
    own = gs.DepthCameraPattern(res=(4, 2), fx=2.0, fy=4.0, cx=0.5, cy=0.5).ray_dirs
    np.testing.assert_allclose(own[0, 1] / own[0, 1, 0], (1.0, -0.5, 0.0))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda scene: gs.GridPattern(resolution=0.0), "GridPattern: resolution must be at least 0.001 m, got 0.0"),
        (
            lambda scene: gs.GridPattern(direction=(0, 0, 0)),
            r"GridPattern: direction must be \(3,\) and not of length 0",
        ),
        (lambda scene: gs.SphericalPattern(fov=(400.0, 10.0)), "SphericalPattern: fov must be from 0 to 360 degrees"),
        (lambda scene: gs.SphericalPattern(n_points=(0, 3)), "SphericalPattern: n_points must be a whole number"),
        (
            lambda scene: gs.DepthCameraPattern(fov_horizontal=None),
            "DepthCameraPattern: fov_horizontal or fov_vertical must be given",
        ),
        (lambda scene: gs.Raycaster(scene, pattern="grid"), "Raycaster: pattern must be one of warpcam.compat.genesis"),
        (
            lambda scene: gs.Raycaster(scene, pattern=gs.GridPattern(), delay=0.1),
            "Raycaster: delay is not offered",
        ),
        (
            lambda scene: gs.Raycaster(scene, pattern=gs.GridPattern(), euler_offset=(1, 2)),
            r"Raycaster: euler_offset must be 3 angles \[degrees\], got \(1, 2\)",
        ),
    ],
)
def test_what_cannot_be_used(device: wp.Device, make: Any, text: str) -> None:
    mjm = around(("box",))
    with pytest.raises(wc.WarpcamError, match=text):
        make(wc.from_mujoco(mjm, posed(mjm), device=device))
