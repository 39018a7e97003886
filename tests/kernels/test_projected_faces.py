"""Faces of moving meshes that are projected into the image: the same hits as where rays walk through trees."""

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import trace

newton = pytest.importorskip("newton", reason="needs Newton: pip install warpcam[newton]")
newton_scenes = pytest.importorskip("newton_scenes")

OUTPUTS = ("depth", "segmentation", "faces", "normals", "rgb")
POSES = {
    "from above": ((0.1, -1.0, 2.4), (0.0, 0.0, 1.2)),
    "along the cloth": ((-0.9, 0.1, 1.22), (1.0, 0.0, 1.2)),
    "between its faces": ((0.05, 0.02, 1.201), (1.0, 0.3, 1.18)),
    "from far away": ((6.0, -9.0, 5.0), (0.0, 0.0, 1.0)),
}


def images(pose: str, size: tuple[int, int], cells: int, device: wp.Device) -> dict[str, np.ndarray]:
    builder = newton.ModelBuilder()
    builder.replicate(newton_scenes.cloth(cells), 3)
    model, state = newton_scenes.finalize(builder, device)
    points = state.particle_q.numpy()
    points += np.random.default_rng(3).normal(size=points.shape) * 0.01
    state.particle_q.assign(points.astype(np.float32))
    position, target = POSES[pose]
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        outputs=OUTPUTS,
        lens=wc.Pinhole(fovy=60.0),
        position=position,
        rotation=scenes.looking(position, target),
    )
    return scenes.on_host(wc.Renderer(wc.from_newton(model, state), [camera]).render()["eye"])


@pytest.mark.parametrize(("size", "cells"), [((64, 64), 12), ((53, 37), 24), ((160, 96), 12), ((16, 16), 12)])
@pytest.mark.parametrize("pose", POSES)
def test_hits_are_those_of_rays_that_walk(
    pose: str, size: tuple[int, int], cells: int, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU rays walk")
    found = images(pose, size, cells, device)
    monkeypatch.setattr(trace, "_projects_faces", lambda *_: False)
    expected = images(pose, size, cells, device)
    assert (expected["segmentation"] == -3).any()
    for name in ("depth", "segmentation"):
        np.testing.assert_array_equal(found[name], expected[name])
    # at common edges two faces are hit at the same depth
    for name in ("faces", "normals", "rgb"):
        assert (found[name] != expected[name]).mean() <= 0.005
