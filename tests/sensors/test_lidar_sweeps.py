"""Sweeps of lidars: rays sent on the way, tables that go on, and several returns of a beam."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp
from lidar_scenes import around, host, posed

import warpcam as wc
from warpcam import sensors
from warpcam.sensors import patterns

MOUNT = {"parent": "base", "position": (0.05, 0.02, 0.25), "rotation": (0.9, 0.0, 0.1, 0.3), "exclude_body": "base"}
POSES = [((0.0, 0.0, 0.0), (1, 0, 0, 0)), ((0.3, -0.2, 0.1), (0.95, 0.1, 0.0, 0.3)), ((0.4, 0.2, 0.0), (-1, 0, 0, 1))]
OUTPUTS = ("ranges", "ids", "points", "normals", "intensities")


def between(pose: Any, other: Any, part: float) -> tuple[np.ndarray, np.ndarray]:
    """Pose on a straight line from one to the other, at a constant turn."""
    first, second = (np.asarray(turn, np.float64) / np.linalg.norm(turn) for _, turn in (pose, other))
    second = second if first @ second > 0.0 else -second
    angle = np.arccos(np.clip(first @ second, -1.0, 1.0))
    turn = second if angle < 1e-9 else np.sin((1 - part) * angle) * first + np.sin(part * angle) * second
    return (1 - part) * np.asarray(pose[0]) + part * np.asarray(other[0]), turn / np.linalg.norm(turn)


def mounted(pose: Any) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the sensor on a base in that pose."""
    turn = np.zeros(4)
    base, own = (np.asarray(each, np.float64) / np.linalg.norm(each) for each in (pose[1], MOUNT["rotation"]))
    scenes.mujoco.mju_mulQuat(turn, base, own)
    return np.asarray(pose[0]) + scenes.matrix(base) @ MOUNT["position"], turn


@pytest.mark.parametrize("origins", [False, True])
def test_rays_are_sent_on_the_way(device: wp.Device, origins: bool) -> None:
    """Each column is that of an instant sweep from where the sensor was then."""
    mjm = around()
    mjds = [posed(mjm, *POSES[0]) for _ in range(2)]
    pattern = patterns.spinning(np.linspace(30, -30, 10), columns=45, radius=0.05 if origins else 0.0)
    settings = {**MOUNT, "outputs": OUTPUTS, "frame": "world"}
    moving = sensors.Lidar(wc.from_mujoco(mjm, mjds, device=device), pattern, sweep="moving", **settings)
    here = posed(mjm)
    placed = {**settings, "parent": None}
    instant = sensors.Lidar(wc.from_mujoco(mjm, here, device=device), pattern, **placed)

    def instants(world: int, last: Any, now: Any) -> None:
        """Compare some columns of a world with sweeps from between two poses."""
        for column in (0, 11, 30, 44):
            place, turn = between(mounted(last), mounted(now), column / 45)
            instant.parameters.position[0] = torch.as_tensor(place)
            instant.parameters.rotation[0] = torch.as_tensor(turn)
            expected, seen = host(instant.read()), {name: image[world, :, column] for name, image in scan.items()}
            same = seen["ids"] == expected["ids"][0, :, column]
            assert (~same).sum() <= 1
            for name, tolerance in (("ranges", 1e-4), ("points", 1e-4), ("normals", 1e-3), ("intensities", 1e-2)):
                found = same & (seen["ids"] >= 0)
                np.testing.assert_allclose(
                    seen[name][found], expected[name][0, :, column][found], atol=tolerance, err_msg=name
                )

    def place(world: int, pose: Any) -> None:
        mjds[world].mocap_pos[0], mjds[world].mocap_quat[0] = pose[0], np.asarray(pose[1]) / np.linalg.norm(pose[1])
        scenes.mujoco.mj_forward(mjm, mjds[world])

    scan = host(moving.read())  # the first is instant
    instants(0, POSES[0], POSES[0])
    place(0, POSES[1])
    place(1, POSES[1])
    scan = host(moving.read(worlds=[0]))
    instants(0, POSES[0], POSES[1])
    place(0, POSES[2])
    scan = host(moving.read())
    instants(0, POSES[1], POSES[2])
    instants(1, POSES[0], POSES[1])
    moving.reset(worlds=[1])
    place(1, POSES[2])
    scan = host(moving.read())
    instants(0, POSES[2], POSES[2])
    instants(1, POSES[2], POSES[2])
    moving.reset()


