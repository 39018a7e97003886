"""Shadows of scenes of many shapes, against the kernel that holds every caster against every tile."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.kernels.plan import launches, shadow

# All around and past each other: some before a light that shines, some behind it, walls beside it.
LIGHTS = """
<light type="directional" pos="0 0 5" dir="0.3 0.2 -1" diffuse="0.3 0.3 0.3" castshadow="true"/>
<light type="spot" pos="0.6 -0.4 1.6" dir="-0.1 0.1 -1" cutoff="70" diffuse="0.4 0.4 0.4" castshadow="true"/>
<light type="spot" pos="0.6 -0.4 3" dir="1 0 0.1" cutoff="180" diffuse="0.4 0.4 0.4" castshadow="true"/>
<light type="spot" pos="-0.5 0.7 0.7" dir="0 0 1" cutoff="180" diffuse="0.4 0.4 0.4" castshadow="true"/>
"""
PLANES = """
<geom type="plane" size="0.6 0.5 1" pos="0.3 0.4 2.2" euler="170 10 0"/>
<geom type="plane" size="9 9 1"/>
"""
KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
SIZES = {
    "sphere": "0.07",
    "capsule": "0.04 0.08",
    "ellipsoid": "0.05 0.1 0.07",
    "cylinder": "0.05 0.09",
    "box": "0.09 0.05 0.06",
}
# Beside the second light and higher than it.
WALLS = "".join(f'<geom type="box" size="0.7 0.05 1" pos="0.5 {y} 1"/>' for y in (-0.75, 0.9))
ABOVE = scenes.looking((0.3, -0.9, 5), (0.3, -0.4, 0))
EYE = {"width": 45, "height": 27, "position": (0.3, -0.9, 5.0), "rotation": ABOVE}


WEDGE = '<mesh name="wedge" scale=".1 .1 .1" vertex="0 0 0  1 0 0  0 1 0  0 0 1  1 1 0"/>'


def crowded(count: int, ends: bool, meshes: bool = False) -> mujoco.MjModel:
    random = np.random.default_rng(3)
    shapes = ""
    for i in range(count):
        (x, y, z), (a, b) = random.uniform((-2, -2, 0.1), (2, 2, 2.4)), random.uniform(-90, 90, 2)
        kind = KINDS[i % len(KINDS)]
        what = 'type="mesh" mesh="wedge"' if meshes and i % 3 == 0 else f'type="{kind}" size="{SIZES[kind]}"'
        shapes += f'<geom {what} pos="{x} {y} {z}" euler="{a} {b} 0"/>'
    world = LIGHTS + shapes + PLANES + WALLS + scenes.geom_xml("hfield")
    mjm = scenes.compile_xml(world, assets=scenes.ASSETS + (WEDGE if meshes else ""))
    mjm.vis.map.shadowclip = 0.4 if ends else 0.0
    return mjm


def lit(mjm: mujoco.MjModel, lens: wc.Pinhole | wc.Orthographic) -> np.ndarray:
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 2))
    return scenes.look(scene, scenes.own_camera(outputs=("hdr",), shadows=True, lens=lens, **EYE))["hdr"]


@pytest.mark.parametrize(
    ("lens", "ends", "room"),
    [
        (wc.Pinhole(fovy=50.0), True, 512),
        (wc.Pinhole(fovy=50.0), False, 512),
        (wc.Pinhole(fovy=50.0), False, launches.THREADS),  # in several passes
        (wc.Orthographic(height=4.0), True, 512),
    ],
)
def test_shadows_are_those_of_every_caster(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch, lens: wc.Pinhole | wc.Orthographic, ends: bool, room: int
) -> None:
    mjm = crowded(400, ends)
    monkeypatch.setattr(shadow, "MANY_CASTERS_CAPACITIES", (room,))
    images = lit(mjm, lens)
    monkeypatch.setattr(shadow, "MOST", 0)
    wanted = lit(mjm, lens)
    monkeypatch.undo()
    mjm.light_castshadow[:] = False
    assert (wanted != lit(mjm, lens)).any(axis=-1).mean() > 0.2
    assert (images != wanted).any(axis=-1).sum() <= 2  # pixels on an edge


@pytest.mark.parametrize(("lens", "ends"), [(wc.Pinhole(fovy=50.0), True), (wc.Orthographic(height=4.0), False)])
def test_shadows_of_meshes_among_many_are_those_of_every_caster(
    device: wp.Device, monkeypatch: pytest.MonkeyPatch, lens: wc.Pinhole | wc.Orthographic, ends: bool
) -> None:
    mjm = crowded(400, ends, meshes=True)
    images = lit(mjm, lens)
    monkeypatch.setattr(shadow, "MOST", 0)
    monkeypatch.setattr(shadow, "CAPACITIES", (launches.THREADS,))  # lists that have all casters, in several passes
    wanted = lit(mjm, lens)
    monkeypatch.undo()
    mjm.light_castshadow[mjm.light_type != mujoco.mjtLightType.mjLIGHT_DIRECTIONAL] = False
    assert (wanted != lit(mjm, lens)).any(axis=-1).mean() > 0.1
    assert (images != wanted).any(axis=-1).sum() <= 2  # pixels on an edge


def test_each_pixel_may_show_a_shape_of_its_own(device: wp.Device) -> None:
    """And none shows nothing."""
    width, height = 16, 8
    pixel = 2.0 * np.tan(np.radians(25.0)) / height  # at a distance of 1
    colors = np.stack((np.arange(width * height) * 2, 255 - np.arange(width * height)), axis=-1)
    wall = "".join(
        f'<geom type="box" size="{pixel / 2} {pixel / 2} .01" rgba="{red / 255} {green / 255} .2 1" '
        f'pos="{(i % width - width / 2 + 0.5) * pixel} {(height / 2 - 0.5 - i // width) * pixel} -1.01"/>'
        for i, (red, green) in enumerate(colors)
    )
    plain = '<visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>'
    mjm = scenes.compile_xml(wall, more=plain)
    camera = scenes.own_camera(width=width, height=height, outputs=("rgb",), lens=wc.Pinhole(fovy=50.0))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["rgb"][0]
    assert np.abs(seen[..., :2].reshape(-1, 2).astype(int) - colors).max() <= 1


@pytest.mark.parametrize("others", [0, 150])
def test_of_shapes_at_one_place_the_later_is_seen(device: wp.Device, others: int) -> None:
    """The later of coincident shapes is seen, as if they were drawn one over the other."""
    away = "".join(f'<geom size=".2" pos="{k % 15 / 5 - 1.4} {k // 15 / 5 - 0.9} -2"/>' for k in range(others))
    same = '<geom type="box" size=".5 .5 .1"/>'
    mjm = scenes.compile_xml(same + away + 2 * same)
    camera = scenes.own_camera(width=32, height=16, position=(0.0, 0.0, 2.0), rotation=(1.0, 0.0, 0.0, 0.0))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["segmentation"][0]
    assert (seen == others + 2).sum() > 40
    assert not np.isin(seen, (0, others + 1)).any()
