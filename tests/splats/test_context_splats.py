"""Splats of MuJoCo-Warp's contexts, against MuJoCo-Warp's own images."""

import inspect
from typing import Any

import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc
from warpcam.compat import mujoco_warp as ours

WORLD = """
<light pos="0 -3 3" dir="0 1 -1"/>
<camera name="eye" pos="0 -4 0" xyaxes="1 0 0 0 0 1" fovy="40" resolution="49 37"/>
<geom type="box" size="1 0.1 0.6" pos="0 0.6 -0.6"/><geom type="sphere" size="0.3" pos="-0.5 -0.2 0.3"/>
"""
THEIRS = "splat_position" in inspect.signature(mjw.create_render_context).parameters
IMAGES = {"render_rgb": True, "render_depth": True, "render_seg": True}


def gaussians(count: int, seed: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    return {
        "splat_position": random.uniform(-1.0, 1.0, (count, 3)).astype(np.float32),
        "splat_rotation": random.normal(size=(count, 4)).astype(np.float32),
        "splat_scale": (0.15 * np.exp(random.uniform(-1.5, 0.5, (count, 3)))).astype(np.float32),
        "splat_rgba": random.uniform((0.0, 0.0, 0.0, 0.02), 1.0, (count, 4)).astype(np.float32),
    }


def seen_by(system: Any, device: wp.Device, num_worlds: int, **options: Any) -> dict[str, np.ndarray]:
    mjm = scenes.compile_xml(WORLD)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, scenes.forward(mjm), nworld=num_worlds)
        rc = system.create_render_context(mjm, nworld=num_worlds, **IMAGES, **options)
        system.refit_bvh(m, d, rc)
        system.render(m, d, rc)
    size = (num_worlds, 37, 49)
    rgb = rc.rgb_data.numpy().view(np.uint8).reshape(*size, 4)
    return {
        "rgb": rgb[..., 2::-1].astype(int),
        "depth": rc.depth_data.numpy().reshape(size),
        "seg": rc.seg_data.numpy().reshape(*size, 2),
    }


@pytest.mark.skipif(not THEIRS, reason="this MuJoCo-Warp has no splats: 4.0 has")
@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0, 1.0), (0.2, 0.4, 0.6, 1.0)])
def test_as_mujoco_warp_draws_them(device: wp.Device, background: tuple[float, ...]) -> None:
    """Two groups, one of them so dense that it is opaque in places; their rotations are of length 1."""
    options = gaussians(400, seed=1)
    options["splat_rotation"] /= np.linalg.norm(options["splat_rotation"], axis=1, keepdims=True)
    options |= {"splat_adr": np.array((0, 20, 400)), "splat_group_id": np.array((1, 0))}
    mine, theirs = (seen_by(system, device, 2, background_color=background, **options) for system in (ours, mjw))
    plain = [seen_by(system, device, 1, background_color=background) for system in (ours, mjw)]
    # where the scene looks alike, all but shading
    alike = (np.abs(plain[0]["rgb"] - plain[1]["rgb"]).max(-1) <= 2) & (plain[0]["seg"] == plain[1]["seg"]).all(-1)
    assert alike.mean() > 0.6
    off = np.abs(mine["rgb"] - theirs["rgb"]).max(-1)[np.broadcast_to(alike, (2, 37, 49))]
    assert np.mean(off <= 3) > 0.995
    assert (mine["seg"] == theirs["seg"]).all(-1).mean() > 0.99
    moved = np.abs(theirs["depth"] - plain[1]["depth"]) > 0.05  # by opaque splats
    assert moved[0].sum() > 20
    close = np.abs(mine["depth"] - theirs["depth"]) < 1e-3 * theirs["depth"].clip(1.0)
    assert close.mean() > 0.98
    assert close[moved].mean() > 0.9


