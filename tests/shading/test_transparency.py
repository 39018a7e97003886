"""Transparent shapes, and planes seen from behind: as ``mujoco.Renderer`` draws them, in every world."""

import color_reference
import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

ASSETS = """
  <texture name="squares" type="2d" builtin="checker" width="64" height="64" rgb1=".8 .2 .2" rgb2=".2 .8 .3"/>
  <material name="mirror" rgba=".4 .5 .6 1" reflectance=".5"/>
  <material name="glass" rgba=".2 .9 .3 .3" specular=".2"/>
  <material name="pane" texture="squares" texrepeat="4 4" rgba="1 1 1 .6"/>
"""
VIEW = """
  <camera pos="2.2 -1.5 1.3" xyaxes="0.56 0.83 0 -.4 .27 .88"/>
  <geom type="cylinder" size=".2 .3" pos="-.3 -.8 .35" rgba=".8 .8 .1 1"/>
"""
FLOOR = '<geom type="plane" size="2 2 .1"/>'
LIGHT = '<light pos="1 -1 3" dir="-.3 .3 -1" castshadow="false"/>'
SHADE = '<light pos="1 -1 3" dir="-.3 .3 -1" castshadow="true"/>'
BALL = '<geom size=".3" pos="0 0 .5" rgba=".9 .2 .1 .4"/>'
THINGS = (
    BALL
    + """
  <geom type="box" size=".2 .2 .2" pos=".8 .3 .25" material="glass"/>
  <geom type="capsule" size=".1 .3" pos="-.7 .2 .5" euler="30 40 0" rgba="0 0 1 .5"/>
  <geom type="ellipsoid" size=".2 .3 .1" pos=".4 -.7 .3" rgba=".5 .5 .5 .99"/>
  <geom type="box" size=".5 .02 .4" pos=".7 -.6 .5" material="pane"/>
"""
)
MESH = '<geom type="mesh" mesh="mesh" pos="0 .7 .8" euler="20 30 0" rgba=".1 .8 .8 .5"/>'
FIELD = '<geom type="hfield" hfield="hfield" pos="-.5 .5 .7" rgba=".7 .5 .2 .5"/>'
SCENES = {
    "one": FLOOR + BALL + LIGHT,
    "several": FLOOR + THINGS + LIGHT,
    "they cast shadows and receive none": FLOOR + THINGS + SHADE,
    "a mesh": FLOOR + THINGS + MESH + LIGHT,
    "a height field": FLOOR + BALL + FIELD + LIGHT,
    "a plane": '<geom type="plane" size="2 2 .1" rgba=".3 .4 .8 .5"/>' + THINGS + LIGHT,
    "a mirror behind": '<geom type="plane" size="2 2 .1" material="mirror"/>' + THINGS + LIGHT,
    "a transparent plane is no mirror": '<geom type="plane" size="2 2 .1" rgba=".4 .5 .6 .5" material="mirror"/>'
    + THINGS
    + LIGHT,
    "planes from behind": '<geom type="plane" size="3 3 .1" pos="0 0 1.5" rgba=".2 .3 .9 1"/>'
    '<geom type="plane" size="2 2 .1" pos="-2 0 0" zaxis="-1 0 .3" material="pane"/>' + THINGS + LIGHT,
    "nothing behind": THINGS + LIGHT,
}


@pytest.mark.parametrize("name", SCENES)
def test_as_mujoco_draws_it(device: wp.Device, name: str) -> None:
    mjm = scenes.compile_xml(VIEW + SCENES[name], assets=ASSETS + scenes.ASSETS)
    color_reference.check(mjm, device)


def test_a_plane_alone_is_seen_from_behind_where_the_scene_was_told_so(device: wp.Device) -> None:
    below = '<geom type="plane" size="0 0 .1" pos="0 0 1.6" rgba=".9 .8 .7 1"/>'
    level = VIEW.replace("-.4 .27 .88", "0 0 1")
    mjm = scenes.compile_xml(level + below + '<light dir="0 0 -1" directional="true" castshadow="false"/>')
    assert color_reference.check(mjm, device, differs=False, transparency=True)[:20].max() > 10
    assert color_reference.ours(mjm, scenes.forward(mjm), device)[:20].max() == 0


def pane_over(opacity: float, device: wp.Device, **options: object) -> dict[str, np.ndarray]:
    """A pane of 0.8, 0.4, 0.2 that covers the left half of an image of 0.1, 0.5, 0.7; nothing else gives light."""
    mjm = scenes.compile_xml(
        '<geom type="box" size="9 4 .1" pos="0 4.2 -3" rgba=".1 .5 .7 1" material="glow"/>'
        f'<geom type="box" size="1 1 .1" pos="-1 0 -1" rgba=".8 .4 .2 {opacity}" material="glow"/><camera fovy="60"/>',
        assets='<material name="glow" emission="1" specular="0"/>',
        more='<visual><headlight active="0"/></visual>',
    )
    eye = wc.Camera(
        0, width=32, height=32, outputs=("hdr", "rgb", "rgba", "depth", "segmentation", "normals", "albedo")
    )
    return scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device, **options), eye)


