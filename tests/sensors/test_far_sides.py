"""Rays that begin within shapes, against MuJoCo's."""

import gc
from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from allocation_ledger import Ledger
from lidar_scenes import floor, host

import warpcam as wc
from warpcam import sensors
from warpcam.core.errors import WarpcamError
from warpcam.sensors import patterns

SOLIDS = {
    "sphere": (0.4,), "capsule": (0.3, 0.5), "ellipsoid": (0.3, 0.5, 0.4), "cylinder": (0.4, 0.3),
    "box": (0.3, 0.4, 0.5),
}  # fmt: skip
BALL, UNSEEN, BOX, SHELL = range(4)  # geoms of solid_around()
OUTPUTS = ("ranges", "ids", "bodies", "normals")
DIRECTIONS = np.random.default_rng(1).normal(size=(40, 33, 3))


def solid_around(kind: str) -> tuple[mujoco.MjModel, list[mujoco.MjData]]:
    """A leaning shape about the origin, with a smaller ball in it, an unseen one, and a box outside of it."""
    more = 'pos=".05 -.1 .08" quat=".8 .3 -.2 .4"'
    mjm = scenes.compile_xml(
        f'<body name="shell" mocap="true">{scenes.geom_xml(kind, size=SOLIDS[kind], more=more)}</body>'
        '<geom type="sphere" size=".04" pos=".15 0 .1"/>'
        '<geom type="sphere" size=".2" rgba="1 0 0 0"/>'
        '<geom type="box" size=".3 .3 .3" pos="1.5 0 0"/>'
    )
    mjds = [mujoco.MjData(mjm) for _ in range(2)]
    mjds[1].mocap_pos[0], mjds[1].mocap_quat[0] = (0.1, 0.05, -0.08), (0.6, -0.3, 0.5, 0.4)
    for mjd in mjds:
        mujoco.mj_forward(mjm, mjd)
    return mjm, mjds


