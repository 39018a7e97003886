"""Lidars in scenes of other simulators than MuJoCo, and the memory that they take."""

import gc
from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp
from allocation_ledger import Ledger
from lidar_scenes import downward, floor, host

import warpcam as wc
from warpcam import sensors
from warpcam.core.errors import WarpcamError
from warpcam.render import memory
from warpcam.sensors import patterns


def test_bodies_of_newton_are_followed(device: wp.Device) -> None:
    """The pose is that of the state as it is now, not of the last read; Newton's bodies move in stages of the frame."""
    newton = pytest.importorskip("newton")
    one = newton.ModelBuilder()
    base = one.add_body(xform=wp.transform(wp.vec3(0.0, 0.0, 1.0), wp.quat_identity()), label="base")
    one.add_shape_sphere(base, radius=0.1)
    builder = newton.ModelBuilder()
    for _ in range(2):
        builder.add_world(one)
    builder.add_shape_plane((0.0, 0.0, 1.0, 0.0), width=0.0, length=0.0)
    model = builder.finalize(device=device)
    state = model.state()
    scene = wc.from_newton(model, state)
    lidar = sensors.Lidar(
        scene, downward(4), parent="base", position=(0, 0, 0.2), exclude_body="base", outputs=("ranges", "bodies")
    )
    np.testing.assert_allclose(host(lidar.read())["ranges"], 1.2, rtol=1e-6)
    for height in (2.0, 3.0):
        poses = state.body_q.numpy()
        poses[:, 2] = (height, height + 0.5)
        state.body_q.assign(poses)
        ranges = host(lidar.read())["ranges"]
        np.testing.assert_allclose(ranges[:, 2, 2], (height + 0.2, height + 0.7), rtol=1e-6)
    other = model.state()
    scene.bind(other)
    np.testing.assert_allclose(host(lidar.read())["ranges"], 1.2, rtol=1e-6)


def test_bodies_of_worlds_that_differ_are_left_out(device: wp.Device) -> None:
    """Worlds may lack a column of shapes; where it is part of another body, nobody knows what to leave out."""
    newton = pytest.importorskip("newton")

    def scene_of(*worlds: tuple[str, ...]) -> wc.Scene:
        builder = newton.ModelBuilder()
        for labels in worlds:
            one = newton.ModelBuilder()
            for number, label in enumerate(labels):
                body = one.add_body(xform=wp.transform(wp.vec3(0, 0, 2.0 - number), wp.quat_identity()), label=label)
                one.add_shape_sphere(body, radius=0.1)
            builder.add_world(one)
        builder.add_shape_plane((0.0, 0.0, 1.0, 0.0), width=0.0, length=0.0)
        model = builder.finalize(device=device)
        return wc.from_newton(model, model.state())

    settings = {"position": (0, 0, 3), "exclude_body": "base", "outputs": ("ranges",)}
    lidar = sensors.Lidar(scene_of(("base", "ball"), ("base",)), downward(1), **settings)
    np.testing.assert_allclose(host(lidar.read())["ranges"].reshape(-1), (1.9, 3.0), rtol=1e-6)
    with pytest.raises(
        WarpcamError, match="a shape is part of such a body in some worlds and of another one in others"
    ):
        sensors.Lidar(scene_of(("base",), ("ball", "base")), downward(1), **settings)


def test_meshes_of_files_are_met(device: wp.Device) -> None:
    pytest.importorskip("pxr.Usd")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    cube = UsdGeom.Cube.Define(stage, "/Box")
    cube.GetSizeAttr().Set(2.0)
    scene = wc.from_usd(stage, num_worlds=2, device=device)
    scan = host(sensors.Lidar(scene, patterns.spinning([0.0], columns=4), position=(-3.0, 0.0, 0.0)).read())
    np.testing.assert_allclose(scan["ranges"][:, 0], [[2.0, np.inf, np.inf, np.inf]] * 2, rtol=1e-6)


def test_memory_is_told(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = floor(3, device)
    pattern = patterns.spinning([0.0, -10.0], columns=8, max_range=50.0)
    settings: dict[str, Any] = {"echoes": 2, "divergence": 0.1, "echo_gap": 0.5, "position": (0, 0, 1)}
    lidar = sensors.Lidar(scene, pattern, **settings)
    returns = 3 * 2 * 8 * 2
    assert lidar.memory.images["returns"] == {
        "ranges": 4 * returns,
        "intensities": 4 * returns,
        "ids": 4 * returns,
        "points": 12 * returns,
    }
    monkeypatch.setattr(memory, "free_bytes", lambda device: lidar.memory.total - 1)
    with pytest.raises(WarpcamError, match=f"{lidar.memory.total:,} bytes are needed"):
        sensors.Lidar(scene, pattern, **settings)
    monkeypatch.setattr(memory, "free_bytes", lambda device: lidar.memory.total)
    sensors.Lidar(scene, pattern, **settings)


def test_a_lidar_is_not_copied(device: wp.Device) -> None:
    import copy

    with pytest.raises(WarpcamError, match="Lidar: it cannot be copied or pickled"):
        copy.copy(sensors.Lidar(floor(1, device), downward(2), position=(0, 0, 1)))


def test_scenes_are_asked_for() -> None:
    with pytest.raises(WarpcamError, match="Lidar: scene must be made by from_mujoco_warp or the like, got MjModel"):
        sensors.Lidar(scenes.compile_xml("<geom size='1'/>"), downward(2))  # type: ignore[arg-type]


@pytest.mark.parametrize("sweep", ["instant", "moving"])
def test_reads_compile_and_allocate_nothing(
    device: wp.Device, sweep: str, loads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lidar = sensors.Lidar(
        floor(3, device),
        patterns.spinning([-10.0, -20.0], columns=16),
        position=(0, 0, 1),
        sweep=sweep,
        noise=sensors.LidarNoise(constant=0.01),
    )
    loads.clear()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    mask = wp.full(3, 1, dtype=wp.uint8, device=device)
    gc.collect()
    held = ledger.held
    for worlds in (None, mask):
        lidar.read()
        lidar.parameters.position[:] += 0.1
        lidar.read(worlds=worlds)
        lidar.reset(worlds=worlds)
    gc.collect()
    assert ledger.held == held and loads == []


@pytest.mark.parametrize("echoes", [1, 3])
def test_all_outputs_belong_to_clouds(device: wp.Device, echoes: int) -> None:
    """Echoes make five dimensions of points and normals, and times are one memory of all worlds."""
    beams = {"echoes": echoes, "divergence": 1.0, "echo_gap": 0.1} if echoes > 1 else {}
    pattern = patterns.spinning([-30.0, -60.0], columns=8)
    outputs = ("ranges", "ids", "normals", "points", "times")
    scan = sensors.Lidar(floor(2, device), pattern, position=(0.0, 0.0, 1.0), outputs=outputs, **beams).read()
    attributes = {name: scan[name] for name in outputs if name != "points"}
    cloud = sensors.PointClouds.of(scan["points"], attributes=attributes, num_points=16, method="first").read()
    assert cloud["count"].tolist() == [16, 16]
    for world in range(2):
        pixels = cloud["pixels"][world].long()
        for name in outputs:
            given = scan[name][world].reshape(16 * echoes, *cloud[name].shape[2:])
            assert torch.equal(cloud[name][world], given[pixels])
