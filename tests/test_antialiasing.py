"""Smooth edges: what they change, and what they must leave alone."""

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp
from warpcam.kernels.antialias import SAMPLES

import warpcam as wc

LIT = '<visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>'
SQUARE = '<geom type="box" size="0.5 0.5 0.01" euler="0 0 {turn}" rgba="1 1 1 1"/>'


def square(turn: float = 20.0) -> mujoco.MjModel:
    """A white square, evenly lit, on black."""
    return scenes.compile_xml(SQUARE.format(turn=turn), more=LIT)


def camera(samples: int, **changes: object) -> wc.Camera:
    settings = {"outputs": ("rgb",), "position": (0.0, 0.0, 2.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    return scenes.own_camera(antialiasing=samples, **{**settings, **changes})


def covered(turn: float, size: int, fine: int = 32) -> np.ndarray:
    """How much of each pixel the square covers, (size, size): by brute force."""
    rays = scenes.pixel_rays(size * fine, size * fine, 60.0)
    x, y = (rays[..., k] * (2.0 - 0.01) for k in (0, 1))
    angle = turn * scenes.DEGREE
    a, b = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    inside = (np.abs(a) < 0.5) & (np.abs(b) < 0.5)
    return inside.reshape(size, fine, size, fine).mean(axis=(1, 3))


@pytest.mark.parametrize("turn", [3.0, 7.0, 20.0, 45.0])
def test_an_edge_shows_how_much_is_covered(device: wp.Device, turn: float) -> None:
    mjm = square(turn)
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    plain, smooth = (scenes.look(scene, camera(samples))["rgb"][0, ..., 0] / 255.0 for samples in (1, 4))
    truth = covered(turn, 32)
    assert set(np.unique(plain)) == {0.0, 1.0}
    assert np.abs(smooth - truth).mean() < 0.5 * np.abs(plain - truth).mean()
    assert np.abs(smooth - truth).max() < 0.4
    quarters = 4.0 * smooth
    assert np.abs(quarters - np.rint(quarters)).max() < 0.02


def test_samples_lie_where_the_views_say(device: wp.Device) -> None:
    """The mean of the samples is the mean of four images whose principal point is moved the other way."""
    mjm = square()
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    smooth = scenes.look(scene, camera(4))["rgb"][0].astype(np.float64)
    renderer = wc.Renderer(scene, [camera(1)])
    width = 2.0 * np.tan(30.0 * scenes.DEGREE) * 1.99 / 32.0  # of a pixel on the square [m]
    total = np.zeros_like(smooth)
    for right, down in SAMPLES[4]:
        renderer.camera("eye").position[0] = torch.tensor((right * width, -down * width, 2.0))
        total += renderer.render()["eye"]["rgb"][0].cpu().numpy()
    assert np.abs(smooth - total / 4.0).max() <= 1.0


def test_all_else_is_of_the_centre(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        "".join(
            scenes.geom_xml(kind, more=f'pos="{0.9 * (k % 3) - 0.9} {0.9 * (k // 3) - 0.9} 0" euler="20 30 40"')
            for k, kind in enumerate(scenes.TYPES)
        ),
        assets=scenes.ASSETS,
    )
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    outputs = ("rgb", "rgba", "hdr", "depth", "segmentation", "normals", "albedo", "points")
    plain, smooth = (
        scenes.look(scene, camera(samples, outputs=outputs, position=(0.0, 0.0, 3.5), shadows=True))
        for samples in (1, 4)
    )
    for name in outputs:
        same = np.array_equal(plain[name], smooth[name])
        assert same == (name not in ("rgb", "rgba", "hdr")), name
    inside = np.ones((32, 32), bool)
    ids = plain["segmentation"][0]
    for axis in (0, 1):
        inside &= (np.roll(ids, 1, axis) == ids) & (np.roll(ids, -1, axis) == ids)
    assert (plain["rgb"][0] == smooth["rgb"][0]).all(-1)[inside].mean() > 0.8
    assert np.array_equal(smooth["rgb"][..., :3], smooth["rgba"][..., :3])
    assert np.abs(smooth["rgb"] / 255.0 - np.clip(smooth["hdr"], 0.0, 1.0)).mean() < 0.01


def test_worlds_keep_their_own_edges(device: wp.Device) -> None:
    """Many worlds are as one by one, also where only some are drawn."""
    mjm = square()
    turned = []
    for turn in (0.0, 10.0, 30.0):
        mjd = scenes.forward(mjm)
        mujoco.mju_euler2Quat(mjm.geom_quat[0], (0.0, 0.0, turn * scenes.DEGREE), "xyz")
        mujoco.mj_forward(mjm, mjd)
        turned.append(mjd)
    alone = [scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera(4))["rgb"][0] for mjd in turned]
    renderer = wc.Renderer(wc.from_mujoco(mjm, turned, device=device), [camera(4)])
    together = renderer.render()["eye"]["rgb"].cpu().numpy().copy()
    assert all(np.array_equal(one, image) for one, image in zip(alone, together, strict=True))
    for mjd in turned:
        mjd.geom_xpos[0] = (0.2, 0.0, 0.0)
    some = renderer.render(worlds=[1])["eye"]["rgb"].cpu().numpy()
    assert np.array_equal(some[0], together[0]) and np.array_equal(some[2], together[2])
    assert not np.array_equal(some[1], together[1])


@pytest.mark.parametrize("samples", [0, 2, 3, 8, True, None, "4"])
def test_other_numbers_are_refused(samples: object) -> None:
    with pytest.raises(wc.WarpcamError, match=r"antialiasing is .*; allowed are 1, 4"):
        camera(samples)  # type: ignore[arg-type]