def judged(mjm: mujoco.MjModel, mjd: mujoco.MjData, starts: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Distances, geom ids and outward normals of rays (ray, 3) by ``mj_ray``."""
    found, normal = np.zeros(1, np.int32), np.zeros(3)
    ids, distances, normals = np.zeros(len(rays), int), np.zeros(len(rays)), np.zeros((len(rays), 3))
    for ray, (start, along) in enumerate(zip(starts, rays, strict=True)):
        distances[ray] = mujoco.mj_ray(mjm, mjd, start, along, None, True, -1, found, normal)
        ids[ray], normals[ray] = found[0], normal
    return distances, ids, normals


@pytest.mark.parametrize("kind", SOLIDS)
@pytest.mark.parametrize("apart", [False, True])
def test_rays_from_within_are_those_of_mj_ray(device: wp.Device, kind: str, apart: bool) -> None:
    """All of them begin within the shape, or some of them do."""
    mjm, mjds = solid_around(kind)
    random = np.random.default_rng(0)
    origins = random.uniform(-0.4, 0.4, DIRECTIONS.shape) if apart else None
    pattern = patterns.rays(DIRECTIONS, origins=origins)
    lidar = sensors.Lidar(wc.from_mujoco(mjm, mjds, device=device), pattern, far_sides=True, outputs=OUTPUTS, miss=-1.0)
    scan = host(lidar.read())
    rays = pattern.directions.reshape(-1, 3).astype(np.float64)
    starts = np.zeros_like(rays) if origins is None else pattern.origins.reshape(-1, 3).astype(np.float64)
    for world, mjd in enumerate(mjds):
        distances, ids, normals = judged(mjm, mjd, starts, rays)
        assert (ids == SHELL).mean() > 0.3 and (ids == BALL).any() and (ids != UNSEEN).all()
        same = scan["ids"][world].reshape(-1) == ids
        assert (~same).sum() <= 2  # at an edge
        np.testing.assert_allclose(scan["ranges"][world].reshape(-1)[same], distances[same], atol=1e-4)
        np.testing.assert_allclose(scan["normals"][world].reshape(-1, 3)[same], normals[same], atol=2e-3)
        bodies = np.where(ids >= 0, mjm.geom_bodyid[ids], -1)
        np.testing.assert_array_equal(scan["bodies"][world].reshape(-1)[same], bodies[same])


def test_grids_that_are_as_fast_as_images_meet_far_sides(device: wp.Device) -> None:
    """Rows of their images may run the other way."""
    mjm, mjds = solid_around("box")
    pattern = patterns.grid((0.9, 0.5), 0.03)
    settings: dict[str, Any] = {"far_sides": True, "outputs": OUTPUTS, "miss": -1.0, "position": (0.03, 0.02, 0.0)}
    lidar = sensors.Lidar(wc.from_mujoco(mjm, mjds, device=device), pattern, **settings)
    ranges = host(lidar.read())["ranges"]
    starts = pattern.origins.reshape(-1, 3).astype(np.float64) + settings["position"]
    for world, mjd in enumerate(mjds):
        distances, _, _ = judged(mjm, mjd, starts, np.broadcast_to((0.0, 0.0, -1.0), starts.shape))
        off = np.abs(ranges[world].reshape(-1) - distances) > 1e-4
        assert off.sum() <= 1 and (distances > 0.0).mean() > 0.2


def test_bodies_that_are_left_out_have_no_far_sides(device: wp.Device) -> None:
    mjm, mjds = solid_around("sphere")
    scene = wc.from_mujoco(mjm, mjds, device=device)
    settings: dict[str, Any] = {"far_sides": True, "outputs": ("ids",)}
    for excluded, seen in (((), SHELL), ("shell", -1)):
        lidar = sensors.Lidar(scene, patterns.rays([[(-1.0, 0.0, 0.0)]]), exclude_body=excluded, **settings)
        assert set(host(lidar.read())["ids"].reshape(-1)) == {seen}


def test_without_it_rays_see_out(device: wp.Device) -> None:
    mjm, mjds = solid_around("sphere")
    scene = wc.from_mujoco(mjm, mjds, device=device)
    lidar = sensors.Lidar(scene, patterns.rays([[(1.0, -0.1, 0.0)]]), outputs=("ids",))
    assert set(host(lidar.read())["ids"].reshape(-1)) == {BOX}


def test_ranges_count(device: wp.Device) -> None:
    """A far side nearer than the least range gives no return, nor does one beyond the greatest."""
    mjm, mjds = solid_around("box")
    scene = wc.from_mujoco(mjm, mjds, device=device)
    for low, high, returns in ((0.0, 5.0, True), (3.0, 5.0, False), (0.0, 0.1, False)):
        pattern = patterns.rays([[(-1.0, 0.0, 0.0)]], min_range=low, max_range=high)
        ranges = host(sensors.Lidar(scene, pattern, far_sides=True, outputs=("ranges",)).read())["ranges"]
        assert (np.isfinite(ranges) == returns).all()


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"outputs": ("ranges", "intensities")}, 'outputs with "intensities"'),
        ({"divergence": 0.1, "echo_gap": 0.5, "outputs": ("ranges",)}, "divergence"),
        ({"sweep": "moving", "outputs": ("ranges",)}, 'sweep="moving"'),
    ],
)
def test_what_does_not_go_with_it(device: wp.Device, settings: dict[str, Any], name: str) -> None:
    pattern = patterns.spinning([0.0], columns=8, rate=10.0)
    with pytest.raises(WarpcamError, match=f"Lidar: far_sides and {name} do not go together"):
        sensors.Lidar(floor(1, device), pattern, far_sides=True, **settings)


def test_reads_compile_and_allocate_nothing(
    device: wp.Device, loads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mjm, mjds = solid_around("box")
    lidar = sensors.Lidar(
        wc.from_mujoco(mjm, mjds, device=device), patterns.rays(DIRECTIONS), far_sides=True, outputs=OUTPUTS
    )
    lidar.read()
    loads.clear()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    gc.collect()
    held = ledger.held
    for _ in range(2):
        lidar.read()
    gc.collect()
    assert ledger.held == held and loads == []
