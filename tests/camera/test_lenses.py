"""Lenses, clipping, and what a camera inside a housing sees."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

WALL = '<geom name="wall" type="box" size="50 50 0.5" pos="0 0 -2.5"/>'
HOUSINGS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "hfield")


def scene_of(device: wp.Device, *geoms: str, assets: str = "") -> tuple[wc.Scene, mujoco.MjModel]:
    mjm = scenes.compile_xml("".join(geoms), assets=assets)
    return wc.from_mujoco(mjm, scenes.forward(mjm), device=device), mjm


@pytest.fixture
def ball(device: wp.Device) -> wc.Scene:
    """A ball of radius 0.5 at 1.5 m, in front of a wall at 2 m."""
    return scene_of(device, '<geom type="sphere" size="0.5" pos="0 0 -1.5"/>', WALL)[0]


def test_camera_inside_housings_sees_out(device: wp.Device) -> None:
    housing = "".join(scenes.geom_xml(kind, more='rgba="1 0 0 1"') for kind in HOUSINGS)
    scene, mjm = scene_of(device, housing, WALL, assets=scenes.ASSETS)
    seen = scenes.look(scene, scenes.own_camera())
    assert (seen["segmentation"] == mjm.geom("wall").id).all()
    assert np.abs(seen["depth"] - 2.0).max() <= 2e-6


def test_back_face_hides_nothing(device: wp.Device) -> None:
    # Two open tents, apex towards the camera: the first is wound to show its back, the second its front.
    tent = '<mesh name="{}" inertia="shell" vertex="-1 -1 0 1 -1 0 1 1 0 -1 1 0 0 0 0.25" face="{}"/>'
    assets = tent.format("away", "1 0 4 2 1 4 3 2 4 0 3 4") + tent.format("towards", "0 1 4 1 2 4 2 3 4 3 0 4")
    tents = (
        '<geom name="away" type="mesh" mesh="away" pos="0 0 -1"/>',
        '<geom name="towards" type="mesh" mesh="towards" pos="0 0 -1.5"/>',
    )
    scene, mjm = scene_of(device, *tents, WALL, assets=assets)
    seen = scenes.look(scene, scenes.own_camera(width=33, height=33))
    assert mjm.geom("away").id not in seen["segmentation"]
    assert seen["segmentation"][0, 16, 16] == mjm.geom("towards").id
    assert seen["depth"][0, 16, 16] == pytest.approx(1.25, abs=2e-6)


def test_near_and_far_hold(ball: wc.Scene) -> None:
    def centre(**range_of: float) -> tuple[float, int]:
        seen = scenes.look(ball, scenes.own_camera(width=33, height=33, **range_of))
        return seen["depth"][0, 16, 16], seen["segmentation"][0, 16, 16]

    assert centre() == (pytest.approx(1.0, abs=1e-6), 0)
    assert centre(near=0.99) == (pytest.approx(1.0, abs=1e-6), 0)
    assert centre(near=1.01) == (pytest.approx(2.0, abs=1e-6), 1)
    assert centre(far=1.01) == (pytest.approx(1.0, abs=1e-6), 0)
    assert centre(far=0.99) == (np.inf, -1)
    assert centre(near=1.01, far=1.99) == (np.inf, -1)


@pytest.mark.parametrize(("clipping", "shown"), [("none", np.inf), ("max", 1.5), ("zero", 0.0)])
def test_depth_clipping(ball: wc.Scene, clipping: str, shown: float) -> None:
    seen = scenes.look(ball, scenes.own_camera(width=33, height=33, far=1.5, depth_clipping=clipping))
    assert seen["depth"][0, 0, 0] == shown
    assert seen["segmentation"][0, 0, 0] == -1
    assert seen["depth"][0, 16, 16] == pytest.approx(1.0, abs=1e-6)


def test_orthographic(ball: wc.Scene) -> None:
    seen = scenes.look(ball, scenes.own_camera(width=40, height=20, lens=wc.Orthographic(height=1.6)))
    row, column = np.mgrid[:20, :40]
    x, y = (column + 0.5 - 20) * 0.08, (10 - row - 0.5) * 0.08
    square = 0.25 - x**2 - y**2
    expected = np.where(square >= 0.0, 1.5 - np.sqrt(np.maximum(square, 0.0)), 2.0)
    assert np.abs(seen["depth"][0] - expected).max() <= 5e-6
    assert (seen["segmentation"][0] == np.where(square >= 0.0, 0, 1)).all()


@pytest.mark.parametrize(
    ("lens", "fx", "fy", "cx", "cy"),
    [
        (wc.Pinhole(fx=50.0), 50.0, 50.0, 24.0, 16.0),
        (wc.Pinhole(fx=50.0, fy=40.0, cx=10.5, cy=20.25), 50.0, 40.0, 10.5, 20.25),
        (wc.Pinhole(fovy=70.0), *(2 * [16.0 / np.tan(0.5 * np.radians(70.0))]), 24.0, 16.0),
    ],
)
def test_project_of_deproject_is_the_pixel(
    ball: wc.Scene, lens: wc.Lens, fx: float, fy: float, cx: float, cy: float
) -> None:
    position, rotation = np.array((0.2, -0.1, 0.3)), np.array((0.98, 0.1, -0.05, 0.15))
    camera = scenes.own_camera(
        width=48, height=32, lens=lens, position=position, rotation=rotation, outputs=("depth", "points")
    )
    seen = scenes.look(ball, camera)
    assert np.isfinite(seen["depth"]).all()
    local = (seen["points"][0].astype(np.float64) - position) @ scenes.matrix(rotation)
    depth = -local[..., 2]
    column, row = cx + fx * local[..., 0] / depth, cy - fy * local[..., 1] / depth
    expected_row, expected_column = np.mgrid[:32, :48] + 0.5
    assert np.abs(column - expected_column).max() <= 1e-3
    assert np.abs(row - expected_row).max() <= 1e-3
    assert np.abs(depth - seen["depth"][0]).max() <= 5e-6
