"""Which lights of many count: those that ``mujoco.Renderer`` has places for."""

import colour_reference
import pytest
import scenes
import warp as wp

from warpcam.sources.mujoco_model import REVISED, VERSION


@pytest.mark.skipif(VERSION < REVISED, reason="point lights shine there")
def test_point_lights_take_no_place_from_others(device: wp.Device) -> None:
    lights = "".join(
        f'<light pos="{x} -1 2" dir="0 .3 -1" diffuse="{x / 9} .2 {1 - x / 9}" castshadow="false"/>' for x in range(6)
    )
    points = '<light type="point" pos="0 0 2"/><light type="point" pos="1 0 2"/>'
    world = f'{lights}{points}<light pos="0 -3 2" dir="0 1 -.6" diffuse="0 .7 0" castshadow="false"/>'
    mjm = scenes.compile_xml(
        f'{world}<geom type="sphere" size="1"/><camera pos="0 -4 2" xyaxes="1 0 0 0 .4 1"/>',
        more='<visual><headlight ambient=".1 .1 .1" diffuse=".1 .1 .1" specular="0 0 0"/></visual>',
    )
    colour_reference.check(mjm, device, differs=False)
