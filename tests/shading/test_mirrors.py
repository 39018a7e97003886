"""Reflections: as ``mujoco.Renderer`` draws them, in every world."""

import color_reference
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

ASSETS = """
  <texture name="squares" type="2d" builtin="checker" width="64" height="64" rgb1=".8 .2 .2" rgb2=".2 .8 .3"/>
  <material name="mirror" rgba=".4 .5 .6 1" reflectance=".5"/>
  <material name="tiles" texture="squares" texrepeat="4 4" reflectance=".3"/>
  <material name="plain" rgba=".4 .5 .6 1"/>
  <material name="bright" rgba=".9 .3 .2 1" emission=".5"/>
"""
THINGS = """
  <camera pos="2.2 -1.5 1.3" xyaxes="0.56 0.83 0 -.4 .27 .88"/>
  <geom type="sphere" size=".3" pos="0 0 .5" material="bright"/>
  <geom type="box" size=".2 .2 .2" pos=".8 .3 .25" rgba=".2 .7 .3 1"/>
  <geom type="capsule" size=".1 .3" pos="-.7 .2 .5" euler="30 40 0"/>
  <geom type="cylinder" size=".2 .3" pos="-.3 -.8 .35" rgba=".8 .8 .1 1"/>
  <geom type="ellipsoid" size=".2 .3 .1" pos=".4 -.7 .3"/>
"""
LIGHT = '<light pos="1 -1 3" dir="-.3 .3 -1" castshadow="false"/>'
SHADE = '<light pos="1 -1 3" dir="-.3 .3 -1" castshadow="true"/>'
FLOOR = '<geom type="plane" size="2 2 .1" material="{}" {}/>'
SCENES = {
    "plane": FLOOR.format("mirror", "") + LIGHT,
    "in shadow": FLOOR.format("mirror", "") + SHADE,
    "textured": FLOOR.format("tiles", "") + LIGHT,
    "endless": '<geom type="plane" size="0 0 .1" material="mirror"/>'
    '<light pos="1 -1 3" dir="-.3 .3 -1" directional="true" castshadow="false"/>',
    "tilted": FLOOR.format("mirror", 'zaxis=".2 .1 1"') + LIGHT,
    "sunk": FLOOR.format("mirror", 'pos="0 0 .3"') + LIGHT,
    "top of a box": '<geom type="box" size="1.2 1.2 .2" pos="0 0 -.2" material="mirror"/>'
    '<geom type="plane" size="5 5 .1" pos="0 0 -.6"/>' + LIGHT,
    "the first of two": FLOOR.format("mirror", "")
    + '<geom type="plane" size="1 1 .1" pos="-1.5 0 1" zaxis="1 0 0" material="mirror"/>'
    + LIGHT,
    "the second, the first being seen from behind": '<geom type="plane" size="1 1 .1" pos="9 0 0" zaxis="1 0 0" '
    'material="mirror"/>' + FLOOR.format("mirror", "") + LIGHT,
    "the second, the first having no reflectance": FLOOR.format("plain", 'pos="0 0 -1"')
    + FLOOR.format("mirror", "")
    + LIGHT,
    "a mesh": FLOOR.format("mirror", "") + '<geom type="mesh" mesh="mesh" pos="0 .8 .4" euler="20 30 0"/>' + LIGHT,
    "a height field": FLOOR.format("mirror", "") + '<geom type="hfield" hfield="hfield" pos="-.5 .5 .7"/>' + LIGHT,
}


@pytest.mark.parametrize("name", SCENES)
def test_as_mujoco_draws_it(device: wp.Device, name: str) -> None:
    mjm = scenes.compile_xml(THINGS + SCENES[name], assets=ASSETS + scenes.ASSETS)
    color_reference.check(mjm, device)


def test_a_box_seen_from_below_reflects_nothing(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        THINGS + '<geom type="box" size="1.2 1.2 .2" pos="0 0 2" material="mirror"/>' + LIGHT, assets=ASSETS
    )
    color_reference.check(mjm, device, differs=False)


def test_a_floor_seen_from_below_is_seen_through_in_a_mirror_above_it(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        '<geom type="box" size="1 1 .1" pos="0 0 1.2" euler="120 0 0" material="mirror"/>'
        '<geom type="plane" size="3 3 .5" rgba=".5 .9 .2 1"/><geom size=".2" pos="0 .3 .5" rgba="1 .2 .2 1"/>'
        '<camera pos="0 -3 -.5" xyaxes="1 0 0 0 -.4 1" fovy="50"/>' + LIGHT,
        assets=ASSETS,
    )
    color_reference.check(mjm, device, transparency=True)


