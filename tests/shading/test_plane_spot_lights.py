"""Planes under a spot light, which is computed at the corners that MuJoCo's renderer cuts them at."""

import color_reference
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

TEXTURE = '<texture name="white" type="2d" builtin="flat" rgb1="1 1 1" width="8" height="8"/>'
LIGHT = '<light pos="{} {} 1.5" dir="0 0 -1" cutoff="35" exponent="5" diffuse=".9 .9 .9" castshadow="false"/>'
CAMERA = '<camera pos="{} {} 1.4" xyaxes="1 .1 0 0 .6 .8"/>'
DIM = '<visual><headlight ambient=".1 .1 .1" diffuse="0 0 0" specular="0 0 0"/><map zfar="30"/></visual>'


@pytest.mark.parametrize("eye", [(0.5, -1.8), (37.2, 4.1)])
@pytest.mark.parametrize("material", ['texrepeat="5 5"', 'texrepeat="0.7 3"', 'texture="white" texrepeat="5 5"'])
@pytest.mark.parametrize("size", ["0 0 .1", "50 0 .2", "50 50 .4"])
def test_spots_on_planes(device: wp.Device, size: str, material: str, eye: tuple[float, float]) -> None:
    world = LIGHT.format(eye[0], eye[1] + 2.0) + CAMERA.format(*eye)
    mjm = scenes.compile_xml(
        world + f'<geom type="plane" size="{size}" material="m"/>',
        assets=f'{TEXTURE}<material name="m" rgba=".7 .7 .7 1" {material}/>',
        more=DIM + '<statistic extent="2" center="0 0 0"/>',
    )
    seen = color_reference.check(mjm, device, limit=2, differs=False)
    assert seen.max() > 100


def test_a_cube_texture_by_the_metre_on_an_endless_plane(device: wp.Device) -> None:
    """The texture is by the metre anyway: no length of 0 multiplies a direction into the texture."""
    cube = '<texture name="cube" type="cube" builtin="gradient" rgb1=".9 .2 .1" rgb2=".1 .3 .9" mark="cross" '
    cube += 'markrgb="1 1 1" width="16" height="16"/>'
    images = []
    for uniform in ("false", "true"):
        mjm = scenes.compile_xml(
            CAMERA.format(0.5, -1.8) + '<geom type="plane" size="0 0 .1" material="m"/>',
            assets=f'{cube}<material name="m" texture="cube" texrepeat="3 2" texuniform="{uniform}"/>',
        )
        scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
        images.append(scenes.look(scene, wc.Camera(0, width=64, height=48, outputs=("rgb", "albedo"))))
    for output in ("rgb", "albedo"):
        assert images[0][output].std() > 10
        np.testing.assert_array_equal(images[0][output], images[1][output])
