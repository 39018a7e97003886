"""Lidars: what their rays meet, against MuJoCo's own, and how they are fixed to bodies."""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from lidar_scenes import around, downward, floor, host, posed

import warpcam as wc
from warpcam import sensors
from warpcam.core.errors import WarpcamError
from warpcam.sensors import patterns
from warpcam.sensors.scan_lens import parallel_lens

ALL = ("ranges", "intensities", "ids", "bodies", "normals", "points", "times")
TURN = np.array((0.9, 0.1, -0.2, 0.4))
MOUNT, MOUNT_TURN = (0.1, -0.05, 0.3), (0.8, 0.0, 0.1, -0.5)


def cast(mjm: mujoco.MjModel, mjd: mujoco.MjData, start: Any, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance, inf where nothing is hit, and geom id of rays (n, 3), which do not meet the body "base"."""
    ids, distances = np.zeros(len(rays), np.int32), np.zeros(len(rays))
    base = mjm.body("base").id
    mujoco.mj_multiRay(
        mjm, mjd, np.asarray(start), rays.reshape(-1), None, 1, base, ids, distances, None, len(rays), mujoco.mjMAXVAL
    )
    return np.where(ids >= 0, distances, np.inf), ids


@pytest.mark.parametrize("parent", ["base", None])
def test_ranges_are_those_of_mj_multi_ray(device: wp.Device, parent: str | None) -> None:
    """Of all types of shapes but height fields, which it loses: tests/render/test_mj_ray.py has these."""
    mjm = around(tuple(kind for kind in scenes.TYPES if kind != "hfield"))
    mjds = [posed(mjm), posed(mjm, (0.3, -0.2, 0.1), TURN)]
    pattern = patterns.spinning(np.linspace(40.0, -40.0, 24), columns=180)
    lidar = sensors.Lidar(
        wc.from_mujoco(mjm, mjds, device=device),
        pattern,
        parent=parent,
        position=MOUNT,
        rotation=MOUNT_TURN,
        exclude_body="base",
        outputs=ALL,
    )
    scan = host(lidar.read())
    for world, mjd in enumerate(mjds):
        base = mjd.body("base")
        frame = base.xmat.reshape(3, 3) if parent else np.eye(3)
        start = (base.xpos if parent else 0.0) + frame @ MOUNT
        rays = pattern.directions.reshape(-1, 3).astype(np.float64) @ (frame @ scenes.matrix(MOUNT_TURN)).T
        distances, ids = cast(mjm, mjd, start, rays)
        seen, ranges = scan["ids"][world].reshape(-1), scan["ranges"][world].reshape(-1)
        assert len(np.unique(ids)) == mjm.ngeom  # all but the shell, and no hit
        same = seen == ids
        assert (~same).sum() <= 4  # where a ray grazes an edge
        np.testing.assert_allclose(ranges[same & (ids >= 0)], distances[same & (ids >= 0)], atol=1e-4)
        assert np.isinf(ranges[same & (ids < 0)]).all()
        np.testing.assert_array_equal(scan["bodies"][world].reshape(-1)[seen >= 0], mjm.geom_bodyid[seen[seen >= 0]])


def test_height_fields_are_met(device: wp.Device) -> None:
    mjm = around(("hfield",))
    mjd = posed(mjm)
    lidar = sensors.Lidar(
        wc.from_mujoco(mjm, mjd, device=device),
        patterns.grid((1.0, 0.8), 0.1),
        position=(2.5, 0.0, 3.0),
        outputs=("ranges", "ids"),
    )
    scan, found = host(lidar.read()), np.zeros(1, np.int32)
    for place, along in zip(lidar.pattern.origins.reshape(-1, 3), scan["ranges"].reshape(-1), strict=True):
        start = np.array((2.5, 0.0, 3.0)) + place
        distance = mujoco.mj_ray(mjm, mjd, start, np.array((0.0, 0.0, -1.0)), None, 1, -1, found)
        assert abs(along - distance) < 1e-4


@pytest.mark.parametrize("rows", ["up", "down", "one"])
def test_grids_are_as_fast_as_images(device: wp.Device, rows: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Straight down from a grid a lens without a table sees what a table sees; no other rays have that lens."""
    pattern = patterns.grid((5.0, 0.0 if rows == "one" else 4.0), 0.1)
    turn = slice(None, None, -1 if rows == "down" else 1)
    pattern = patterns.rays(pattern.directions, origins=pattern.origins[turn])
    mjm = around()
    scene = wc.from_mujoco(mjm, posed(mjm, (0.1, 0.2, 2.0), TURN), device=device)
    settings = {"parent": "base", "exclude_body": "base", "outputs": ALL, "position": MOUNT, "alignment": "yaw"}
    fast = sensors.Lidar(scene, pattern, **settings)
    seen = host(fast.read())
    assert fast.renderer.memory.worlds < 4 * pattern.rows * pattern.columns
    monkeypatch.setattr("warpcam.sensors.lidar.parallel_lens", lambda pattern: None)
    table = host(sensors.Lidar(scene, pattern, **settings).read())
    same = seen["ids"] == table["ids"]
    assert same.mean() > 0.99 and (seen["ids"] >= 0).mean() > 0.05
    for name in ("ranges", "points", "normals", "intensities"):
        np.testing.assert_allclose(seen[name][same], table[name][same], atol=2e-3 if name == "normals" else 1e-4)


@pytest.mark.parametrize(
    "pattern",
    [
        patterns.grid((1.0, 0.6), 0.2, ordering="yx"),
        patterns.grid((1.0, 0.6), 0.2, direction=(0.0, 0.1, -1.0)),
        patterns.grid((1.0, 0.5), 0.2),
        patterns.rays(np.full((2, 2, 3), (0, 0, -1.0)), origins=np.random.default_rng(0).uniform(size=(2, 2, 3))),
        patterns.spinning([-90.0], columns=4),
    ],
)
def test_other_rays_have_tables(pattern: patterns.Pattern) -> None:
    assert parallel_lens(pattern) is None


@pytest.mark.parametrize("frame", ["sensor", "world"])
def test_points_lie_at_the_end_of_rays(device: wp.Device, frame: str) -> None:
    mjm = around()
    mjd = posed(mjm, (0.2, 0.1, 0.0), TURN)
    pattern = patterns.rays(
        patterns.velodyne_vlp16(20.0).directions[:, ::9],
        origins=np.random.default_rng(0).uniform(-0.05, 0.05, (16, 101, 3)),
        min_range=0.3,
    )
    settings = {"parent": "base", "position": MOUNT, "rotation": MOUNT_TURN, "exclude_body": "base", "outputs": ALL}
    lidar = sensors.Lidar(wc.from_mujoco(mjm, mjd, device=device), pattern, frame=frame, **settings)
    scan = host(lidar.read())
    hit = scan["ids"][0] >= 0
    ends = pattern.origins[hit] + scan["ranges"][0][hit][:, None] * pattern.directions[hit]
    if frame == "world":
        base = mjd.body("base")
        turn = base.xmat.reshape(3, 3)
        ends = base.xpos + (MOUNT + ends @ scenes.matrix(MOUNT_TURN).T) @ turn.T
    assert 0.1 < hit.mean() < 0.9
    np.testing.assert_allclose(scan["points"][0][hit], ends, atol=2e-5)
    assert np.isinf(scan["points"][0][~hit]).all()
    np.testing.assert_allclose(np.linalg.norm(scan["normals"][0][hit], axis=-1), 1.0, atol=1e-5)
    assert (scan["normals"][0][~hit] == 0.0).all() and (scan["intensities"][0][~hit] == 0.0).all()


@pytest.mark.parametrize("output", ALL)
def test_outputs_alone_are_those_of_all(device: wp.Device, output: str) -> None:
    mjm = around()
    scene = wc.from_mujoco(mjm, posed(mjm), device=device)
    settings = {"parent": "base", "exclude_body": "base"}
    pattern = patterns.spinning([-5.0, 5.0], columns=90)
    alone = host(sensors.Lidar(scene, pattern, outputs=(output,), **settings).read())
    assert list(alone) == [output]
    together = host(sensors.Lidar(scene, pattern, outputs=ALL, **settings).read())
    np.testing.assert_array_equal(alone[output], together[output])


@pytest.mark.parametrize("alignment", ["base", "yaw", "world"])
@pytest.mark.parametrize("pitch", [0.3, 1.55])
def test_alignment(device: wp.Device, alignment: str, pitch: float) -> None:
    """A scan's places follow the body's turn about z, its rays stay upright."""
    yaw = 0.7
    turn = np.zeros(4)
    mujoco.mju_mulQuat(turn, (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)), (np.cos(pitch / 2), 0, np.sin(pitch / 2), 0))
    mjm = scenes.compile_xml(
        '<geom type="plane" size="0 0 1"/><body name="base" mocap="true"><geom size=".01" rgba="0 0 0 0"/></body>'
    )
    mjd = posed(mjm, (1.0, 2.0, 3.0), turn)
    pattern = patterns.grid((0.6, 0.4), 0.2)
    lidar = sensors.Lidar(
        wc.from_mujoco(mjm, mjd, device=device),
        pattern,
        parent="base",
        position=(0.1, 0.0, 0.2),
        alignment=alignment,
        frame="world",
        outputs=("ranges", "points"),
    )
    scan = host(lidar.read())
    frame = mjd.body("base").xmat.reshape(3, 3)
    start = mjd.body("base").xpos + frame @ (0.1, 0.0, 0.2)
    level = scenes.matrix((np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)))
    rotation = {"base": frame, "yaw": level, "world": np.eye(3)}[alignment]
    starts, along = start + pattern.origins @ rotation.T, rotation @ (0.0, 0.0, -1.0)
    expected = np.where(along[2] < -1e-3, starts[..., 2] / -along[2], np.inf)
    np.testing.assert_allclose(scan["ranges"][0], expected, rtol=2e-4, atol=1e-4)
    if np.isfinite(expected).all() and expected.max() < 100.0:
        np.testing.assert_allclose(scan["points"][0], starts + expected[..., None] * along, atol=2e-4)