def test_own_colour_and_what_is_mirrored_add_up(device: wp.Device) -> None:
    mjm = scenes.compile_xml(
        '<geom type="plane" size="2 2 .1" rgba=".2 .3 .1 1" material="mirror"/>'
        '<geom type="box" size=".5 .5 .1" pos="0 1 1" material="glow"/>'
        '<camera pos="0 -1 1" xyaxes="1 0 0 0 1 1"/>',
        assets='<material name="mirror" reflectance=".5" emission="1"/>'
        '<material name="glow" rgba=".8 .4 .2 1" emission="1" specular="0"/>',
        more='<visual><headlight active="0"/></visual>',
    )
    eye = wc.Camera(0, width=65, height=65, outputs=("rgb", "rgba", "hdr"))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), eye)
    own, shown = 1.3 * np.array((0.2, 0.3, 0.1)), 1.3 * 0.5 * np.array((0.8, 0.4, 0.2))
    np.testing.assert_allclose(seen["hdr"][0, 32, 32], own + shown, atol=1e-5)
    np.testing.assert_allclose(seen["hdr"][0, 32, 2], own, atol=1e-5)
    for name in ("rgb", "rgba"):
        np.testing.assert_allclose(seen[name][0, 32, 32, :3], 255 * (own + shown), atol=1.01)


def scene_of_three(device: wp.Device, **options: object) -> tuple[object, object, wc.Renderer]:
    mjm = scenes.compile_xml(THINGS + SCENES["plane"], assets=ASSETS)
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, 3, batch={"geom_matid": 3, "geom_rgba": 3})
        eye = wc.Camera(0, width=40, height=32, outputs=("rgb", "depth"), shadows=True)
        return m, d, wc.Renderer(wc.from_mujoco_warp(mjm, m, d, **options), [eye])


def frame(renderer: wc.Renderer, **options: object) -> np.ndarray:
    renderer.render(**options)
    return renderer.array(0, "rgb").numpy().copy()


def test_worlds_have_mirrors_of_their_own(device: wp.Device) -> None:
    m, d, renderer = scene_of_three(device)
    before = frame(renderer)
    plane = m.ngeom - 1
    scenes.write(m.geom_matid, (1, plane), 2)
    positions = d.geom_xpos.numpy()
    positions[2, plane, 2] = -0.5
    d.geom_xpos.assign(positions)
    after = frame(renderer)
    assert (before[0] == before[1]).all() and (before[0] == before[2]).all()
    assert (after[0] == before[0]).all()
    assert (after[1] != before[1]).any() and (after[2] != before[2]).any() and (after[1] != after[2]).any()
    only = frame(renderer, worlds=[1])
    assert (only == after).all()


def test_a_material_given_later_reflects_where_the_scene_was_told_so(device: wp.Device) -> None:
    images = {}
    for wanted in (True, None, False):
        m, _, renderer = scene_of_three(device, reflections=wanted)
        plane = m.ngeom - 1
        images[wanted] = frame(renderer)
        scenes.write(m.geom_matid, (0, plane), 2)
        without = frame(renderer)
        scenes.write(m.geom_matid, (0, plane), 0)
        assert (frame(renderer) == images[wanted]).all()
        assert (without[0] != images[wanted][0]).any() == (wanted is not False)
    assert (images[True] == images[None]).all()
    assert (images[True] != images[False]).any()


def test_outputs_that_are_not_colours_are_as_without(device: wp.Device) -> None:
    outputs = ("rgb", "depth", "segmentation", "normals", "albedo", "points")
    mjm = scenes.compile_xml(THINGS + SCENES["plane"], assets=ASSETS)
    eye = wc.Camera(0, width=41, height=33, outputs=outputs)
    seen = {
        on: scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device, reflections=on), eye)
        for on in (True, False)
    }
    for name in outputs[1:]:
        np.testing.assert_array_equal(seen[True][name], seen[False][name])
    assert (seen[True]["rgb"] != seen[False]["rgb"]).any()


def test_a_scene_of_many_shapes(device: wp.Device) -> None:
    """More than one pass of the trace lists."""
    crowd = "".join(f'<geom size=".03" pos="{k % 20 * 0.1 - 1} {k // 20 * 0.1 - 1} 5"/>' for k in range(260))
    few, many = (scenes.compile_xml(THINGS + SCENES["plane"] + more, assets=ASSETS) for more in ("", crowd))
    few.stat.extent = many.stat.extent = 3.0
    images = [color_reference.ours(mjm, scenes.forward(mjm), device) for mjm in (few, many)]
    off = np.abs(images[0].astype(int) - images[1]).max(axis=-1)
    assert (off > 2).mean() < 0.08  # the crowd's own shadows and mirror images
    assert (off[:60] <= 2).mean() > 0.9