@pytest.mark.parametrize("opacity", [0.05, 0.4, 0.9])
def test_one_pane_is_drawn_twice(device: wp.Device, opacity: float) -> None:
    seen = pane_over(opacity, device)
    pane, behind = 1.3 * np.array((0.8, 0.4, 0.2)), 1.3 * np.array((0.1, 0.5, 0.7))
    through = (1.0 - opacity) ** 2
    np.testing.assert_allclose(seen["hdr"][0, 8, 4], (1.0 - through) * pane + through * behind, atol=1e-5)
    np.testing.assert_allclose(seen["hdr"][0, 8, 28], behind, atol=1e-5)
    expected = 255 * ((1.0 - through) * np.minimum(pane, 1.0) + through * behind)
    for name in ("rgb", "rgba"):
        np.testing.assert_allclose(seen[name][0, 8, 4, :3], expected, atol=1.01)
    assert seen["rgba"][0, 8, 4, 3] == 255
    assert abs(int(seen["rgba"][0, 28, 4, 3]) - round(255 * (1.0 - through))) <= 1  # nothing solid behind
    assert seen["rgba"][0, 28, 28, 3] == 0


def test_all_but_colours_are_those_of_solid_shapes(device: wp.Device) -> None:
    seen, solid = pane_over(0.4, device), pane_over(0.4, device, transparency=False)
    for name in ("depth", "segmentation", "normals", "albedo"):
        np.testing.assert_array_equal(seen[name], solid[name])
    assert (seen["rgb"] != solid["rgb"]).any()
    opaque = pane_over(1.0, device)
    for name in ("rgb", "hdr", "rgba"):
        np.testing.assert_array_equal(solid[name], opaque[name])


def scene_of_three(device: wp.Device, **options: object) -> tuple[object, wc.Renderer]:
    mjm = scenes.compile_xml(VIEW + SCENES["several"], assets=ASSETS)
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, 3, batch={"geom_rgba": 3})
        eye = wc.Camera(0, width=40, height=32, outputs=("rgb", "depth"), shadows=True)
        return m, wc.Renderer(wc.from_mujoco_warp(mjm, m, d, **options), [eye])


def frame(renderer: wc.Renderer) -> np.ndarray:
    renderer.render()
    return renderer.array(0, "rgb").numpy().copy()


def test_worlds_are_seen_through_each_in_its_own_way(device: wp.Device) -> None:
    m, renderer = scene_of_three(device)
    before = frame(renderer)
    ball = 2  # the third geom
    scenes.write(m.geom_rgba, (1, ball), (0.9, 0.2, 0.1, 1.0))
    scenes.write(m.geom_rgba, (2, ball), (0.9, 0.2, 0.1, 0.0))
    after = frame(renderer)
    assert (before[0] == before[1]).all() and (before[0] == before[2]).all() and (after[0] == before[0]).all()
    assert (after[1] != before[1]).any() and (after[2] != before[2]).any() and (after[1] != after[2]).any()


def test_what_becomes_transparent_later(device: wp.Device) -> None:
    """The shape is seen through if the scene was told so, and solid otherwise: it never vanishes."""
    images = {}
    for wanted in (True, None):
        m, renderer = scene_of_three(device, transparency=wanted)
        solid = frame(renderer)
        scenes.write(m.geom_rgba, (0, 0), (0.8, 0.8, 0.1, 0.5))
        images[wanted] = frame(renderer)
        assert (images[wanted][0] != solid[0]).any() == (wanted is True)
        assert (images[wanted][1] == solid[1]).all()
    _, renderer = scene_of_three(device, transparency=False)
    assert (frame(renderer)[1] != images[None][1]).any()


def test_worlds_that_share_colours_otherwise_than_materials(device: wp.Device) -> None:
    """The last of six worlds alone has the colour that lets a material count, and the transparent material."""
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><material name="glass" rgba=".2 .9 .3 .3"/></asset>'
        '<worldbody><geom size=".3"/></worldbody></mujoco>'
    )
    with wp.ScopedDevice(device):
        m, d = mjw.put_model(mjm), mjw.make_data(mjm, nworld=6)
        m.geom_rgba = wp.array([[(1.0, 0.0, 0.0, 1.0)], [(0.5, 0.5, 0.5, 1.0)]], dtype=wp.vec4)
        m.geom_matid = wp.array([[-1], [-1], [0]], dtype=wp.int32)
    layers = wc.from_mujoco_warp(mjm, m, d).tables().layers
    assert layers is not None and layers.has_transparent


def test_of_too_many_some_are_solid_and_it_is_said(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    crowd = "".join(f'<geom size=".02" pos="{k % 16 * 0.05} {k // 16 * 0.05} 3" rgba="1 0 0 .5"/>' for k in range(255))
    mjm = scenes.compile_xml(VIEW + BALL + crowd + BALL.replace('pos="0 0 .5"', 'pos=".5 .6 .5"') + LIGHT)
    mjm.stat.extent = 3.0
    solid = color_reference.ours(mjm, scenes.forward(mjm), device, transparency=False)
    assert not caplog.messages
    seen = color_reference.ours(mjm, scenes.forward(mjm), device)
    (told,) = caplog.messages
    assert "257 shapes" in told and "1 are drawn solid" in told
    assert (seen != solid).any()  # the first ball
    few = scenes.compile_xml(VIEW + BALL + BALL.replace('pos="0 0 .5"', 'pos=".5 .6 .5"').replace(".4", "1") + LIGHT)
    few.stat.extent = 3.0
    expected = color_reference.ours(few, scenes.forward(few), device)
    assert (np.abs(seen.astype(int) - expected).max(axis=-1) > 1).mean() < 0.02
