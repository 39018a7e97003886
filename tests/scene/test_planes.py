"""Which planes CUDA kernels have to draw: what a scene's arrays hold when it is made."""

import pytest
import scenes
import warp as wp

import warpcam as wc

MATERIALS = '<material name="grey" rgba=".4 .4 .4 1"/><material name="hue" rgba=".4 .5 .4 1"/>'
BALL = '<geom size=".2" rgba="1 0 0 1"/>'


def general(xml: str, *varied: str, headlight: str = ".4 .4 .4") -> bool:
    visual = f'<visual><headlight diffuse="{headlight}"/></visual>'
    mjm = scenes.compile_xml(BALL + xml, assets=MATERIALS, more=visual)
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 2))
    for name in varied:
        scene.vary(name)
    return scene.tables().general_planes


@pytest.mark.parametrize(
    ("xml", "expected"),
    [
        ("", False),
        ('<geom type="plane" size="0 0 1"/>', False),
        ('<geom type="plane" size="0 0 1" rgba=".2 .2 .2 1"/>', False),
        ('<geom type="plane" size="0 0 1" rgba=".2 .2 .3 1"/>', True),
        ('<geom type="plane" size="0 0 1" material="grey"/>', False),
        ('<geom type="plane" size="0 0 1" material="hue"/>', True),
        ('<geom type="plane" size="0 0 1" material="grey"/><geom size=".1" material="hue"/>', False),
        ('<geom type="plane" size="4 4 .5"/>', False),
        ('<geom type="plane" size="4 4.5 .5"/>', True),
        ('<geom type="plane" size="4 0 .3"/>', True),
        ('<geom type="plane" size="0 0 1"/><geom type="plane" size="0 0 1" zaxis="1 0 0"/>', True),
        ('<geom type="plane" size="0 0 1"/><light diffuse=".5 .5 .5"/>', False),
        ('<geom type="plane" size="0 0 1"/><light diffuse=".5 .5 .4"/>', True),
        ('<light diffuse=".5 .5 .4"/>', False),
    ],
)
def test_more_than_an_endless_grey_one(xml: str, expected: bool, device: wp.Device) -> None:
    assert general(xml) == expected


def test_the_headlight_counts_too(device: wp.Device) -> None:
    plane = '<geom type="plane" size="0 0 1"/>'
    assert general(plane, headlight=".4 .4 .5")
    assert not general("", headlight=".4 .4 .5")


def test_colors_that_worlds_have_for_themselves_may_have_a_hue(device: wp.Device) -> None:
    plane = '<geom type="plane" size="0 0 1" material="grey"/><light/>'
    assert not general(plane, "light_intensity", "material_shininess")
    for name in ("material_color", "shape_colors", "light_diffuse", "headlight"):
        assert general(plane, name)
