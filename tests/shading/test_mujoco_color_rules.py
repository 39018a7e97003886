"""One rule at a time of how MuJoCo's renderer colours a pixel: the same scene beside ``mujoco.Renderer``."""

import color_reference
import pytest
import scenes
import warp as wp
from golden_scenes import SHEET, compiled

CAMERA = '<camera pos="1.2 -1.9 2" xyaxes="1.9 1.2 0 -.8 1.2 2.3"/>'
DARK = '<visual><headlight active="0"/></visual>'
FLOOR = '<geom type="plane" size="1.5 1.5 .3" rgba=".7 .6 .5 1"/>'
BALL = '<geom type="sphere" size=".5" pos="0 0 .5" rgba=".8 .4 .3 1"/>'
BLOCK = '<geom type="box" size=".3 .4 .5" pos="0 0 .5" euler="0 0 30" rgba=".3 .6 .8 1"/>'
SPOT = '<light pos=".5 -.5 2" dir="-.2 .2 -1" castshadow="false" {}/>'
WIDE = SPOT.format('cutoff="85" exponent="2"')
SUN = '<light type="directional" dir="-.4 .5 -1" castshadow="false" {}/>'
CASTS = '<light type="directional" pos="0 0 2" dir=".5 .4 -1" {}/>'
# Its corners have one normal for all of their faces, since it has texture coordinates.
ROOF = """
  <mesh name="roof" vertex="-.6 -.6 0 .6 -.6 0 .6 .6 0 -.6 .6 0 0 0 .5" texcoord="0 0 1 0 1 1 0 1 .5 .5"
    face="0 1 4 1 2 4 2 3 4 3 0 4 0 2 1 0 3 2"/>
"""

# World, assets, and whether the headlight shines.
LIGHTS: dict[str, tuple[str, str, bool]] = {
    "headlight": (BALL + FLOOR, "", True),
    "none at all, and light everywhere": (BALL + FLOOR, "", False),
    "directional": (SUN.format("") + BALL + BLOCK, "", False),
    "its colours": (SUN.format('diffuse=".2 .7 .4" specular=".9 .1 .5" ambient=".2 .1 .1"') + BALL, "", False),
    "spot": (SPOT.format("") + BALL + FLOOR, "", False),
    "cutoff": (SPOT.format('cutoff="20" exponent="0"') + BALL + FLOOR, "", False),
    "exponent": (SPOT.format('exponent="40"') + BALL + FLOOR, "", False),
    "cutoffs over 90 degrees are none": (SPOT.format('cutoff="120" exponent="4"') + BALL + FLOOR, "", False),
    "exponents over 128 are none": (SPOT.format('cutoff="85" exponent="200"') + BALL + FLOOR, "", False),
    "attenuation": (SPOT.format('attenuation="1 .5 .3"') + BALL + FLOOR, "", False),
    "ambient of a spot": (SPOT.format('ambient=".3 .2 .1"') + BALL + FLOOR, "", False),
    "point lights are ignored": ('<light type="point" pos="0 -1 2"/>' + SUN.format("") + BALL, "", False),
    "image lights are ignored": (
        '<light type="image" pos="0 -1 2" texture="t" intensity="2000"/>' + SUN.format("") + BALL,
        '<texture name="t" type="2d" builtin="flat" rgb1="1 .8 .2" width="8" height="8"/>',
        True,
    ),
    "off": (SUN.format('active="false"') + SPOT.format("") + BALL, "", False),
    "of ten the first eight": (
        "".join(SUN.format(f'diffuse=".1 {0.02 * k} .1"').replace("-.4", f"{0.2 * k - 1}") for k in range(10)) + BALL,
        "",
        True,
    ),
    "at the corners of a floor": (WIDE.replace('pos=".5 -.5 2"', 'pos=".5 -.5 .7"') + FLOOR, "", False),
    "at the corners of a box": (WIDE.replace('pos=".5 -.5 2"', 'pos=".3 -.7 1.3"') + BLOCK, "", False),
}
SHADOWS = {
    "on a floor": (CASTS.format("") + BLOCK + FLOOR, "", True),
    "of a spot": (SPOT.format("").replace("false", "true") + BLOCK + FLOOR, "", True),
    "take the ambient part": (CASTS.format('ambient=".4 .4 .4"') + BLOCK + FLOOR, "", False),
    "one light's of two": (CASTS.format("") + SUN.format('diffuse=".3 .1 .1"') + BLOCK + FLOOR, "", False),
    "keep the ambient part of a face that a corner sees": (
        CASTS.format('ambient=".4 .3 .2"').replace(".5 .4 -1", ".5 .4 -.5")
        + FLOOR
        + '<geom type="mesh" mesh="roof" pos="0 0 .4" rgba=".3 .6 .8 1"/>',
        ROOF,
        False,
    ),
    **{
        f"of an open mesh, {side} lit": (
            CASTS.format("") + FLOOR + '<geom type="mesh" mesh="s" pos="0 0 .7" rgba=".3 .6 .8 1"/>',
            SHEET.format(faces),
            False,
        )
        for side, faces in (("front", "0 1 4 1 2 4 2 3 4 3 0 4"), ("back", "1 0 4 2 1 4 3 2 4 0 3 4"))
    },
}
MATERIAL = '<material name="m" {}/>'
TEXTURE = '<texture name="t" type="{}" builtin="checker" rgb1=".9 .3 .1" rgb2=".1 .3 .9" {} width="{}" height="{}"/>'
FLAT, CUBE = TEXTURE.format("2d", "", 60, 60), TEXTURE.format("cube", "", 64, 384)


