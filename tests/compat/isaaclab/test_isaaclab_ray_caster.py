"""Ray casters in Isaac Lab's words, beside MuJoCo's rays from where Isaac Lab sends them."""

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
from warpcam.compat.isaaclab import RayCaster

TURN = np.array((0.9, 0.15, -0.2, 0.4))
OFFSET, OFFSET_TURN = (0.1, -0.2, 0.4), np.array((0.2, 0.1, -0.3, 0.9))  # x y z w


def grid(cfg: Any, device: str) -> tuple[torch.Tensor, torch.Tensor]:
    y, x = torch.meshgrid(torch.linspace(-0.5, 0.5, 11), torch.linspace(-0.8, 0.8, 17), indexing="ij")
    starts = torch.stack((x.flatten(), y.flatten(), torch.zeros(187)), -1)
    return starts, torch.tensor(cfg.direction).expand(187, 3)


def turning(cfg: Any, device: str) -> tuple[torch.Tensor, torch.Tensor]:
    up, about = torch.meshgrid(torch.linspace(-0.5, 0.5, 8), torch.arange(60) * (torch.pi / 30), indexing="ij")
    rays = torch.stack((up.cos() * about.cos(), up.cos() * about.sin(), up.sin()), -1).reshape(-1, 3)
    return torch.zeros_like(rays), rays


GRID = SimpleNamespace(func=grid, direction=(0.0, 0.0, -1.0))
LIDAR = SimpleNamespace(func=turning)


def config(**more: Any) -> SimpleNamespace:
    offset = SimpleNamespace(pos=OFFSET, rot=tuple(OFFSET_TURN))
    return SimpleNamespace(**{"prim_path": "/World/envs/env_.*/base", "pattern_cfg": LIDAR, "offset": offset} | more)


def scene_of(device: wp.Device) -> tuple[wc.Scene, mujoco.MjModel, list[mujoco.MjData]]:
    mjm = around(tuple(kind for kind in scenes.TYPES if kind != "hfield"))
    mjds = [posed(mjm, (2.1, 0.1, 1.7)), posed(mjm, (2.2, -0.2, 1.8), TURN)]
    return wc.from_mujoco(mjm, mjds, device=device), mjm, mjds


def yawed(frame: np.ndarray) -> np.ndarray:
    angle = np.arctan2(frame[1, 0], frame[0, 0])
    return np.array(((np.cos(angle), -np.sin(angle), 0), (np.sin(angle), np.cos(angle), 0), (0, 0, 1)))


