"""Albedo by the trace, points and normals by way of shared memory: the same images as by other ways.

On a CPU there is one way, so that these tests say something on a GPU alone; what images show is tested elsewhere.
"""

from typing import Any

import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import launches, trace
from warpcam.kernels.plan.request import ImageRequest
from warpcam.kernels.runtime.launch import Group
from warpcam.kernels.types import HEIGHT_FIELD, MESH, SPHERE
from warpcam.sources.mujoco import model as mujoco_model

ASSETS = """
  <texture name="checks" type="2d" builtin="checker" width="64" height="64" rgb1=".1 .2 .3" rgb2=".9 .8 .3"/>
  <texture name="odd" type="2d" builtin="gradient" width="24" height="10" rgb1=".9 .2 .3" rgb2=".1 .8 .3"/>
  <texture name="cube" type="cube" builtin="gradient" width="32" height="32" rgb1="1 0 0" rgb2="0 1 .5" mark="edge"/>
  <material name="floor" texture="checks" texrepeat="3 2" rgba=".9 1 .8 1"/>
  <material name="body" texture="cube" rgba="1 .7 1 1"/>
  <material name="box" texture="odd"/>
"""
SHAPES = """
  <geom type="plane" size="{floor}" pos="0 0 -.4" material="{material}"/>
  <geom type="sphere" size=".2" pos="-.7 .3 0" material="body"/>
  <geom type="capsule" size=".1 .3" pos="-.3 .2 0" euler="20 30 0" rgba=".3 .6 .9 1"/>
  <geom type="ellipsoid" size=".25 .1 .3" pos="0 -.3 .1" euler="0 40 0" material="body"/>
  <geom type="cylinder" size=".15 .2" pos=".3 .3 0" euler="60 0 10" rgba="1 .5 0 1"/>
  <geom type="box" size=".2 .1 .25" pos=".7 0 .1" euler="10 20 30" material="box"/>
"""
CARD: Any = type("Card", (), {"is_cuda": True, "sm_count": 132})()


def images(
    floor: str, material: str, size: tuple[int, int], worlds: int, outputs: tuple[str, ...], more: str = ""
) -> dict[str, np.ndarray]:
    mjm = scenes.compile_xml(SHAPES.format(floor=floor, material=material) + more, assets=ASSETS)
    camera = scenes.own_camera(
        width=size[0],
        height=size[1],
        lens=wc.Pinhole(fovy=60.0),
        outputs=outputs,
        position=(0.0, -2.0, 0.6),
        rotation=scenes.looking((0.0, -2.0, 0.6), (0.0, 0.0, 0.0)),
    )
    m, d = scenes.put(mjm, worlds)
    return scenes.on_host(wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera]).render()["eye"])


@pytest.mark.parametrize("region", [(16, 8), (64, 64)])
@pytest.mark.parametrize("size", [(64, 64), (72, 40)])
@pytest.mark.parametrize(("floor", "material"), [("1.2 1.5 1", "floor"), ("0 0 1", "floor"), ("0 0 1", "body")])
def test_albedo_is_as_a_second_pass_makes_it(
    floor: str,
    material: str,
    size: tuple[int, int],
    region: tuple[int, int],
    device: wp.Device,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(trace, "region_size", lambda *_, **__: region)
    found = images(floor, material, size, 3, ("depth", "segmentation", "albedo"))
    monkeypatch.setattr(trace, "traces_albedo", lambda *_, **__: False)
    expected = images(floor, material, size, 3, ("depth", "segmentation", "albedo"))
    assert len(np.unique(expected["segmentation"])) >= 6
    assert len(np.unique(expected["albedo"])) > 50
    np.testing.assert_array_equal(found["segmentation"], expected["segmentation"])
    # The hardware's filter rounds, and places on a floor are found in another order.
    apart = np.abs(found["albedo"].astype(int) - expected["albedo"])
    assert apart.max() <= 3 and (apart > 0).mean() < 0.05


def test_albedo_of_textures_that_lie_from_above(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Textures lie as with a MuJoCo before 3.12."""
    outputs = ("segmentation", "albedo")
    monkeypatch.setattr(mujoco_model, "VERSION", (3, 17))
    usual = images("1.2 1.5 1", "floor", (64, 64), 3, outputs)["albedo"]
    monkeypatch.setattr(mujoco_model, "VERSION", (3, 11))
    found = images("1.2 1.5 1", "floor", (64, 64), 3, outputs)["albedo"]
    monkeypatch.setattr(trace, "traces_albedo", lambda *_, **__: False)
    expected = images("1.2 1.5 1", "floor", (64, 64), 3, outputs)["albedo"]
    apart = np.abs(found.astype(int) - expected)
    assert apart.max() <= 3 and (apart > 0).mean() < 0.05
    assert (np.abs(usual.astype(int) - expected) > 8).mean() > 0.02


@pytest.mark.parametrize("shapes", [0, 40])  # with more of them normals take the other way
@pytest.mark.parametrize("floor", ["1.2 1.5 1", "0 0 1"])  # an endless one is met before all else
@pytest.mark.parametrize(
    "outputs", [("points",), ("normals",), ("distance", "bodies"), ("points", "normals", "albedo")]
)
def test_images_of_whole_regions_are_as_those_of_parts(
    outputs: tuple[str, ...], floor: str, shapes: int, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = "".join(f'<geom size=".02" pos="{-1 + 0.05 * k} .5 .2"/>' for k in range(shapes))
    seen = []
    for region in ((16, 8), (64, 64)):
        monkeypatch.setattr(trace, "region_size", lambda *_, region=region, **__: region)
        seen.append(images(floor, "floor", (64, 64), 40, ("depth", "segmentation", *outputs), more))
    for name, image in seen[0].items():
        assert np.isfinite(image).any() and np.ptp(image[np.isfinite(image)]) > 0
        if name == "albedo":
            assert np.abs(image.astype(int) - seen[1][name]).max() <= 1
        else:
            np.testing.assert_allclose(seen[1][name], image, rtol=1e-5, atol=1e-4 if name == "normals" else 1e-6)


def tables(*types: int, **other: Any) -> Any:
    facts = {"num_drawn": 20, "physical": None, "splats": None, "world_overrides": None, **other}
    return type("Tables", (), {"shape_types": frozenset({SPHERE, *types}), **facts})()


@pytest.mark.parametrize(
    ("scene", "lens", "size", "others", "expected"),
    [
        (tables(), "pinhole", (64, 64), (), True),
        (tables(), "pinhole", (64, 64), ("normals",), True),
        (tables(), "pinhole", (64, 64), ("flow",), False),
        (tables(), "orthographic", (64, 64), (), False),
        (tables(), "pinhole", (60, 64), (), False),  # tiles reach over its edge
        (tables(), "pinhole", (64, 68), (), False),
        (tables(MESH), "pinhole", (64, 64), (), False),
        (tables(HEIGHT_FIELD), "pinhole", (64, 64), (), False),
        (tables(physical=1), "pinhole", (64, 64), (), False),
        (tables(num_drawn=launches.MAX_LISTED + 1), "pinhole", (64, 64), (), False),
    ],
)
def test_the_trace_writes_albedo_where_it_can(
    scene: Any, lens: str, size: tuple[int, int], others: tuple[str, ...], expected: bool
) -> None:
    request, group = ImageRequest(*size, lens, others), Group.of_all(8192)
    assert trace.traces_albedo(scene, request, CARD, group, images=others) == expected
    assert not trace.traces_albedo(scene, request, wp.get_device("cpu"), group, images=others)