def test_only_some_worlds_are_read(device: wp.Device) -> None:
    """Mounts of each world are written in place, and the memory stays."""
    scene = floor(3, device)
    heights = np.array([1.0, 2.0, 3.0], np.float32)
    places = np.stack((np.zeros(3), np.zeros(3), heights), axis=-1)
    lidar = sensors.Lidar(scene, downward(5), position=places, outputs=("ranges", "points", "times"))
    scan = lidar.read()
    memory = {name: tensor.data_ptr() for name, tensor in scan.items()}
    np.testing.assert_allclose(scan["ranges"][:, 2, 2].cpu().numpy(), heights, rtol=1e-6)
    lidar.parameters.position[:, 2] += 0.5
    mask = torch.tensor([False, True, True], device=scan["ranges"].device)
    for worlds, raised in (([0], [0.5, 0, 0]), (mask, [0.5, 0.5, 0.5])):
        again = lidar.read(worlds=worlds)
        assert {name: tensor.data_ptr() for name, tensor in again.items()} == memory
        np.testing.assert_allclose(scan["ranges"][:, 4, 4].cpu().numpy(), heights + raised, rtol=1e-6)
    lidar.parameters.max_range[1] = 2.2
    lidar.parameters.min_range[2] = 3.6
    ranges = lidar.read()["ranges"][:, 0, 0].cpu().numpy()
    assert ranges[0] == 1.5 and np.isinf(ranges[1:]).all()
    assert scan["times"].shape == (3, 5, 5)