def expected(
    mjm: mujoco.MjModel, mjd: mujoco.MjData, caster: RayCaster, cfg: Any, world: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays end and their distances, by ``mj_ray``; inf where nothing is hit."""
    starts, rays = (table.numpy().astype(np.float64) for table in cfg.pattern_cfg.func(cfg.pattern_cfg, "cpu"))
    body = mjd.body("base")
    frame = body.xmat.reshape(3, 3)
    aligned = {"base": frame, "yaw": yawed(frame), "world": np.eye(3)}[cfg.ray_alignment]
    x, y, z, w = OFFSET_TURN
    rays = rays @ scenes.matrix((w, x, y, z)).T if cfg.offset.rot != (0.0, 0.0, 0.0, 1.0) else rays
    drift, ray_drift = caster.drift[world].cpu().numpy(), caster.ray_cast_drift[world].cpu().numpy()
    begin = body.xpos + drift + (aligned @ ray_drift) * (1, 1, 0) + (starts + cfg.offset.pos) @ aligned.T
    rays = rays if cfg.ray_alignment == "yaw" else rays @ aligned.T
    found = np.zeros(1, np.int32)
    distances = np.array([
        mujoco.mj_ray(mjm, mjd, start, ray, None, True, body.id, found)
        for start, ray in zip(begin, rays, strict=True)
    ])  # fmt: skip
    distances[(distances < 0.0) | (distances > cfg.max_distance)] = np.inf
    with np.errstate(invalid="ignore"):
        ends = np.where(np.isinf(distances)[:, None], np.inf, begin + distances[:, None] * rays)
    return ends + np.array((0.0, 0.0, ray_drift[2])), distances


@pytest.mark.parametrize(
    ("alignment", "pattern", "drifts"),
    [("base", LIDAR, False), ("world", LIDAR, True), ("base", GRID, True), ("yaw", GRID, True)],
)
def test_hits_are_those_of_mj_ray(device: wp.Device, alignment: str, pattern: Any, drifts: bool) -> None:
    scene, mjm, mjds = scene_of(device)
    cfg = config(ray_alignment=alignment, pattern_cfg=pattern, max_distance=4.0)
    if drifts:
        cfg.drift_range, cfg.ray_cast_drift_range = (-0.1, 0.1), {"x": (0.1, 0.2), "z": (-0.3, -0.2)}
    if pattern is GRID:
        cfg.offset.rot = (0.0, 0.0, 0.0, 1.0)
    torch.manual_seed(0)
    caster = RayCaster(cfg, scene, exclude_bodies=("base",))
    assert bool(caster.drift.any()) is drifts
    data = caster.data
    for world, mjd in enumerate(mjds):
        ends, distances = expected(mjm, mjd, caster, cfg, world)
        assert np.isfinite(distances).any() and (pattern is GRID or np.isinf(distances).any())
        mine = data.ray_distances[world].cpu().numpy()
        with np.errstate(invalid="ignore"):
            off = ~(np.isclose(mine, distances, atol=1e-4, rtol=0.0))
        assert off.sum() <= 3  # where a ray grazes an edge
        np.testing.assert_allclose(data.ray_hits_w[world].cpu().numpy()[~off], ends[~off], atol=2e-4)
        normals = data.ray_normals_w[world].cpu().numpy()
        assert np.isinf(normals[np.isinf(mine)]).all()
        np.testing.assert_allclose(np.linalg.norm(normals[np.isfinite(mine)], axis=-1), 1.0, atol=1e-3)
        place = mjd.body("base").xpos + caster.drift[world].cpu().numpy()
        np.testing.assert_allclose(data.pos_w[world].cpu().numpy(), place, atol=1e-6)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_order_of_quaternions(device: wp.Device, order: str) -> None:
    """Of Isaac Lab 3 and 2, for what is given and for what is reported."""
    scene, _, _ = scene_of(device)
    cfg = config()
    reference = RayCaster(cfg, scene, exclude_bodies=("base",)).data.ray_distances.clone()
    if order == "wxyz":
        cfg.offset.rot = tuple(np.roll(OFFSET_TURN, 1))
    data = RayCaster(cfg, scene, exclude_bodies=("base",), quaternions=order).data
    assert torch.equal(data.ray_distances, reference)
    turn = data.quat_w[1].cpu().numpy() * np.sign(data.quat_w[1, 3 if order == "xyzw" else 0].item())
    unit = TURN / np.linalg.norm(TURN)
    np.testing.assert_allclose(turn, np.roll(unit, -1) if order == "xyzw" else unit, atol=1e-6)


def test_drifts_are_drawn_anew_for_some_worlds(device: wp.Device) -> None:
    scene, _, _ = scene_of(device)
    caster = RayCaster(config(drift_range=(0.1, 0.2), ray_cast_drift_range={"y": (1.0, 2.0)}), scene)
    before, rays = caster.drift.clone(), caster.ray_cast_drift.clone()
    assert ((before >= 0.1) & (before <= 0.2)).all()
    assert not rays[:, (0, 2)].any() and ((rays[:, 1] >= 1.0) & (rays[:, 1] <= 2.0)).all()
    caster.reset([1])
    assert torch.equal(caster.drift[0], before[0]) and not torch.equal(caster.drift[1], before[1])
    caster.reset(env_mask=torch.tensor([True, False]))
    assert not torch.equal(caster.drift[0], before[0]) and not torch.equal(caster.ray_cast_drift[0], rays[0])


def test_updates_write_the_same_tensors(device: wp.Device) -> None:
    scene, mjm, mjds = scene_of(device)
    caster = RayCaster(config(), scene)
    data = caster.data
    before, places = data.ray_distances.clone(), data.pos_w.clone()
    mjds[0].mocap_pos[0] += 0.2
    mujoco.mj_forward(mjm, mjds[0])
    assert torch.equal(caster.data.ray_distances, before)
    caster.update(0.01)
    assert not torch.equal(data.ray_distances[0], before[0]) and not torch.equal(data.pos_w[0], places[0])
    assert torch.equal(data.ray_distances[1], before[1])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"prim_path": "/World/nobody"}, "RayCaster: prim_path"),
        ({"update_period": 0.1}, "RayCaster: update_period is 0.1; allowed is 0.0"),
        ({"global_world_only": True}, "RayCaster: global_world_only is True; allowed is False"),
        ({"debug_vis": True}, "RayCaster: debug_vis is True; allowed is False"),
        ({"ray_alignment": "roll"}, "RayCaster: ray_alignment is 'roll'; allowed are 'base', 'yaw', 'world'"),
        ({"ray_alignment": "yaw"}, "RayCaster: ray_alignment='yaw' turns the starts of rays and not their directions"),
        ({"max_distance": -1.0}, r"RayCaster: max_distance must be a positive number \[m\], got -1.0"),
        ({"pattern_cfg": SimpleNamespace(focal_length=24.0)}, "RayCaster: pattern_cfg is a pinhole camera's"),
        ({"pattern_cfg": SimpleNamespace()}, "RayCaster: pattern_cfg has no func"),
        ({"offset": SimpleNamespace(pos=(1.0, 2.0))}, r"RayCaster: offset.pos must be 3 numbers, got \(1.0, 2.0\)"),
        ({"offset": SimpleNamespace(rot=(0, 0, 0, 0))}, "RayCaster: offset.rot must not be of length 0"),
    ],
)
def test_fields_that_cannot_be_used(device: wp.Device, change: dict[str, Any], text: str) -> None:
    with pytest.raises(wc.WarpcamError, match=text):
        RayCaster(config(**change), scene_of(device)[0])


def test_what_is_missing_or_unread_is_told(device: wp.Device) -> None:
    scene, _, _ = scene_of(device)
    with pytest.raises(wc.WarpcamError, match="RayCaster: cfg has no pattern_cfg"):
        RayCaster(SimpleNamespace(prim_path="base"), scene)
    with pytest.raises(wc.WarpcamError, match="RayCaster: quaternions is 'wzyx'; allowed are 'xyzw' and 'wxyz'"):
        RayCaster(config(), scene, quaternions="wzyx")  # type: ignore[arg-type]
    with pytest.warns(UserWarning, match="RayCaster: mesh_prim_paths is not read"):
        RayCaster(config(mesh_prim_paths=["/World/ground"]), scene)


def test_configurations_of_isaac_lab(device: wp.Device) -> None:
    """Its own patterns, of its installed version."""
    patterns = pytest.importorskip("isaaclab.sensors.ray_caster.patterns", reason="pip install isaaclab lazy_loader")
    scene, mjm, mjds = scene_of(device)
    ranges = {"vertical_fov_range": (-15.0, 15.0), "horizontal_fov_range": (-180.0, 180.0)}
    for pattern, rays in (
        (patterns.GridPatternCfg(resolution=0.1, size=(1.6, 1.0)), 187),
        (patterns.BpearlPatternCfg(horizontal_res=20.0), 32 * 18),
        (patterns.LidarPatternCfg(channels=8, horizontal_res=4.0, **ranges), 8 * 90),
    ):
        cfg = config(pattern_cfg=pattern, ray_alignment="base", max_distance=50.0)
        cfg.offset.pos = (0.0, 0.0, 0.4)
        caster = RayCaster(cfg, scene, exclude_bodies=("base",))
        assert caster.num_rays == rays
        for world, mjd in enumerate(mjds):
            _, distances = expected(mjm, mjd, caster, cfg, world)
            mine = caster.data.ray_distances[world].cpu().numpy()
            assert (~np.isclose(mine, distances, atol=1e-4, rtol=0.0)).sum() <= 3  # where a ray grazes an edge


def test_bodies_of_newton_are_followed(device: wp.Device) -> None:
    """At the state of now, whose bodies move in stages of the frame."""
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
    cfg = SimpleNamespace(prim_path="{ENV_REGEX_NS}/base", pattern_cfg=GRID, ray_alignment="yaw")
    caster = RayCaster(cfg, wc.from_newton(model, state), exclude_bodies=("base",))
    for height in (1.0, 2.0, 3.0):
        poses = state.body_q.numpy()
        poses[:, 2] = (height, height + 0.5)
        state.body_q.assign(poses)
        caster.update()
        data = caster.data
        np.testing.assert_allclose(data.ray_distances[:, 93].cpu(), (height, height + 0.5), rtol=1e-6)
        np.testing.assert_allclose(data.pos_w[:, 2].cpu(), (height, height + 0.5), rtol=1e-6)
        np.testing.assert_allclose(data.ray_hits_w[..., 2].cpu(), 0.0, atol=1e-6)
