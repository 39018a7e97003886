"""Planes under a spot light, which is computed at the corners that MuJoCo's renderer cuts them at."""

import colour_reference
import pytest
import scenes
import warp as wp

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
    seen = colour_reference.check(mjm, device, limit=2, differs=False)
    assert seen.max() > 100
