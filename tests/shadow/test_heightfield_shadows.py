"""Objects in the ground of a height field are in its shadow, whichever way light comes in, beside ``mujoco.Renderer``:
the maps of its lights hold both sides of all faces, while a camera in the ground sees none of them.
"""

import color_reference
import numpy as np
import pytest
import scenes
import warp as wp

COLOURS = 'ambient=".1 .2 .1" diffuse=".7 .7 .7"'
HILLS = '<hfield name="hills" nrow="9" ncol="9" size="2 2 .6 .3" elevation="{}"/>'.format(
    " ".join(f"{9 - (i // 9 - 4) ** 2 / 4 - (i % 9 - 4) ** 2 / 4 + i * 7 % 3:g}" for i in range(81))
)
GROUND = '<geom type="hfield" hfield="hills" rgba=".7 .5 .4 1"/>'
FLOOR = '<geom type="plane" size="4 4 .5" pos="0 0 .1" rgba=".4 .6 .8 1"/>'
BOXES = """
  <geom type="box" size=".15 .1 .1" pos=".4 .2 .4" rgba=".3 .8 .4 1"/>
  <geom type="box" size=".15 .1 .12" pos=".8 .9 .2" euler="20 0 30" rgba=".8 .8 .2 1"/>
  <geom type="box" size=".1 .1 .1" pos="0 .4 -.1" rgba=".8 .3 .2 1"/>
"""
LIGHTS = {  # by where their light comes in: from the boxes it is the way out
    "top": f'<light type="directional" pos="0 0 4" dir=".3 .2 -1" {COLOURS}/>',
    "top, of a spot": f'<light pos=".3 .2 3" dir="0 0 -1" cutoff="60" exponent="1" {COLOURS}/>',
    "side": f'<light type="directional" pos="-3 0 .4" dir="1 .2 -.1" {COLOURS}/>',
    "base": f'<light type="directional" pos="0 0 -4" dir=".3 .2 1" {COLOURS}/>',
}
INSIDE = f'<light pos="-.2 -.6 .3" dir=".6 1 -.2" cutoff="80" {COLOURS}/>'
EYES = {  # where they are and what they look at
    "down from the ground": ((0.0, -0.4, 0.45), (0.6, 0.8, 0.0)),
    "level with it": ((-0.9, -0.8, 0.25), (0.8, 0.9, 0.25)),
    "down from above": ((2.5, -3.0, 2.5), (0.0, 0.0, 0.0)),
}
ONTO_IT = ((0.3, -0.4, 2.5), (0.0, 0.0, 0.6))


def ground(light: str, eye: tuple, *, floor: bool, crowd: int = 0) -> tuple:
    camera = '<camera pos="{} {} {}" quat="{} {} {} {}"/>'.format(*eye[0], *scenes.looking(*eye))
    far = "".join(f'<geom size="0.01" pos="0 {-60 - 0.1 * i} 0"/>' for i in range(crowd))
    mjm = scenes.compile_xml(
        light + GROUND + BOXES + far + camera + (FLOOR if floor else ""),
        assets=HILLS,
        more='<visual><headlight active="0"/><map znear="0.001" zfar="20"/></visual>',
    )
    mjm.stat.extent = 6.0
    return mjm, scenes.forward(mjm)


@pytest.mark.parametrize(("eye", "crowd"), [*((eye, 0) for eye in EYES), ("level with it", 400)])
@pytest.mark.parametrize("light", LIGHTS)
def test_ground_shades_what_is_in_it(device: wp.Device, light: str, eye: str, crowd: int) -> None:
    mjm, mjd = ground(LIGHTS[light], EYES[eye], floor=light != "base", crowd=crowd)
    seen = color_reference.check(mjm, device, limit=6, most=0.005, differs=False)
    if eye != "down from above":
        mjm.light_castshadow[:] = False
        lit = color_reference.ours(mjm, mjd, device).astype(int)
        assert (np.abs(seen - lit).max(axis=-1) > 6).mean() > 0.05


@pytest.mark.parametrize("crowd", [0, 400])
def test_light_in_the_ground_shines_there(device: wp.Device, crowd: int) -> None:
    mjm, mjd = ground(INSIDE, EYES["down from the ground"], floor=True, crowd=crowd)
    color_reference.check(mjm, device, limit=6, most=0.005, differs=False)
    assert (color_reference.ours(mjm, mjd, device).max(axis=-1) > 30).mean() > 0.5


@pytest.mark.parametrize("crowd", [0, 400])
def test_lit_ground_has_no_speckles(device: wp.Device, crowd: int) -> None:
    """Shadow rays without a bias start right at the ground, and slanted ones stay near it."""
    light = f'<light type="directional" pos="0 0 4" dir="1 .1 -.02" {COLOURS}/>'
    mjm, mjd = ground(light, ONTO_IT, floor=False, crowd=crowd)
    mjm.hfield_data[:] = 1.0
    mjm.vis.map.shadowclip = 0.0
    shaded = color_reference.ours(mjm, mjd, device)
    mjm.light_castshadow[:] = False
    lit = color_reference.ours(mjm, mjd, device)
    assert (lit.max(axis=-1) > 10).all()
    assert (shaded == lit).all()