@pytest.mark.parametrize(("rgba", "count"), [((1.0, 0.5, 0.25, 0.9), 1), ((1.0, 0.5, 0.25, 0.9), 4)])
def test_by_definition(device: wp.Device, rgba: tuple[float, ...], count: int) -> None:
    """One after another along the ray in the middle: 0.1 to the power of their number comes through."""
    options = {
        "splat_position": np.stack([(0.0, -2.0 + 0.1 * k, 0.0) for k in range(count)]),
        "splat_rotation": np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
        "splat_scale": np.full((count, 3), 0.2),
        "splat_rgba": np.tile(rgba, (count, 1)),
    }
    seen, plain = (seen_by(ours, device, 1, **more) for more in (options, {}))
    through, color = [(1.0 - rgba[3]) ** k for k in range(1, count + 1)], np.zeros(3)
    used = min(count, 3)  # the third leaves 0.001, and the ray ends
    color = (1.0 - through[used - 1]) * np.array(rgba[:3])
    behind = through[used - 1] * plain["rgb"][0, 18, 24] / 255.0
    assert seen["rgb"][0, 18, 24] / 255.0 == pytest.approx(color + behind, abs=1.5 / 255.0)
    opaque = [k for k in range(count) if through[k] < 0.005]
    depth = 2.0 + 0.1 * opaque[0] if opaque else plain["depth"][0, 18, 24]
    assert seen["depth"][0, 18, 24] == pytest.approx(depth, rel=1e-4)
    assert (seen["seg"] == plain["seg"]).all()


def test_no_gaussians(device: wp.Device) -> None:
    seen, plain = (seen_by(ours, device, 1, **options) for options in (gaussians(0, seed=0), {}))
    assert all((seen[name] == plain[name]).all() for name in plain)


def test_refit(device: wp.Device) -> None:
    """Gaussians that are written anew, some of them seen for the first time, are drawn as new ones are."""
    before, after = gaussians(300, seed=1), gaussians(300, seed=2)
    before["splat_rgba"][:50, 3], before["splat_scale"][50:60] = 0.0, 0.0
    after["splat_rgba"][100:130, 3] = 0.0
    groups = {"splat_adr": np.array((0, 90, 90, 300)), "splat_group_id": np.array((2, 0, 1))}
    mjm = scenes.compile_xml(WORLD)
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.put_data(mjm, scenes.forward(mjm), nworld=3)
        rc = ours.create_render_context(mjm, nworld=3, **IMAGES, **before, **groups)
        ours.render(m, d, rc)
        first = rc.rgb_data.numpy().copy()
        for name, values in after.items():
            getattr(rc, name).assign(values)
        ours.render(m, d, rc)
        assert (rc.rgb_data.numpy() == first).all()
        ours.refit_splat_bvh(rc)
        ours.render(m, d, rc)
        new = ours.create_render_context(mjm, nworld=3, **IMAGES, **after, **groups)
        ours.render(m, d, new)
    mine, theirs = (context.rgb_data.numpy().view(np.uint8).astype(int) for context in (rc, new))
    assert (mine != first.view(np.uint8)).mean() > 0.1
    assert np.abs(mine - theirs).max() <= 1
    assert rc.depth_data.numpy() == pytest.approx(new.depth_data.numpy(), rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"splat_rgba": None}, "splat_position, splat_rotation, splat_scale came without splat_rgba"),
        ({"splat_scale": np.ones((3, 2))}, r"splat_scale must have shape \(3, 3\), got \(3, 2\)"),
        ({"splat_rotation": "none"}, "splat_rotation must be an array of numbers, got 'none'"),
        ({"splat_scale": torch.ones((3, 2), requires_grad=True)}, r"splat_scale must have shape \(3, 3\), got"),
        ({"splat_scale": np.full((3, 2), 1e300)}, r"splat_scale must have shape \(3, 3\), got"),
        ({"splat_adr": [0, 2]}, "splat_adr must ascend from 0 to 3, the number of Gaussians"),
        ({"splat_adr": [0, 3, 2, 3]}, "splat_adr must ascend from 0 to 3"),
        ({"splat_group_id": [1]}, "splat_group_id must have a group from 0 to 0 for each of 1 worlds, got"),
        ({"splat_group_id": [0.5]}, "splat_group_id must be an array of whole numbers"),
    ],
)
def test_bad_splats(options: dict[str, Any], message: str) -> None:
    with pytest.raises(wc.WarpcamError, match=message):
        ours.create_render_context(scenes.compile_xml(WORLD), **{**gaussians(3, seed=0), **options})
