"""Tiles that show nothing but an endless floor: the same images as where each pixel is looked at by itself."""

import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import trace

SHAPES = """
  <body name="ball"><freejoint/><geom type="sphere" size=".2" pos="-.5 .3 .2"/></body>
  <geom type="box" size=".1 .1 .25" pos=".6 .2 .1" euler="10 20 30"/>
  <geom type="plane" size="{floor}"/>
  <geom type="capsule" size=".1 .2" pos="0 0 .3" euler="20 30 0"/>
"""
FLOORS = {
    "level": '0 0 1" pos="0 0 -.1',
    "tilted": '0 0 1" pos="0 0 -.1" euler="8 -5 0',
    "two": '0 0 1" pos="0 0 -.1"/><geom type="plane" size="0 0 1" pos="0 0 -.3" euler="3 0 0',
    "with an end": '2 1 1" pos="0 0 -.1',
}
EYES = [(0.0, -2.0, 0.9), (0.1, -1.95, 0.95), (0.1, -1.95, 0.95), (0.3, -1.9, 0.8)]


def frames(floor: str, size: tuple[int, int], outputs: tuple[str, ...]) -> list[dict[str, np.ndarray]]:
    """Return the frames of a camera that moves, rests and moves again, over worlds in which a ball does."""
    mjm = scenes.compile_xml(SHAPES.format(floor=FLOORS[floor]))
    m, d = scenes.put(mjm, 5)
    camera = scenes.own_camera(
        width=size[0], height=size[1], lens=wc.Pinhole(fovy=60.0), outputs=outputs, position=EYES[0]
    )
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
    poses = d.geom_xpos.numpy()
    place = renderer.camera("eye")
    seen = []
    for step, eye in enumerate(EYES):
        poses[:, 0, 0] += np.linspace(0.0, 0.1, 5) * (step != 2)
        d.geom_xpos.assign(poses)
        place.position[:] = torch.tensor(eye)
        place.rotation[:] = torch.tensor(scenes.looking(eye, (0.0, 0.3, 0.0)))
        seen.append(scenes.on_host(renderer.render()["eye"]))
    return seen


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("size", [(64, 64), (72, 64), (128, 64), (80, 120), (15, 17), (37, 64)])
@pytest.mark.parametrize(
    "more",
    [
        (),
        ("bodies",),
        ("distance",),
        ("instances", "semantics"),
        ("flow",),
        ("flow_valid",),
        ("flow", "flow_valid"),
    ],
)
def test_rows_of_floors_are_as_pixels_of_them(
    more: tuple[str, ...], size: tuple[int, int], floor: str, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU there is one way")
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (64, 64))
    found = frames(floor, size, ("depth", "segmentation", *more))
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (16, 8))
    expected = frames(floor, size, ("depth", "segmentation", *more))
    assert np.unique(expected[0]["segmentation"]).tolist() == [-1, 0, 1, 2, 3] + [4] * (floor == "two")
    for mine, theirs in zip(found, expected, strict=True):
        for name, image in theirs.items():
            if name == "flow":
                np.testing.assert_allclose(mine[name], image, atol=1e-4, rtol=1e-5)
            elif name == "flow_valid":
                assert (mine[name] != image).mean() < 0.005
            else:
                np.testing.assert_array_equal(mine[name], image)
    if "flow" in more:
        assert not expected[2]["flow"][0].any()
        assert all(np.abs(expected[step]["flow"]).max() > size[1] / 100 for step in (1, 3))