@pytest.mark.parametrize("miss", [0.0, -1.0, np.nan, np.inf])
def test_misses_have_the_value_that_is_asked_for(device: wp.Device, miss: float) -> None:
    lidar = sensors.Lidar(floor(1, device), downward(3, max_range=1.0), position=(0, 0, 2), miss=miss, outputs=ALL)
    scan = host(lidar.read())
    assert scan["ranges"].tobytes() == np.full((1, 3, 3), miss, np.float32).tobytes()
    np.testing.assert_array_equal(scan["points"], np.full((1, 3, 3, 3), miss))
    assert (scan["ids"] == -1).all() and (scan["bodies"] == -1).all()


def test_near_surfaces_block_rays(device: wp.Device) -> None:
    """What is nearer than the least range gives no return, and hides what is behind."""
    mjm = scenes.compile_xml('<geom type="plane" size="9 9 1"/><geom type="box" size="1 1 .1" pos="0 0 1.9"/>')
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    pattern = patterns.rays(np.array([[(0.0, 0.0, -1.0)]]), min_range=0.5)
    assert np.isinf(host(sensors.Lidar(scene, pattern, position=(0, 0, 2.2)).read())["ranges"])
    assert host(sensors.Lidar(scene, pattern, position=(0, 0, 2.6)).read())["ranges"] == pytest.approx(0.6)


