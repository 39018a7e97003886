"""Ends of a lidar's range: surfaces exactly there, and rays along endless planes, which never end."""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from lidar_scenes import downward, floor, host, posed

import warpcam as wc
from warpcam import sensors
from warpcam.sensors import patterns

WALLS = "".join(f'<geom type="box" size="1 1 1" pos="{x} {y} 0"/>' for x, y in ((11, 0), (-11, 0), (0, 11), (0, -11)))
TURN = np.array((0.9, 0.1, -0.2, 0.4)) / np.linalg.norm((0.9, 0.1, -0.2, 0.4))
BACK = TURN * (1.0, -1.0, -1.0, -1.0)
WAYS: dict[str, dict[str, Any]] = {
    "lines": {},
    "moving": {"sweep": "moving"},
    "cones": {"divergence": 0.01, "echo_gap": 1.0, "echoes": 2},
}


def read(lidar: sensors.Lidar) -> dict[str, np.ndarray]:
    """The second sweep, as the first does not move."""
    lidar.read()
    return host(lidar.read())


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("turned", [False, True])
def test_a_surface_at_the_greatest_range_returns(device: wp.Device, way: str, turned: bool) -> None:
    """It returns no more than that range; one that is farther by more than rounding does not return."""
    body = '<body name="base" mocap="true"><geom size=".01" rgba="0 0 0 0"/></body>'
    mjm = scenes.compile_xml(WALLS + body)
    scene = wc.from_mujoco(mjm, posed(mjm, rotation=TURN if turned else (1, 0, 0, 0)), device=device)
    pattern = patterns.spinning([0.0], columns=4, max_range=10.0)
    lidar = sensors.Lidar(scene, pattern, parent="base", rotation=BACK if turned else (1, 0, 0, 0), **WAYS[way])
    first = read(lidar)["ranges"].reshape(4, -1)[:, 0]
    np.testing.assert_allclose(first, 10.0, rtol=1e-6)
    assert (first <= 10.0).all()
    lidar.parameters.max_range.fill_(10.0 - 1e-4)
    scan = read(lidar)
    assert np.isinf(scan["ranges"]).all() and (scan["ids"] == -1).all()


def test_straight_down_likewise(device: wp.Device) -> None:
    lidar = sensors.Lidar(floor(2, device), downward(5, max_range=3.0), position=((0, 0, 3.0), (0, 0, 3.001)))
    assert (host(lidar.read())["ranges"] == np.array((3.0, np.inf))[:, None, None]).all()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("height", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("max_range", [np.inf, 1.0e12])
def test_rays_along_an_endless_plane_do_not_return(
    device: wp.Device, way: str, turned: bool, height: float, max_range: float
) -> None:
    """Others do, however flat they are."""
    mjm = scenes.compile_xml(
        '<geom type="plane" size="0 0 1"/><geom type="plane" size="5 5 1" pos="0 0 -1"/>'
        '<body name="base" mocap="true"><geom size=".01" rgba="0 0 0 0"/></body>'
    )
    mjd = posed(mjm, (0.0, 0.0, height), TURN if turned else (1, 0, 0, 0))
    angles = np.radians(np.arange(0.5, 360.0))
    level = np.stack((np.cos(angles), np.sin(angles), np.zeros(360)), axis=-1)
    flat = np.array((1.0, 0.0, -1e-4))
    pattern = patterns.rays(np.concatenate((level, flat[None]))[None], rate=10.0, max_range=max_range)
    options = {**WAYS[way], "divergence": 1e-6} if way == "cones" else WAYS[way]
    lidar = sensors.Lidar(
        wc.from_mujoco(mjm, mjd, device=device),
        pattern,
        parent="base",
        rotation=BACK if turned else (1, 0, 0, 0),
        outputs=("ranges", "ids"),
        **options,
    )
    scan = read(lidar)
    ranges = scan["ranges"].reshape(361, -1)[:, 0]
    assert np.isinf(ranges[:-1]).all() and (scan["ids"].reshape(361, -1)[:-1, 0] == -1).all()
    np.testing.assert_allclose(ranges[-1], 1e4 * height, rtol=1e-2)


def test_walls_far_beyond_a_plane_return(device: wp.Device) -> None:
    """Level rays meet what stands on the plane, at any distance at which they do without it."""
    wall = '<geom type="box" size="1 5000 5000" pos="{} 0 0"/><geom type="plane" size="0 0 1"/>'
    lidars = []
    for distance in (10.0, 2000.0, 50000.0):
        mjm = scenes.compile_xml(wall.format(distance + 1.0))
        mjd = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, mjd)
        lidars.append(
            sensors.Lidar(
                wc.from_mujoco(mjm, mjd, device=device), patterns.rays([[(1.0, 0.0, 0.0)]]), position=(0, 0, 1.0)
            )
        )
    found = [float(lidar.read()["ranges"].reshape(-1)[0]) for lidar in lidars]
    np.testing.assert_allclose(found, (10.0, 2000.0, 50000.0), rtol=1e-6)


@pytest.mark.parametrize("resolution", [0.001, 0.002, 0.01])
@pytest.mark.parametrize("limit", [0.7, 30.0, 100.0, 120.0])
def test_a_surface_at_either_end_returns_when_ranges_are_rounded(
    device: wp.Device, limit: float, resolution: float
) -> None:
    """Steps of a millimetre add up to a little more or less than the range."""
    wall = scenes.compile_xml(f'<geom type="box" size="1 9 9" pos="{1.0 + limit} 0 0"/>')
    scene = wc.from_mujoco(wall, scenes.forward(wall), device=device)
    noise = sensors.LidarNoise(resolution=resolution)
    for ends in ({"max_range": limit}, {"min_range": limit}):
        lidar = sensors.Lidar(scene, patterns.rays([[(1.0, 0.0, 0.0)]], **ends), noise=noise)
        measured = host(lidar.read())["ranges"].ravel()
        np.testing.assert_allclose(measured, limit, rtol=1e-6)
        assert measured <= np.float32(limit) or "max_range" not in ends
    lidar.parameters.min_range.fill_(limit + 0.6 * resolution)
    assert np.isinf(host(lidar.read())["ranges"]).all()


def test_planes_that_are_not_there_take_no_returns(device: wp.Device) -> None:
    """A wall far away returns where the plane's rotation is zeros, and where the lidar does not see the plane."""
    wall = '<geom type="box" size="1 5000 5000" pos="2001 0 0"/>'
    mjm = scenes.compile_xml(wall + '<body name="floor"><geom type="plane" size="0 0 1"/></body>')
    m, d = scenes.put(mjm, 2)
    scenes.write(d.geom_xmat, (1, 1), 0.0)
    scene = wc.from_mujoco_warp(mjm, m, d)
    ahead = patterns.rays([[(1.0, 0.0, 0.0)]])
    lidar = sensors.Lidar(scene, ahead, position=(0.0, 0.0, 1.0))
    np.testing.assert_allclose(host(lidar.read())["ranges"].ravel(), 2000.0, rtol=1e-6)
    blind = sensors.Lidar(scene, ahead, position=(0.0, 0.0, 1e-4), exclude_body="floor")
    np.testing.assert_allclose(host(blind.read())["ranges"].ravel(), 2000.0, rtol=1e-6)