def livox(tmp_path: Path, rays: int, samples: int) -> patterns.Pattern:
    random = np.random.default_rng(5)
    path = tmp_path / "table.csv"
    rows = np.stack((np.arange(rays), random.uniform(0, 360, rays), random.uniform(0, 180, rays)), axis=-1)
    np.savetxt(path, rows, delimiter=",", header="Time/s,Azimuth/deg,Zenith/deg", comments="")
    return patterns.livox_csv(path, samples=samples)


@pytest.mark.parametrize("sweep", ["instant", "moving"])
def test_tables_go_on_at_each_read(device: wp.Device, tmp_path: Path, sweep: str) -> None:
    """Windows follow each other and wrap at the table's end, whichever worlds are read."""
    pattern = livox(tmp_path, 1500, 600)
    mjm = around()
    scene = wc.from_mujoco(mjm, [posed(mjm)] * 2, device=device)
    lidar = sensors.Lidar(scene, pattern, sweep=sweep, outputs=OUTPUTS, **MOUNT)
    for read in range(4):
        scan = host(lidar.read(worlds=[1] if read == 2 else None))
        window = pattern.table[(600 * read + np.arange(600)) % 1500].reshape(150, 4, 3).transpose(1, 0, 2)
        alone = sensors.Lidar(scene, patterns.rays(window), outputs=OUTPUTS, **MOUNT)
        expected = host(alone.read())
        same = scan["ids"][1] == expected["ids"][1]
        assert same.mean() > 0.98 and (scan["ids"][1] >= 0).any()
        hit = same & (scan["ids"][1] >= 0)
        for name in ("ranges", "points"):
            np.testing.assert_allclose(scan[name][1][hit], expected[name][1][hit], atol=1e-4)


@pytest.mark.parametrize("sweep", ["instant", "moving"])
def test_rays_straight_up_and_down(device: wp.Device, sweep: str) -> None:
    """Rays along all axes, which tables have to hold; a table of Livox's writes them on the device."""
    directions = np.array(
        [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (1e-5, 0, 1), (0, 0, 0)]
    )
    pattern = patterns.Pattern(directions.reshape(2, 4, 3).astype(np.float64), rate=1.0)
    table = replace(pattern, table=pattern.directions.transpose(1, 0, 2).reshape(-1, 3))
    walls = '<geom type="box" size=".5 .5 .5" pos="{} {} {}"/>'
    places = [(0, 0, 2), (0, 0, -2), (2.5, 0, 0), (-2.5, 0, 0), (0, 3, 0), (0, -3, 0)]
    mjm = scenes.compile_xml("".join(walls.format(*place) for place in places))
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    for each in (pattern, table):
        ranges = host(sensors.Lidar(scene, each, sweep=sweep).read())["ranges"].reshape(-1)
        np.testing.assert_allclose(ranges, [1.5, 1.5, 2.0, 2.0, 2.5, 2.5, 1.5, np.inf], atol=1e-5)


def edge(device: wp.Device, rows: int = 1) -> tuple[wc.Scene, patterns.Pattern]:
    """A white wall at x = 4, before it a grey one at x = 2 from y = 0 on, and beams at it, one along its edge."""
    mjm = scenes.compile_xml(
        '<geom type="box" size=".1 9 9" pos="4.1 0 0" rgba="1 1 1 1"/>'
        '<geom type="box" size=".1 9 9" pos="2.1 9 0" rgba=".5 .5 .5 1"/>'
    )
    azimuths = np.radians([10.0, 0.0, -10.0])
    directions = np.stack((np.cos(azimuths), np.sin(azimuths), 0 * azimuths), axis=-1)
    return wc.from_mujoco(mjm, scenes.forward(mjm), device=device), patterns.rays(np.tile(directions, (rows, 1, 1)))