@pytest.mark.parametrize("intensity", ["reflectivity", "raw"])
def test_intensities(device: wp.Device, intensity: str) -> None:
    """Reflectance times the cosine of incidence, less what the air takes."""
    angles = np.radians([0.0, 30.0, 60.0])
    pattern = patterns.rays(np.stack((np.sin(angles), 0 * angles, -np.cos(angles)), axis=-1)[None])
    lidar = sensors.Lidar(
        floor(1, device, rgba=".8 .4 .2 1"),
        pattern,
        position=(0, 0, 2),
        intensity=intensity,
        dropout=sensors.LidarDropout(attenuation=0.1),
    )
    scan = host(lidar.read())
    display = np.round(255.0 * np.array([0.8, 0.4, 0.2])) / 255.0
    linear = ((display + 0.055) / 1.055) ** 2.4
    distance = 2.0 / np.cos(angles)
    expected = linear @ (0.2126, 0.7152, 0.0722) * np.cos(angles) * np.exp(-0.1 * distance)
    expected /= distance**2 if intensity == "raw" else 1.0
    np.testing.assert_allclose(scan["ranges"][0, 0], distance, rtol=1e-6)
    np.testing.assert_allclose(scan["intensities"][0, 0], expected, rtol=1e-2)


def test_reads_are_part_of_a_capture(device: wp.Device) -> None:
    scene = floor(2, device)
    lidar = sensors.Lidar(scene, downward(4), position=(0, 0, 1), noise=sensors.LidarNoise(constant=0.01))
    lidar.read()
    every = torch.ones(2, dtype=torch.bool, device=lidar.scan["ranges"].device)
    with wp.ScopedCapture(device) as capture:
        lidar.read()
        lidar.reset(every)
    seen = []
    for height in (2.0, 3.0):
        lidar.parameters.position[:, 2] = height
        wp.synchronize()
        wp.capture_launch(capture.graph)
        seen.append(host(lidar.scan)["ranges"])
        assert abs(seen[-1].mean() - height) < 0.02
    assert (seen[0] - 2.0 != seen[1] - 3.0).any()


