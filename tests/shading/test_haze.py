"""Haze over the horizon of endless planes, and the skybox that ends them: as ``mujoco.Renderer`` draws them."""

import color_reference
import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

ASSETS = """
  <texture type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 0" width="64" height="384"/>
  <texture name="squares" type="2d" builtin="checker" width="64" height="64" rgb1=".8 .2 .2" rgb2=".2 .8 .3"/>
  <material name="tiles" texture="squares" texrepeat="1 1" texuniform="true"/>
  <material name="even" rgba=".3 .4 .2 1" emission="1" specular="0"/>
"""
LIGHT = '<light pos="0 0 5" directional="true" castshadow="false"/>'
PLANE = '<geom type="plane" size="0 0 .1" material="{}" {}/>'
SCENES = {
    "low": (PLANE.format("even", ""), 'pos="0 -3 .5" xyaxes="1 .1 0 0 .02 1"'),
    "high": (PLANE.format("even", ""), 'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"'),
    "tiles": (PLANE.format("tiles", ""), 'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"'),
    "tilted": (PLANE.format("even", 'zaxis="0 .1 1"'), 'pos="0 -3 5" xyaxes="1 0 0 0 .2 1"'),
    "before it": (
        PLANE.format("even", "") + '<geom type="box" size="1 1 9" pos="-3 20 0" rgba="1 0 0 1"/>',
        'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"',
    ),
    "of a floor of glass": (PLANE.format("even", 'rgba=".3 .4 .2 .5"'), 'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"'),
    "of a floor of glass, seen through glass": (
        PLANE.format("even", 'rgba=".3 .4 .2 .5"') + '<geom type="box" size="2 .1 3" pos="-1 1 9" rgba="1 0 0 .4"/>',
        'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"',
    ),
    "of a floor of glass, over a box of glass beyond the skybox": (
        PLANE.format("even", 'rgba=".3 .4 .2 .5"') + '<geom type="box" size="5 1 9" pos="0 42 9" rgba="1 0 0 .4"/>',
        'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"',
    ),
    "of a floor of glass from below": (
        PLANE.format("even", 'rgba=".3 .4 .2 .5"'),
        'pos="0 -3 -5" xyaxes="1 0 0 0 -.1 1"',
    ),
    "seen through glass": (
        PLANE.format("even", "") + '<geom type="box" size="2 .1 3" pos="-1 1 9" rgba="1 0 0 .4"/>',
        'pos="0 -3 9" xyaxes="1 0 0 0 .3 1"',
    ),
}


def model(plane: str, camera: str, visual: str = "") -> mujoco.MjModel:
    world = f"{plane}<camera {camera}/>{LIGHT}"
    return scenes.compile_xml(world, assets=ASSETS, more=f'<statistic extent="1"/><visual>{visual}</visual>')


@pytest.mark.parametrize("name", SCENES)
def test_as_mujoco_draws_it(device: wp.Device, name: str) -> None:
    color_reference.check(model(*SCENES[name]), device, differs=False, most=0.004)


def test_width_and_colour(device: wp.Device) -> None:
    mjm = model(*SCENES["high"], visual='<map haze=".6"/><rgba haze=".9 .3 .1 1"/>')
    seen = color_reference.check(mjm, device, differs=False, most=0.004).astype(int)
    assert (seen[..., 0] > 200).any()  # neither the plane nor the sky is red


def test_the_densest_haze_has_its_own_colour(device: wp.Device) -> None:
    """From height h over the plane it is seen where the cone is h w / (1 + w) high, w being its width."""
    mjm = model(*SCENES["high"], visual='<rgba haze=".9 .3 .1 1"/>')
    eye = wc.Camera(
        "eye",
        width=3,
        height=2001,
        outputs=("rgb",),
        lens=wc.Pinhole(fovy=40.0),
        position=(0, 0, 9),
        rotation=(1, 1, 0, 0),
    )
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), eye)["rgb"][0, :, 1].astype(int)
    width, radius = mjm.vis.map.haze, 0.7 * mjm.vis.map.zfar * mjm.stat.extent
    middle = width / (1.0 + width)
    slope = 9.0 * (1.0 - middle) / (radius * (1.0 - width * (1.0 - middle)))
    row = round(1000 + slope / (2.0 * np.tan(np.radians(20.0)) / 2001))
    np.testing.assert_allclose(seen[row], (230, 77, 26), atol=3)


def test_a_background_of_ones_own_has_no_haze(device: wp.Device) -> None:
    mjm = model(*SCENES["high"])
    eye = wc.Camera(0, width=32, height=32, outputs=("rgb",), background=(0.0, 0.0, 1.0))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), eye)["rgb"][0]
    assert len(np.unique(seen.reshape(-1, 3), axis=0)) == 2


def test_worlds_have_a_haze_each(device: wp.Device) -> None:
    mjm = model(*SCENES["high"])
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, 2)
        heights = d.geom_xpos.numpy()
        heights[1, 0, 2] = -6.0
        d.geom_xpos.assign(heights)
        scene = wc.from_mujoco_warp(mjm, m, d)
        seen = scenes.look(scene, wc.Camera(0, width=32, height=64, outputs=("rgb",)))["rgb"]
    alone = scenes.look(
        wc.from_mujoco(mjm, scenes.forward(mjm), device=device), wc.Camera(0, width=32, height=64, outputs=("rgb",))
    )["rgb"]
    np.testing.assert_array_equal(seen[0], alone[0])
    assert (seen[1] != seen[0]).any()


SKY = '<texture type="skybox" builtin="flat" mark="cross" rgb1=".2 .4 .6" markrgb="1 1 0" width="64" height="64"/>'
PARALLEL = '<camera projection="orthographic" fovy="{}" pos="1 2 .5" xyaxes="{}"/>'


@pytest.mark.parametrize("glass", ["", '<geom type="box" size=".4 .4 .4" pos="1 6 .5" rgba="1 0 0 .5"/>'])
@pytest.mark.parametrize("axes", ["1 0 0 0 .2 1", "1 0 0 0 1 0", "0 1 .1 -.3 -.1 1"])
def test_parallel_rays_see_as_much_of_the_skybox_as_they_span(device: wp.Device, axes: str, glass: str) -> None:
    world = f'<geom size=".1" pos="1 3 .5"/>{glass}{PARALLEL.format(6, axes)}'
    mjm = scenes.compile_xml(world, assets=SKY, more='<statistic extent="3"/>')
    seen = color_reference.check(mjm, device, differs=False, most=0.004)
    assert len(np.unique(seen.reshape(-1, 3), axis=0)) > 9