def of_material(kind: str, more: str = "") -> str:
    geom = scenes.geom_xml(kind, more='material="m" ' + more)
    return f'<body pos="0 0 .6" euler="10 20 30">{geom}</body>'


MATERIALS = {
    "its colour": (SUN.format("") + of_material("sphere"), MATERIAL.format('rgba=".2 .7 .3 1"'), True),
    "a geom's colour before it": (
        SUN.format("") + of_material("sphere", 'rgba=".9 .2 .3 1"'),
        MATERIAL.format('rgba=".2 .7 .3 1" emission=".2"'),
        True,
    ),
    "emission": (SUN.format("") + of_material("sphere"), MATERIAL.format('emission=".6" rgba=".2 .7 .3 1"'), True),
    "specular": (SUN.format("") + of_material("sphere"), MATERIAL.format('specular="1" rgba=".2 .3 .3 1"'), True),
    "shininess": (
        SUN.format("") + of_material("sphere"),
        MATERIAL.format('specular="1" shininess=".1" rgba=".2 .3 .3 1"'),
        True,
    ),
    "highlights are textured": (
        SUN.format('specular="1 1 1"') + of_material("sphere"),
        FLAT + MATERIAL.format('texture="t" specular="1" shininess=".3"'),
        True,
    ),
    "repeated": (SUN.format("") + of_material("box"), CUBE + MATERIAL.format('texture="t" texrepeat="3 2"'), True),
    "by the metre": (
        SUN.format("") + '<geom type="plane" size="1.5 1.5 .3" material="m"/>',
        FLAT + MATERIAL.format('texture="t" texrepeat="2 3" texuniform="true"'),
        True,
    ),
    "tagged sRGB": (
        SUN.format("") + of_material("box"),
        TEXTURE.format("2d", 'colorspace="sRGB"', 60, 60) + MATERIAL.format('texture="t"'),
        True,
    ),
    **{
        f"repeated {repeat} times over a {shape}": (
            SUN.format("") + of_material(shape),
            FLAT + MATERIAL.format(f'texture="t" texrepeat="{repeat}" texuniform="{uniform}"'),
            True,
        )
        for repeat, uniform in (("-2 3", "false"), ("2 0", "true"))
        for shape in scenes.TYPES
    },
    **{
        f"cube by the metre on a {shape}": (
            SUN.format("") + of_material(shape),
            CUBE + MATERIAL.format('texture="t" texuniform="true"'),
            True,
        )
        for shape in scenes.TYPES
    },
    "finer than pixels": (
        SUN.format("") + '<geom type="plane" size="1.5 1.5 .3" material="m"/>',
        FLAT + MATERIAL.format('texture="t" texrepeat="40 30"'),
        True,
    ),
    "repeated -2 times over a mesh with coordinates": (
        SUN.format("") + '<geom type="mesh" mesh="roof" pos="0 0 .4" material="m"/>',
        ROOF + FLAT + MATERIAL.format('texture="t" texrepeat="-2 3"'),
        True,
    ),
    **{
        f"{kind} on a {shape}": (
            SUN.format("") + of_material(shape),
            texture + MATERIAL.format('texture="t" texrepeat="2 2"'),
            True,
        )
        for kind, texture in (("image", FLAT), ("cube", CUBE))
        for shape in scenes.TYPES
    },
}


def check(rule: tuple[str, str, bool], device: wp.Device, **options: object) -> None:
    world, assets, headlight = rule
    mjm = compiled(CAMERA + world, assets, "" if headlight else DARK)
    color_reference.check(mjm, device, differs=False, **options)


@pytest.mark.parametrize("rule", LIGHTS)
def test_lights(device: wp.Device, rule: str) -> None:
    check(LIGHTS[rule], device)


@pytest.mark.parametrize("rule", SHADOWS)
def test_shadows(device: wp.Device, rule: str) -> None:
    """But for the speckles of slanted light, which are not imitated."""
    check(SHADOWS[rule], device, most=0.01)


@pytest.mark.parametrize("rule", MATERIALS)
def test_materials(device: wp.Device, rule: str) -> None:
    check(MATERIALS[rule], device)
