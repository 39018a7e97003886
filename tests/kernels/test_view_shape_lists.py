"""Shapes listed by the stage that writes views: the same images as where each block of the trace lists them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import trace
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.scene_tables import SceneTables

SHAPES = """
  <geom type="sphere" size=".2" pos="-.7 .3 0" rgba="1 1 1 0"/>
  <geom type="plane" size="{floor}" pos="0 0 -.4" euler="4 -3 0"/>
  <geom type="capsule" size=".1 .3" pos="-.3 .2 0" euler="20 30 0"/>
  <geom type="ellipsoid" size=".25 .1 .3" pos="0 -.3 .1" euler="0 40 0" rgba="1 1 1 .5"/>
  <body><freejoint/><geom type="cylinder" size=".15 .2" pos=".3 .3 0" euler="60 0 10"/></body>
  <body><freejoint/><geom type="box" size=".2 .1 .25" pos=".7 0 .1" euler="10 20 30"/></body>
  <geom type="sphere" size=".2" pos="0 9 0"/>
"""
OUTPUTS = ("depth", "segmentation", "distance", "points", "bodies")
FLOWING = ("depth", "segmentation", "flow", "flow_valid")
FACING = ("depth", "segmentation", "normals")

WORLDS, BROKEN, CHOSEN = 23, 20, [0, 4, 21]  # a block of the stage has 22 worlds of so many shapes


def frames(
    floor: str,
    lens: wc.Pinhole | wc.Orthographic,
    outputs: tuple[str, ...],
    opens: bool,
    size: tuple[int, int] = (64, 64),
) -> list[dict[str, np.ndarray]]:
    """Return the worlds' frames: all, some, one that is broken, and all again; ``opens``: the camera is the first."""
    mjm = scenes.compile_xml(SHAPES.format(floor=floor))
    m, d = scenes.put(mjm, WORLDS)
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        lens=lens,
        outputs=outputs,
        position=(0.0, -2.0, 0.6),
        rotation=scenes.looking((0.0, -2.0, 0.6), (0.0, 0.0, 0.0)),
    )
    other = wc.Camera(
        "other", width=32, height=16, outputs=("rgb",), position=(0.0, 0.0, 3.0), lens=wc.Pinhole(fovy=60.0)
    )
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera, other] if opens else [other, camera])
    seen = []
    poses = d.geom_xpos.numpy()
    for step, worlds in enumerate((None, None, CHOSEN, None, None)):
        poses[:, 4:6, 0] += 0.02
        poses[BROKEN, 5, 1] = np.nan if step == 3 else 0.0
        d.geom_xpos.assign(poses)
        seen.append(scenes.on_host(renderer.render(worlds)["eye"]))
        seen[-1]["faulty"] = renderer.faulty.cpu().numpy().copy()
        seen[-1]["frames"] = renderer.frames.cpu().numpy().copy()
    return seen


@pytest.mark.parametrize("floor", ["1.2 1.5 1", "0 0 1"])  # an endless one is met before all else
@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=60.0), wc.Orthographic(height=2.5)], ids=("pinhole", "orthographic"))
@pytest.mark.parametrize(
    ("outputs", "opens"),
    [
        (OUTPUTS, True),
        (("depth", "segmentation"), True),
        (("depth", "segmentation", "bodies"), False),
        (("depth", "segmentation", "points"), True),
        (("depth", "distance", "instances", "semantics"), True),
        (("rgb", "depth"), True),
        (("hdr", "segmentation"), False),
        (FLOWING, True),
        (FLOWING, False),
        (("flow", "depth"), True),
        (FACING, True),
        (("depth", "normals", "points"), False),
        ((*FLOWING, "normals"), True),
        (("flow", "normals"), True),
        (("flow", "points", "segmentation"), False),
    ],
)
def test_listed_ahead_or_by_the_blocks(
    outputs: tuple[str, ...],
    opens: bool,
    lens: wc.Pinhole | wc.Orthographic,
    floor: str,
    device: wp.Device,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU there is one way")
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (64, 64))
    found = frames(floor, lens, outputs, opens)
    monkeypatch.setattr(trace, "capacity_of", lambda *_: 0)
    expected = frames(floor, lens, outputs, opens)
    assert np.flatnonzero(expected[3]["faulty"]).tolist() == [BROKEN]
    assert expected[4]["frames"].tolist() == [4 + (world in CHOSEN) for world in range(WORLDS)]
    assert "depth" not in outputs or len(np.unique(expected[0]["depth"])) > 100
    for mine, theirs in zip(found, expected, strict=True):
        for name, image in theirs.items():
            if name == "flow":
                np.testing.assert_allclose(mine[name], image, atol=1e-4, rtol=1e-5)
            elif name in ("normals", "points"):
                np.testing.assert_allclose(mine[name], image, atol=1e-6, rtol=1e-6)
            elif name == "flow_valid":
                assert (mine[name] != image).reshape(WORLDS, -1).sum(axis=1).max() <= 24  # of 4096 pixels
            else:
                np.testing.assert_array_equal(mine[name], image)
    assert "flow" not in outputs or all(np.abs(frame["flow"]).max() > 0.1 for frame in expected[1:])


@pytest.mark.parametrize("size", [(16, 8), (32, 16), (32, 32)])  # fewer rows of tiles than blocks that share an image
@pytest.mark.parametrize("outputs", [("depth", "normals", "points"), ("depth", "flow"), ("depth",)])
def test_small_images_of_listed_shapes(
    outputs: tuple[str, ...], size: tuple[int, int], device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU there is one way")
    lens = wc.Pinhole(fovy=60.0)
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: size)
    found = frames("0 0 1", lens, outputs, True, size)
    monkeypatch.setattr(trace, "capacity_of", lambda *_: 0)
    for mine, theirs in zip(found, frames("0 0 1", lens, outputs, True, size), strict=True):
        for name in outputs:
            np.testing.assert_allclose(mine[name], theirs[name], atol=1e-4, rtol=1e-5)


