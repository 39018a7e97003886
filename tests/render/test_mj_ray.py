"""Ids and depths against ``mujoco.mj_ray``, which casts in float64: 100,000 rays of each type of shape."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp
from shape_clusters import cluster

import warpcam as wc
from warpcam.kernels.plan import launches

WORLDS, SIZE, FOVY = 40, 50, 40.0  # 100,000 rays
TOLERANCE = 5e-5  # of depth, relative above 1 m
EDGE = 1e-5  # a ray is at an edge if one this much beside it meets something else


def posed(mjm: mujoco.MjModel, random: np.random.Generator, reach: float = 0.7) -> mujoco.MjData:
    """Shapes anywhere within a cube, their poses as float32 has them."""
    mjd = mujoco.MjData(mjm)
    mjd.mocap_pos[:] = random.uniform(-reach, reach, (mjm.nmocap, 3))
    mjd.mocap_quat[:] = random.normal(size=(mjm.nmocap, 4))
    mujoco.mj_forward(mjm, mjd)
    mjd.geom_xpos[:] = mjd.geom_xpos.astype(np.float32)
    mjd.geom_xmat[:] = mjd.geom_xmat.astype(np.float32)
    return mjd


def judge(
    mjm: mujoco.MjModel, mjd: mujoco.MjData, position: np.ndarray, rays: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Geom id and ray parameter, (ray,), of rays (ray, 3) in the world frame; -1 and inf where nothing is hit."""
    # One by one: mj_multiRay first culls bodies, and loses height fields by it.
    length = np.linalg.norm(rays, axis=1)
    directions, groups = rays / length[:, None], np.ones(6, np.uint8)
    ids, distance, found = np.zeros(len(rays), np.int32), np.zeros(len(rays)), np.zeros(1, np.int32)
    for ray, direction in enumerate(directions):
        distance[ray] = mujoco.mj_ray(mjm, mjd, position, direction, groups, True, -1, found)
        ids[ray] = found[0]
    return ids, np.where(ids >= 0, distance / length, np.inf)


def wrong_pixels(
    mjm: mujoco.MjModel,
    mjd: mujoco.MjData,
    position: np.ndarray,
    rotation: np.ndarray,
    ids: np.ndarray,
    depth: np.ndarray,
) -> tuple[int, int, int]:
    """Count the pixels that are wrong, that differ at edges, and that are ties; of an image (pixel,)."""
    local = scenes.pixel_rays(SIZE, SIZE, FOVY).reshape(-1, 3)
    rays = local @ rotation.T
    true_ids, true_depth = judge(mjm, mjd, position, rays)
    tolerance = TOLERANCE * np.maximum(1.0, np.where(true_ids >= 0, true_depth, 1.0))
    both = (ids >= 0) & (true_ids >= 0)
    far_off = np.zeros(len(ids), bool)
    far_off[both] = np.abs(depth[both] - true_depth[both]) > tolerance[both]
    tie = both & (ids != true_ids) & ~far_off
    doubtful = np.flatnonzero(((ids != true_ids) & ~tie) | far_off)
    at_edge = np.zeros(len(doubtful), bool)
    for offset in EDGE * np.array(((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))):
        other_ids, other_depth = judge(mjm, mjd, position, (local[doubtful] + offset) @ rotation.T)
        at_edge |= other_ids != true_ids[doubtful]
        same = (other_ids >= 0) & (true_ids[doubtful] >= 0)
        at_edge[same] |= np.abs(other_depth[same] - true_depth[doubtful][same]) > tolerance[doubtful][same]
    return int((~at_edge).sum()), int(at_edge.sum()), int(tie.sum())


@pytest.mark.parametrize("kind", [*scenes.TYPES, "all"])
def test_ids_and_depths(device: wp.Device, kind: str) -> None:
    random = np.random.default_rng(len(kind))
    mjm = cluster(kind, random)
    check(device, kind, mjm, [posed(mjm, random) for _ in range(WORLDS)], (2.5, 5.0), random)


@pytest.mark.parametrize("listed", [launches.MAX_LISTED, launches.MANY_LISTED])
@pytest.mark.parametrize("distances", [(9.0, 12.0), (2.0, 4.0)], ids=["all in sight", "among them"])
def test_more_shapes_than_one_pass_draws(
    device: wp.Device, listed: int, distances: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launches, "MANY_LISTED", listed)  # of a CPU, which else draws as many in one
    random = np.random.default_rng(0)
    mjm = cluster("all", random, 2 * launches.MAX_LISTED)
    check(device, "crowd", mjm, [posed(mjm, random, 3.0) for _ in range(4)], distances, random)


def check(
    device: wp.Device,
    kind: str,
    mjm: mujoco.MjModel,
    mjds: list[mujoco.MjData],
    distances: tuple[float, float],
    random: np.random.Generator,
) -> None:
    worlds = len(mjds)
    directions = random.normal(size=(worlds, 3))
    positions = random.uniform(*distances, (worlds, 1)) * directions / np.linalg.norm(directions, axis=1)[:, None]
    rotations = np.stack([scenes.looking(position, random.uniform(-0.3, 0.3, 3)) for position in positions])
    positions, rotations = positions.astype(np.float32), rotations.astype(np.float32)
    scene = wc.from_mujoco(mjm, mjds, device=device)
    camera = scenes.own_camera(
        width=SIZE, height=SIZE, lens=wc.Pinhole(fovy=FOVY), position=positions, rotation=rotations
    )
    seen = scenes.look(scene, camera)
    counts = np.array(
        [
            wrong_pixels(
                mjm,
                mjds[world],
                positions[world].astype(np.float64),
                scenes.matrix(rotations[world]),
                seen["segmentation"][world].reshape(-1),
                seen["depth"][world].reshape(-1).astype(np.float64),
            )
            for world in range(worlds)
        ]
    )
    wrong, edges, ties = counts.sum(axis=0)
    hits = int((seen["segmentation"] >= 0).sum())
    print(f"{kind}: {hits} of {seen['depth'].size} rays hit; {wrong} wrong, {edges} at edges, {ties} ties")
    assert hits > 0.05 * seen["depth"].size
    assert wrong == 0
    assert edges + ties <= 50
