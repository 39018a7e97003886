"""Traces of many shapes, which choose from those in view: the images are those of traces that look at all shapes.

Only CUDA has such traces.
"""

from typing import Any

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import shadow, trace

WORLDS = 3
LIGHTS = '<light pos="0 0 5" dir="0 0 -1"/><light directional="true" dir=".3 .5 -1"/>'


@pytest.fixture
def card(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("on a CPU blocks look at all shapes")


def crowd(count: int, meshes: bool) -> mujoco.MjModel:
    """A walled ground with so many shapes, most of them hidden, some seen through, and some twice in one place."""
    rng = np.random.default_rng(7)
    kinds = ("sphere", "capsule", "ellipsoid", "cylinder", "box") + ("mesh",) * meshes
    world = '<geom type="plane" size="0 0 1"/><geom type="box" size="4 .1 1" pos="0 3 1"/>' + LIGHTS
    for number in range(count):
        place, turn = rng.uniform((-5, -1, 0), (5, 9, 2)), rng.uniform(-1, 1, 4)
        kind = kinds[number % len(kinds)]
        size = 'mesh="mesh"' if kind == "mesh" else f'size="{" ".join(map(str, rng.uniform(0.05, 0.3, 3)))}"'
        color = "0 0 0 0" if number % 17 == 0 else f"{rng.uniform()} {rng.uniform()} {rng.uniform()} 1"
        geom = f'<geom type="{kind}" {size} quat="{turn[0]} {turn[1]} {turn[2]} {turn[3]}" rgba="{color}" pos="'
        world += f'<body pos="{place[0]} {place[1]} {place[2]}">{geom}0 0 0"/></body>'
        if number % 11 == 0:
            world += geom + f'{place[0]} {place[1]} {place[2]}"/>'
    return scenes.compile_xml(world, assets=scenes.ASSETS)


def drawn(mjm: mujoco.MjModel, **options: Any) -> dict[str, np.ndarray]:
    m, d = scenes.put(mjm, WORLDS)
    for world in range(1, WORLDS):
        moved = d.geom_xpos.numpy()
        moved[world] += np.random.default_rng(world).uniform(-0.3, 0.3, moved[world].shape).astype(np.float32)
        d.geom_xpos.assign(moved)
    position = (0.0, -1.5, 1.2)
    camera = scenes.own_camera(
        **{"width": 136, "height": 72, "lens": wc.Pinhole(fovy=70.0), **options},
        position=position,
        rotation=scenes.looking(position, (0.0, 3.0, 0.4)),
    )
    return scenes.look(wc.from_mujoco_warp(mjm, m, d), camera)


@pytest.mark.usefixtures("card")
@pytest.mark.parametrize("lens", [wc.Pinhole(fovy=70.0), wc.Orthographic(height=3.0)])
@pytest.mark.parametrize("meshes", [False, True])
def test_images_are_those_of_all_shapes(
    meshes: bool, lens: Any, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mjm = crowd(200, meshes)
    monkeypatch.setattr(trace, "IN_VIEW_PIXELS", 0)
    asked = {"lens": lens, "outputs": ("depth", "segmentation", "points")}
    found = drawn(mjm, **asked)
    monkeypatch.setattr(trace, "IN_VIEW_FROM", 2**20)
    expected = drawn(mjm, **asked)
    assert len(np.unique(expected["segmentation"])) > 40
    assert (found["segmentation"] == expected["segmentation"]).all()
    assert (found["depth"] == expected["depth"]).all()
    assert (found["points"] == expected["points"]).all()


@pytest.mark.usefixtures("card")
def test_more_shapes_than_are_sorted_together(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    mjm = crowd(700, False)
    monkeypatch.setattr(trace, "IN_VIEW_PIXELS", 0)
    monkeypatch.setattr(trace, "SORTED", (512,))
    found = drawn(mjm)
    monkeypatch.setattr(trace, "IN_VIEW_FROM", 2**20)
    expected = drawn(mjm)
    for name, image in expected.items():
        assert (found[name] == image).all(), name


def test_a_world_with_a_pose_that_is_not_finite_is_told(device: wp.Device) -> None:
    mjm = crowd(150, True)
    m, d = scenes.put(mjm, WORLDS)
    scenes.write(d.geom_xpos, (1, 60), (np.nan, 0.0, 0.0))
    camera = scenes.own_camera(position=(0.0, -1.5, 1.2), rotation=(0.7, 0.7, 0.0, 0.0))
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
    images = scenes.on_host(renderer.render()["eye"])
    assert (images["segmentation"][1] == -1).all()
    assert (images["segmentation"][::2] >= 0).any()
    assert renderer.faulty.cpu().numpy().tolist() == [0, 1, 0]


@pytest.mark.usefixtures("card")
def test_shadows_among_many_casters_are_those_of_a_cpu(device: wp.Device) -> None:
    """There regions look for casters by their spheres first."""
    mjm = crowd(shadow.CAPACITIES[-1] + 60, True)
    lit = {"outputs": ("rgb",), "shadows": True}
    found = drawn(mjm, **lit)["rgb"].astype(int)
    with wp.ScopedDevice("cpu"):
        expected = drawn(mjm, **lit)["rgb"].astype(int)
        dark = drawn(mjm, **{**lit, "shadows": False})["rgb"].astype(int)
    assert (np.abs(dark - expected).max(axis=-1) > 8).mean() > 0.05
    assert (np.abs(found - expected).max(axis=-1) > 8).mean() < 1e-3