# Blocks have 1, 2 or 4 rows of stacks of tiles; the last has fewer. The third has tiles that reach over its edges.
@pytest.mark.parametrize("size", [(128, 72), (80, 120), (100, 52), (512, 24)])
@pytest.mark.parametrize("outputs", [("depth", "segmentation", "distance"), ("depth", "flow"), ("normals", "points")])
def test_large_images_of_listed_shapes(
    outputs: tuple[str, ...], size: tuple[int, int], device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU there is one way")
    lens = wc.Pinhole(fovy=60.0)
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: (64, 64))
    found = frames("0 0 1", lens, outputs, True, size)
    monkeypatch.setattr(trace, "capacity_of", lambda *_: 0)
    for mine, theirs in zip(found, frames("0 0 1", lens, outputs, True, size), strict=True):
        for name in outputs:
            if name in ("depth", "segmentation", "distance"):
                np.testing.assert_array_equal(mine[name], theirs[name])
            else:
                np.testing.assert_allclose(mine[name], theirs[name], atol=1e-4, rtol=1e-5)


def test_which_images_are_listed_ahead() -> None:
    device = SimpleNamespace(is_cuda=True, sm_count=2)
    tables = wc.from_mujoco_warp(*_put(scenes.compile_xml(SHAPES.format(floor="0 0 1")))).tables()
    many = replace(tables, num_worlds=500)

    def listed(width: int, height: int, *outputs: str, of: SceneTables = many) -> int:
        return trace.capacity_of(of, ImageRequest(width, height, "pinhole", ("depth", *outputs)), device)

    assert [listed(64, 64), listed(128, 72), listed(640, 480, "flow", "normals"), listed(1008, 504)] == [16] * 4
    assert not any(
        listed(*size) for size in ((100, 72), (72, 64), (128, 76), (1024, 64), (64, 512), (15, 17), (37, 64))
    )
    assert listed(128, 72, "flow_valid") == 0  # only of images that a block draws as a whole
    assert listed(64, 64, "flow_valid") == 16
    assert listed(128, 72, of=tables) == 0  # too few regions of 64x64 pixels to fill the device


def test_rows_of_a_list() -> None:
    for outputs, rows in ((("depth", "flow"), (98, 178)), (("normals",), (118, 214))):
        assert tuple(trace.rows_of(capacity, outputs) for capacity in (16, 32)) == rows
    assert trace.rows_of(0, ("depth",)) == 0


# How many blocks share an image: of 64x64 pixels, of fewer, and of more.
@pytest.mark.parametrize(
    ("outputs", "parts"),
    [
        ((), (1, 1, 3, 16, 60)),
        (("bodies",), (2, 1, 3, 16, 60)),
        (("flow",), (2, 1, 5, 32, 60)),
        (("points",), (4, 1, 9, 32, 60)),
        (("points", "normals"), (8, 1, 9, 32, 60)),
        (("flow_valid",), (1, 1)),
    ],
)
def test_blocks_that_share_an_image(outputs: tuple[str, ...], parts: tuple[int, ...]) -> None:
    sizes = [(64, 64), (16, 8), (128, 72), (256, 256), (640, 480)]
    assert tuple(trace.parts_of(outputs, *size) for size in sizes[: len(parts)]) == parts


def test_what_is_listed_ahead(device: wp.Device) -> None:
    tables = wc.from_mujoco_warp(*_put(scenes.compile_xml(SHAPES.format(floor="0 0 1")))).tables()
    listed = trace.capacity_of(tables, ImageRequest(16, 8, "pinhole", ("depth", "flow")), device)
    assert listed == (16 if device.is_cuda else 0)
    assert trace.capacity_of(tables, ImageRequest(16, 8, "pinhole", ("depth", "normals")), device) == listed
    assert trace.capacity_of(tables, ImageRequest(16, 8, "pinhole", ("depth", "albedo")), device) == 0
    assert trace.capacity_of(tables, ImageRequest(16, 8, "rays", ("depth",)), device) == 0
    assert trace.capacity_of(tables, ImageRequest(640, 480, "pinhole", ("depth",)), device) == 0
    for count, most in ((20, 32), (30, 0)):
        more = "".join(f'<geom size=".1" pos="{i} 0 0"/>' for i in range(count))
        tables = wc.from_mujoco_warp(*_put(scenes.compile_xml(SHAPES.format(floor="0 0 1") + more))).tables()
        found = trace.capacity_of(tables, ImageRequest(16, 8, "pinhole", ("rgb", "flow")), device)
        assert found == (most if device.is_cuda else 0)


def test_nothing_is_listed_ahead_where_a_hidden_mesh_moves() -> None:
    device = SimpleNamespace(is_cuda=True, sm_count=132)
    tables = wc.from_mujoco_warp(*_put(scenes.compile_xml(SHAPES.format(floor="0 0 1")))).tables()
    for outputs in (("depth",), ("flow", "flow_valid")):
        assert trace.capacity_of(tables, ImageRequest(16, 8, "pinhole", outputs), device) == 16
        assert trace.capacity_of(replace(tables, moving=(0,)), ImageRequest(16, 8, "pinhole", outputs), device) == 0


def _put(mjm: object) -> tuple[object, object, object]:
    return (mjm, *scenes.put(mjm, 2))