def test_worlds_that_never_ran_return_nothing(device: wp.Device) -> None:
    mjm = around(("sphere",))
    mjd = posed(mjm)
    scene = wc.from_mujoco(mjm, [mjd, mjd, mujoco.MjData(mjm)], device=device)
    lidar = sensors.Lidar(scene, patterns.spinning([0.0], columns=90), parent="base", exclude_body="base")
    scan = host(lidar.read())
    assert np.isfinite(scan["ranges"][0]).any() and (scan["ranges"][0] == scan["ranges"][1]).all()
    assert np.isinf(scan["ranges"][2]).all() and lidar.renderer.faulty.cpu().tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"pattern": "os1"}, "Lidar: pattern must be of warpcam.sensors.patterns, got 'os1'"),
        ({"parent": "wing"}, "Lidar: parent: the scene has no body 'wing'"),
        ({"exclude_body": "wing"}, "Lidar: exclude_body: the scene has no body 'wing'"),
        ({"exclude_body": ("base", 9)}, "Lidar: exclude_body: the scene has no body 9"),
        ({"position": (0.0, 1.0)}, r"Lidar: position must have shape \(3,\) or \(1, 3\), got \(2,\)"),
        ({"rotation": (0, 0, 0, 0)}, "Lidar: rotation must not be of length 0"),
        ({"alignment": "roll"}, "Lidar: alignment must be 'base' or 'yaw' or 'world', got 'roll'"),
        ({"frame": "map"}, "Lidar: frame must be 'sensor' or 'world', got 'map'"),
        ({"sweep": "slow"}, "Lidar: sweep must be 'instant' or 'moving', got 'slow'"),
        ({"sweep": "moving"}, "needs a pattern with a rate"),
        (
            {"sweep": "moving", "pattern": sensors.patterns.spinning([0.0], columns=2, row_times=0.06)},
            r"needs times of the pattern from 0 to 1 / rate, which is 0\.1 s, got 0\.11",
        ),
        (
            {"sweep": "moving", "pattern": sensors.patterns.spinning([0.0], columns=2, row_times=-0.01)},
            r"needs times of the pattern from 0 to 1 / rate, which is 0\.1 s, got -0\.01",
        ),
        ({"far_sides": "no", "outputs": ("ranges",)}, "Lidar: far_sides must be True or False, got 'no'"),
        ({"intensity": 1}, "Lidar: intensity must be 'reflectivity' or 'raw', got 1"),
        ({"miss": None}, "Lidar: miss must be a number, got None"),
        ({"outputs": ("range",)}, r"Lidar: outputs must be some of 'ranges', .*, got \('range',\)"),
        ({"outputs": "ranges"}, "Lidar: outputs must be some of"),
        ({"outputs": ()}, "Lidar: outputs must be some of"),
        ({"noise": 0.01}, "Lidar: noise must be sensors.LidarNoise or None, got 0.01"),
        ({"noise": sensors.LidarNoise(resolution=-1.0)}, "LidarNoise: resolution must be from 0 to inf, got -1"),
        ({"dropout": sensors.LidarDropout(rate=1.5)}, "LidarDropout: rate must be from 0 to 1, got 1.5"),
        (
            {"dropout": sensors.LidarDropout(rate=[0.1, 0.2])},
            r"LidarDropout: rate must have shape a number or \(1,\), got \(2,\)",
        ),
        ({"frame": np.array(["sensor", "world"])}, "Lidar: frame must be 'sensor' or 'world', got array"),
        ({"alignment": np.array([1, 2])}, "Lidar: alignment must be 'base' or 'yaw' or 'world', got array"),
        (
            {"exclude_body": True},
            "Lidar: exclude_body must be a body's name or index, .*, got True",
        ),
        ({"exclude_body": {"a"}}, "Lidar: exclude_body must be a body's name or index"),
        ({"echoes": 2}, "Lidar: 2 echoes need divergence and echo_gap"),
        ({"echoes": 8}, "Lidar: echoes must be a whole number from 1 to 7, got 8"),
        ({"divergence": 0.1}, "Lidar: divergence and echo_gap go together, got 0.1 and None"),
        ({"divergence": 0.0, "echo_gap": 1.0}, r"Lidar: divergence must be a number in \(0, 90\), got 0.0"),
        ({"divergence": 0.1, "echo_gap": -1.0}, "Lidar: echo_gap must be a number"),
        ({"seed": 1.5}, "Lidar: seed must be a whole number of 32 bits, "),
    ],
)
def test_refused(settings: dict[str, Any], text: str) -> None:
    mjm = around(("sphere",))
    scene = wc.from_mujoco(mjm, posed(mjm), device="cpu")
    with pytest.raises(WarpcamError, match=text):
        sensors.Lidar(scene, **{"pattern": downward(2), **settings})
