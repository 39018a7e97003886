"""Ranges of all rays of lidars' patterns against ``mujoco.mj_multiRay``, which casts in float64.

pytest -s tests/sensors/test_lidar_mj_ray.py        # prints how many differ
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import warp as wp
from lidar_scenes import BASE, host
from shape_clusters import cluster

import warpcam as wc
from warpcam import sensors
from warpcam.sensors import patterns

PATTERNS = {
    "ouster_os0": patterns.ouster_os0(),
    "ouster_os1": patterns.ouster_os1(),
    "ouster_os2": patterns.ouster_os2(),
    "velodyne_vlp16": patterns.velodyne_vlp16(),
    "velodyne_vlp32c": patterns.velodyne_vlp32c(),
    "velodyne_hdl64e": patterns.velodyne_hdl64e(),
    "hesai_xt32": patterns.hesai_xt32(),
    "hesai_qt128": patterns.hesai_qt128(columns=900),
    "hesai_at128": patterns.hesai_at128(),
    "robosense_bpearl": patterns.robosense_bpearl(),
    "grid": patterns.grid((6.0, 6.0), 0.02),
}
TOLERANCE = 1e-4  # of ranges, relative above 1 m
SHAPES, NEAR, FAR = 160, 1.5, 6.0  # how many stand around the lidar, from where to where [m]
FLOOR = '<geom type="plane" size="0 0 1" pos="0 0 -1.5"/>'
ABOVE = 8.0  # height of a grid, whose rays begin beside each other [m]
ANGLE = 1e-6  # error of the angle between a ray and a surface that poses and directions in float32 have [rad]
SIDES = 8  # rays around one that differs
EDGE = 1e-5  # a ray is at an edge if one this much beside it meets something else [rad]


def cast(mjm: mujoco.MjModel, mjd: mujoco.MjData, starts: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Distance of each ray (n, 3) [m], inf where nothing is hit; one by one, as mj_multiRay loses height fields."""
    base, found = mjm.body("base").id, np.zeros(1, np.int32)
    starts = np.broadcast_to(starts, rays.shape)
    distances = [mujoco.mj_ray(mjm, mjd, *ray, None, 1, base, found) for ray in zip(starts, rays, strict=True)]
    return np.where(np.asarray(distances) >= 0.0, distances, np.inf)


def cast_all(mjm: mujoco.MjModel, mjd: mujoco.MjData, starts: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """The same of rays from one place, all at once."""
    if starts.ndim > 1:
        return cast(mjm, mjd, starts, rays)
    base, ids, distances = mjm.body("base").id, np.zeros(len(rays), np.int32), np.zeros(len(rays))
    flat = rays.reshape(-1)
    mujoco.mj_multiRay(mjm, mjd, starts, flat, None, 1, base, ids, distances, None, len(rays), mujoco.mjMAXVAL)
    return np.where(ids >= 0, distances, np.inf)


def differs(distances: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether ranges differ by more than the tolerance, or one hits and the other does not."""
    with np.errstate(invalid="ignore"):  # the difference of two misses
        close = np.abs(distances - others) <= TOLERANCE * np.maximum(1.0, np.minimum(distances, others))
    return ~close & (distances != others)


def beside(rays: np.ndarray, angle: float) -> np.ndarray:
    """Rays around each ray (n, 3) at that angle [rad], (n, side, 3)."""
    across = np.cross(rays, np.eye(3)[np.abs(rays).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turns = 2.0 * np.pi * np.arange(SIDES) / SIDES
    circle = np.cos(turns)[:, None] * across[:, None] + np.sin(turns)[:, None] * np.cross(rays, across)[:, None]
    return rays[:, None] + angle * circle


def posed(mjm: mujoco.MjModel, grid: bool) -> mujoco.MjData:
    """Shapes all around a tilted lidar, or below a grid; poses as float32 has them."""
    random = np.random.default_rng(0)
    mjd = mujoco.MjData(mjm)
    directions = random.normal(size=(SHAPES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances = FAR * random.uniform((NEAR / FAR) ** 2, 1.0, (SHAPES, 1)) ** 0.5
    mjd.mocap_pos[1:] = directions * distances
    mjd.mocap_quat[1:] = random.normal(size=(SHAPES, 4))
    mjd.mocap_pos[0], mjd.mocap_quat[0] = (0.1, -0.2, 0.05 + ABOVE * grid), (0.9, 0.05, -0.1, 0.4)
    mjd.mocap_quat[0] /= np.linalg.norm(mjd.mocap_quat[0])
    mujoco.mj_forward(mjm, mjd)
    mjd.geom_xpos[:] = mjd.geom_xpos.astype(np.float32)
    mjd.geom_xmat[:] = mjd.geom_xmat.astype(np.float32)
    return mjd


@pytest.mark.parametrize("name", PATTERNS)
def test_ranges_of_patterns(device: wp.Device, name: str) -> None:
    """A ray that differs is at an edge, or so nearly parallel to a surface that float32 has no better."""
    pattern = replace(PATTERNS[name], min_range=0.0, max_range=np.inf)
    mjm = cluster("all", np.random.default_rng(1), SHAPES, BASE + FLOOR)
    mjd = posed(mjm, grid=pattern.origins is not None)
    scene = wc.from_mujoco(mjm, mjd, device=device)
    lidar = sensors.Lidar(scene, pattern, parent="base", exclude_body="base", outputs=("ranges", "normals"))
    scan = host(lidar.read())
    ranges, normals = scan["ranges"].reshape(-1).astype(np.float64), scan["normals"].reshape(-1, 3)
    base = mjd.body("base")
    turn = base.xmat.reshape(3, 3)
    rays = pattern.directions.reshape(-1, 3).astype(np.float64) @ turn.T
    starts = base.xpos if pattern.origins is None else base.xpos + pattern.origins.reshape(-1, 3) @ turn.T
    off = np.flatnonzero(differs(ranges, cast_all(mjm, mjd, starts, rays)))
    distances = cast(mjm, mjd, np.broadcast_to(starts, rays.shape)[off], rays[off])
    alone = differs(ranges[off], distances)
    off, distances = off[alone], distances[alone]
    sines = np.abs(np.sum(normals[off] * rays[off], axis=1))
    with np.errstate(invalid="ignore"):  # where both are infinite, or one is
        grazes = np.abs(ranges[off] / distances - 1.0) * sines < ANGLE
    others = off[~grazes]
    around_them = beside(rays[others], EDGE).reshape(-1, 3)
    places = np.broadcast_to(starts, rays.shape)[others].repeat(SIDES, axis=0)
    met = cast(mjm, mjd, places, around_them).reshape(-1, SIDES)
    at_edge = differs(met.min(axis=1, initial=np.inf), met.max(axis=1, initial=0.0))
    hits = np.isfinite(ranges)
    print(
        f"{name}: {hits.sum()} of {hits.size} rays hit, {len(off)} differ: {grazes.sum()} graze (sine up to "
        f"{sines[grazes].max(initial=0.0):.1e}, from {distances[grazes].min(initial=np.inf):.0f} m on), "
        f"{at_edge.sum()} at edges, {(~at_edge).sum()} wrong"
    )
    assert hits.mean() > 0.2
    assert at_edge.all()
    assert len(off) < 1e-3 * hits.size and len(others) <= 4