def test_beams_at_edges_have_two_echoes(device: wp.Device) -> None:
    scene, pattern = edge(device, rows=3)
    settings = {"divergence": 0.5, "echo_gap": 0.3, "position": (0, -0.001, 0), "outputs": OUTPUTS}
    scan = host(sensors.Lidar(scene, pattern, echoes=2, **settings).read())
    assert scan["ranges"].shape == (1, 3, 3, 2) and scan["points"].shape == (1, 3, 3, 2, 3)
    for row in range(3):
        left, middle, right = scan["ranges"][0, row]
        np.testing.assert_allclose(left, [2.0 / np.cos(np.radians(10.0)), np.inf], rtol=2e-3)
        np.testing.assert_allclose(right, [4.0 / np.cos(np.radians(10.0)), np.inf], rtol=2e-3)
        np.testing.assert_allclose(middle, [4.0, 2.0], rtol=1e-4)  # four rays of seven end behind
        assert scan["ids"][0, row].tolist() == [[1, -1], [0, 1], [0, -1]]
        strengths = scan["intensities"][0, row, 1]
        grey = ((128 / 255 + 0.055) / 1.055) ** 2.4
        np.testing.assert_allclose(strengths, [4 / 7, 3 / 7 * grey], rtol=2e-2)
        np.testing.assert_allclose(scan["points"][0, row, 1], [(4.0, 0, 0), (2.0, 0, 0)], atol=1e-3)
    one = host(sensors.Lidar(scene, pattern, echoes=1, **settings).read())
    np.testing.assert_array_equal(one["ranges"], scan["ranges"][..., 0])
    wide = host(sensors.Lidar(scene, pattern, echoes=2, **{**settings, "echo_gap": 3.0}).read())
    np.testing.assert_allclose(wide["ranges"][0, 0, 1], [(4 * 4.0 + 3 * 2.0) / 7, np.inf], rtol=1e-3)


def test_echoes_of_tables_and_on_the_way(device: wp.Device, tmp_path: Path) -> None:
    """All rays of a beam are sent at its time, and come from its place in the table."""
    pattern = livox(tmp_path, 900, 600)
    mjm = around()
    scene = wc.from_mujoco(mjm, posed(mjm), device=device)
    settings = {**MOUNT, "divergence": 1e-3, "echo_gap": 0.1}
    lidars = [
        sensors.Lidar(scene, pattern, **MOUNT),
        sensors.Lidar(scene, pattern, echoes=2, **settings),
        sensors.Lidar(scene, pattern, echoes=2, sweep="moving", **settings),
    ]
    for _ in range(2):
        one, *others = (host(lidar.read()) for lidar in lidars)
        for two in others:
            same = one["ids"] == two["ids"][..., 0]
            assert same.mean() > 0.98
            hit = same & (one["ids"] >= 0)
            for name in ("ranges", "points"):
                np.testing.assert_allclose(two[name][hit][:, 0], one[name][hit], atol=1e-3)
            assert np.isinf(two["ranges"][..., 1]).mean() > 0.95
            np.testing.assert_array_equal(two["times"][..., 1], one["times"])


def test_echoes_have_noise_of_their_own(device: wp.Device) -> None:
    scene, pattern = edge(device, rows=200)
    settings = {"divergence": 0.5, "echo_gap": 0.3, "position": (0, -0.001, 0), "noise": sensors.LidarNoise(0.01)}
    lidar = sensors.Lidar(scene, pattern, echoes=2, outputs=("ranges",), **settings)
    ranges = host(lidar.read())["ranges"][0, :, 1].astype(np.float64)
    np.testing.assert_allclose(ranges.std(axis=0), 0.01, rtol=0.2)
    assert abs(np.corrcoef(ranges.T)[0, 1]) < 0.2


def test_a_reset_of_some_worlds_takes_a_mask(device: wp.Device) -> None:
    mjm = around(("sphere",))
    scene = wc.from_mujoco(mjm, [posed(mjm)] * 2, device=device)
    lidar = sensors.Lidar(scene, patterns.spinning([0.0], columns=8), sweep="moving", **MOUNT)
    lidar.read()
    lidar.reset(worlds=torch.tensor([1, 0], dtype=torch.uint8, device=lidar.scan["ranges"].device))
    with pytest.raises(wc.WarpcamError, match=r"Lidar\.reset: worlds has id 2; allowed are 0 to 1"):
        lidar.reset(worlds=[2])
